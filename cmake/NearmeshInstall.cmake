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

set(NEARMESH_PROGRAMS)
foreach(program nearmesh-model nearmesh-publisher nearmesh-subscriber nearmesh-demo-flights)
  if(TARGET ${program})
    list(APPEND NEARMESH_PROGRAMS ${program})
    install(TARGETS ${program} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT tools)
  endif()
endforeach()
# api.md lists the headers that users may include; each of them says so in its third line.
if(NOT NEARMESH_PACKAGES)
  install(FILES ${PROJECT_SOURCE_DIR}/LICENSE ${PROJECT_SOURCE_DIR}/docs/api.md DESTINATION ${CMAKE_INSTALL_DOCDIR})
endif()

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/nearmeshConfig.cmake.in
  ${PROJECT_BINARY_DIR}/cmake/nearmeshConfig.cmake INSTALL_DESTINATION ${package_folder})
# Before 1.0 a minor version may change anything.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/cmake/nearmeshConfigVersion.cmake
  COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/cmake/nearmeshConfig.cmake ${PROJECT_BINARY_DIR}/cmake/nearmeshConfigVersion.cmake
        DESTINATION ${package_folder})

# The same for pkg-config, as two modules: nearmesh-core, and nearmesh-cpp with all that there is. (nearmesh is the C interface.)
set(needs_core -lhwy -lcrypto -pthread)
set(needs -lassimp -lz -lsqlite3)
if(GDAL_FOUND)
  list(APPEND needs -lgdal)
endif()
if(NEARMESH_WITH_DDS)
  list(APPEND needs -ltinyxml2 -l${NEARMESH_FASTDDS} -lfastcdr)
  install(FILES ${PROJECT_SOURCE_DIR}/idl/nearmesh.idl DESTINATION ${CMAKE_INSTALL_DATADIR}/nearmesh/idl)
endif()
set(archives)
foreach(library ${libraries})
  list(PREPEND archives -l${library})  # who rests on others comes before them
endforeach()
foreach(suffix -cpp -core)
  set(about "Certified collision detection over DDS")
  set(libs ${archives} ${needs} ${needs_core})
  if(suffix STREQUAL "-core")
    set(about "Certified collision detection, without a network")
    set(libs -lnearmesh_core ${needs_core})
  endif()
  list(JOIN libs " " libs)
  configure_file(${PROJECT_SOURCE_DIR}/cmake/packages/nearmesh.pc.in ${PROJECT_BINARY_DIR}/cmake/nearmesh${suffix}.pc @ONLY)
  install(FILES ${PROJECT_BINARY_DIR}/cmake/nearmesh${suffix}.pc DESTINATION ${CMAKE_INSTALL_LIBDIR}/pkgconfig)
endforeach()

if(NEARMESH_PACKAGES)
  set(NEARMESH_PACKAGE_VERSION ${PROJECT_VERSION})
  set(NEARMESH_MAINTAINER "nearmesh maintainers <maintainers@users.noreply.h-seed-4db0c024.example>")
  include(NearmeshPackages)
endif()
