# Called by the test "added": a project that adds nearmesh is configured with no build type, and with one; its tests and its
# install are its own.
function(configure folder)
  execute_process(
    COMMAND ${CMAKE_COMMAND} -S ${PROJECT} -B ${folder} -G ${GENERATOR} --log-level=WARNING -D NEARMESH=${NEARMESH}
            -D CMAKE_C_COMPILER=${C} -D CMAKE_CXX_COMPILER=${CXX} -D NEARMESH_WITH_DDS=${WITH_DDS} ${ARGN}
    COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# Out: the lines of all install scripts that install something of nearmesh.
function(find_installs folder out)
  file(GLOB_RECURSE scripts ${folder}/_deps/nearmesh-build/cmake_install.cmake)
  if(NOT scripts)
    message(FATAL_ERROR "no install script in ${folder}")
  endif()
  set(found)
  foreach(script ${scripts})
    file(STRINGS ${script} lines REGEX "file\\(INSTALL")
    list(APPEND found ${lines})
  endforeach()
  set(${out} "${found}" PARENT_SCOPE)
endfunction()

file(REMOVE_RECURSE ${SCRATCH})
configure(${SCRATCH}/plain)
find_installs(${SCRATCH}/plain installed)
if(installed)
  message(FATAL_ERROR "the project would install of nearmesh: ${installed}")
endif()
execute_process(COMMAND ${CMAKE_CTEST_COMMAND} -N --test-dir ${SCRATCH}/plain OUTPUT_VARIABLE tests
                COMMAND_ERROR_IS_FATAL ANY)
if(NOT tests MATCHES "Total Tests: 1\n")
  message(FATAL_ERROR "expected the project's test alone:\n${tests}")
endif()

# With a build type; and where it asks for nearmesh's install.
configure(${SCRATCH}/asked -D CMAKE_BUILD_TYPE=RelWithDebInfo -D NEARMESH_INSTALL=ON)
find_installs(${SCRATCH}/asked installed)
if(NOT installed)
  message(FATAL_ERROR "NEARMESH_INSTALL=ON installs nothing")
endif()
