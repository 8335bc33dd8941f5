# Debian packages: `cpack -G DEB` in a build of the preset `package` makes nearmesh-tools, libnearmesh-dev, libnearmesh0 (the shared
# library for C) and python3-nearmesh (where pybind11 is there), for the release on which it runs. Man pages and completion are made of the programs' own --help. tests/platforms/packages.sh tries them.

find_package(Python3 REQUIRED COMPONENTS Interpreter)
set(from ${PROJECT_SOURCE_DIR}/cmake/packages)
set(made ${PROJECT_BINARY_DIR}/packages)
file(MAKE_DIRECTORY ${made})

set(pages)
foreach(program ${NEARMESH_PROGRAMS})
  add_custom_command(OUTPUT ${made}/${program}.1.gz
    COMMAND Python3::Interpreter ${from}/make_pages.py $<TARGET_FILE:${program}> ${made}/${program}.1 ${made}/${program}
    COMMAND gzip -9nf ${made}/${program}.1
    DEPENDS ${program} ${from}/make_pages.py VERBATIM)
  list(APPEND pages ${made}/${program}.1.gz)
  install(FILES ${made}/${program}.1.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1 COMPONENT tools)
  install(FILES ${made}/${program} DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions COMPONENT tools)
endforeach()
add_custom_target(nearmesh_pages ALL DEPENDS ${pages})

set(library libnearmesh${PROJECT_VERSION_MAJOR})  # by its SONAME, so that two of them may be installed
set(package_of_tools nearmesh-tools)
set(package_of_dev libnearmesh-dev)
set(package_of_c ${library})
set(package_of_python python3-nearmesh)
set(components tools dev c)
if(TARGET nearmesh_python)
  list(APPEND components python)
endif()
foreach(component ${components})
  set(package ${package_of_${component}})
  # The release's name is the distribution's; packages of two releases differ, so their versions do.
  file(CONFIGURE OUTPUT ${made}/${package}/changelog CONTENT
"nearmesh (${NEARMESH_PACKAGE_VERSION}) unstable; urgency=medium

  * See /usr/share/doc/nearmesh-tools/CHANGELOG.md.

 -- ${NEARMESH_MAINTAINER}  Mon, 23 Nov 2026 00:00:00 +0000
" @ONLY)
  execute_process(COMMAND gzip -9nkf ${made}/${package}/changelog COMMAND_ERROR_IS_FATAL ANY)
  install(FILES ${made}/${package}/changelog.gz ${from}/copyright
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/${package} COMPONENT ${component})
endforeach()

# The pages link to each other, so they lie as in the source.
set(doc ${CMAKE_INSTALL_DATADIR}/doc/nearmesh-tools)
install(FILES ${PROJECT_SOURCE_DIR}/README.md ${PROJECT_SOURCE_DIR}/CHANGELOG.md DESTINATION ${doc} COMPONENT tools)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/docs DESTINATION ${doc} COMPONENT tools FILES_MATCHING PATTERN *.md PATTERN *.svg)
install(FILES ${PROJECT_SOURCE_DIR}/core/spm_format.md ${PROJECT_SOURCE_DIR}/core/THEOREM.md DESTINATION ${doc}/core COMPONENT tools)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/examples/demo ${PROJECT_SOURCE_DIR}/examples/settings DESTINATION ${doc}/examples
        COMPONENT tools FILES_MATCHING PATTERN *.yaml)
install(FILES ${PROJECT_SOURCE_DIR}/docs/api.md ${PROJECT_SOURCE_DIR}/docs/embed.md
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libnearmesh-dev COMPONENT dev)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/examples/cyclone ${PROJECT_SOURCE_DIR}/examples/embed ${PROJECT_SOURCE_DIR}/examples/flight_sim
        ${PROJECT_SOURCE_DIR}/examples/flightgear ${PROJECT_SOURCE_DIR}/examples/read_session
        DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/libnearmesh-dev/examples COMPONENT dev)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME nearmesh)
set(CPACK_PACKAGE_VERSION ${NEARMESH_PACKAGE_VERSION})
set(CPACK_PACKAGING_INSTALL_PREFIX ${CMAKE_INSTALL_PREFIX})
set(CPACK_PACKAGE_DIRECTORY ${made})
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_ALL ${components})
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_STRIP_FILES ON)
set(CPACK_PRE_BUILD_SCRIPTS ${from}/strip_more.cmake)
set(CPACK_POST_BUILD_SCRIPTS ${from}/without_ldconfig.cmake)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_MAINTAINER "${NEARMESH_MAINTAINER}")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_TOOLS_PACKAGE_NAME nearmesh-tools)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SECTION net)
set(CPACK_DEBIAN_TOOLS_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_DEV_PACKAGE_NAME libnearmesh-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
# What the CMake configuration and the .pc file of static libraries ask for.
set(needs libhwy-dev libssl-dev libassimp-dev zlib1g-dev libsqlite3-dev libtinyxml2-dev libfastcdr-dev
          lib${NEARMESH_FASTDDS}-dev nlohmann-json3-dev)
if(GDAL_FOUND)
  list(APPEND needs libgdal-dev)
endif()
list(APPEND needs "${library} (= ${NEARMESH_PACKAGE_VERSION})")
list(JOIN needs ", " CPACK_DEBIAN_DEV_PACKAGE_DEPENDS)
set(CPACK_DEBIAN_C_PACKAGE_NAME ${library})
set(CPACK_DEBIAN_C_PACKAGE_SECTION libs)
set(CPACK_DEBIAN_C_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_C_PACKAGE_CONTROL_EXTRA ${made}/${library}/shlibs ${from}/triggers)
file(WRITE ${made}/${library}/shlibs "libnearmesh ${PROJECT_VERSION_MAJOR} ${library} (>= ${PROJECT_VERSION})\n")
if(TARGET nearmesh_python)
  # The module is of one minor version of Python. What Python compiles at installation goes with the package.
  get_target_property(minor nearmesh_python NEARMESH_PYTHON_MINOR)
  math(EXPR next "${minor} + 1")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_NAME python3-nearmesh)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SECTION python)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_SHLIBDEPS ON)
  set(CPACK_DEBIAN_PYTHON_PACKAGE_DEPENDS
      "python3 (>= 3.${minor}), python3 (<< 3.${next}), python3-numpy")
  set(CPACK_DEBIAN_PYTHON_PACKAGE_CONTROL_EXTRA ${from}/python/postinst ${from}/python/prerm)
  install(FILES ${PROJECT_SOURCE_DIR}/examples/python/chart.py ${PROJECT_SOURCE_DIR}/examples/python/peer.py
          DESTINATION ${CMAKE_INSTALL_DATADIR}/doc/python3-nearmesh/examples COMPONENT python)
endif()
set(about "Streams, over DDS, only the mesh detail that is about to be touched, and tells
every simulation peer whether two objects collide, with a proof attached to
each answer.")
set(CPACK_COMPONENT_TOOLS_DESCRIPTION "${about}

This package has the programs that make models, serve them, fly, record and
verify, a systemd unit, and the documentation.")
set(CPACK_COMPONENT_DEV_DESCRIPTION "${about}

This package has the headers for C++ and C, static libraries, the
configuration for CMake and pkg-config, and the IDL of the topics.")
set(CPACK_COMPONENT_C_DESCRIPTION "${about}

This package has the shared library for programs in C and other languages;
it holds all that it needs of nearmesh.")
set(CPACK_COMPONENT_PYTHON_DESCRIPTION "${about}

This package has the Python module: baking, queries, peers, recordings.")
include(CPack)
