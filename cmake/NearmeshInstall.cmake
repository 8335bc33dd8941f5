# Install and export (public headers: nearmesh_add_library); tests/consumer proves that the result can be used with find_package(nearmesh).
# One export file a library, so that a project which asks for core alone needs none of the others' dependencies.
include(CMakePackageConfigHelpers)

set(package_folder ${CMAKE_INSTALL_LIBDIR}/cmake/nearmesh)

get_property(libraries GLOBAL PROPERTY NEARMESH_LIBRARIES)
foreach(library ${libraries})
  string(REPLACE nearmesh_ "" component ${library})
  install(TARGETS ${library} EXPORT ${library} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
  install(EXPORT ${library} NAMESPACE nearmesh:: FILE nearmesh-${component}.cmake DESTINATION ${package_folder})
endforeach()

foreach(program nearmesh-model nearmesh-publisher nearmesh-subscriber)
  if(TARGET ${program})
    install(TARGETS ${program} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
  endif()
endforeach()
# api.md lists the headers that users may include; each of them says so in its third line.
install(FILES ${PROJECT_SOURCE_DIR}/LICENSE ${PROJECT_SOURCE_DIR}/docs/api.md DESTINATION ${CMAKE_INSTALL_DOCDIR})

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/nearmeshConfig.cmake.in
  ${PROJECT_BINARY_DIR}/cmake/nearmeshConfig.cmake INSTALL_DESTINATION ${package_folder})
# Before 1.0 a minor version may change anything.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/cmake/nearmeshConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/cmake/nearmeshConfig.cmake ${PROJECT_BINARY_DIR}/cmake/nearmeshConfigVersion.cmake
        DESTINATION ${package_folder})
