# Called by the test "consumer": install, configure, build, run; each must succeed.
function(run)
  execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# From nothing each time, so that no file of an earlier install can help.
file(REMOVE_RECURSE ${SCRATCH}/prefix ${SCRATCH}/build ${SCRATCH}/c_build ${SCRATCH}/cyclone_build ${SCRATCH}/flightgear_build)
run(${CMAKE_COMMAND} --install ${BUILD} --prefix ${SCRATCH}/prefix)
run(${CMAKE_COMMAND} -S ${PROJECT} -B ${SCRATCH}/build -G ${GENERATOR}
    -D CMAKE_PREFIX_PATH=${SCRATCH}/prefix -D COMPONENTS=${COMPONENTS} -D CMAKE_CXX_COMPILER=${CXX}
    -D CMAKE_BUILD_TYPE=${BUILD_TYPE} -D CMAKE_CXX_FLAGS=${CXX_FLAGS})
run(${CMAKE_COMMAND} --build ${SCRATCH}/build)
run(${SCRATCH}/build/two_spheres)
run(${SCRATCH}/build/local_peer ${SCRATCH}/sphere.spm)
if(EXISTS ${SCRATCH}/build/lone_peer)  # with DDS
  run(${SCRATCH}/build/lone_peer)
endif()
run(${SCRATCH}/prefix/bin/nearmesh-model --help)

# In C, by CMake without any other package; and by pkg-config, from a prefix that was moved.
run(${CMAKE_COMMAND} -S ${C_PROJECT} -B ${SCRATCH}/c_build -G ${GENERATOR} -D CMAKE_PREFIX_PATH=${SCRATCH}/prefix
    -D CMAKE_C_COMPILER=${C} -D CMAKE_BUILD_TYPE=${BUILD_TYPE})
run(${CMAKE_COMMAND} --build ${SCRATCH}/c_build)
run(${SCRATCH}/c_build/two_cubes ${SCRATCH}/cube.spm)
# The example that needs another vendor's DDS, where that is there.
if(CYCLONE_PROJECT)
  run(${CMAKE_COMMAND} -S ${CYCLONE_PROJECT} -B ${SCRATCH}/cyclone_build -G ${GENERATOR}
      -D CMAKE_PREFIX_PATH=${SCRATCH}/prefix -D CMAKE_C_COMPILER=${C} -D CMAKE_BUILD_TYPE=${BUILD_TYPE})
  run(${CMAKE_COMMAND} --build ${SCRATCH}/cyclone_build)
endif()
# The host that nobody here wrote, as its page builds it.
if(FLIGHTGEAR_PROJECT)
  run(${CMAKE_COMMAND} -S ${FLIGHTGEAR_PROJECT} -B ${SCRATCH}/flightgear_build -G ${GENERATOR}
      -D CMAKE_PREFIX_PATH=${SCRATCH}/prefix -D CMAKE_CXX_COMPILER=${CXX} -D CMAKE_BUILD_TYPE=${BUILD_TYPE} -D CMAKE_CXX_FLAGS=${CXX_FLAGS})
  run(${CMAKE_COMMAND} --build ${SCRATCH}/flightgear_build)
  run(${SCRATCH}/flightgear_build/nearmesh-example-flightgear --version)
endif()
find_program(PKG_CONFIG pkg-config)
if(PKG_CONFIG)
  file(REMOVE_RECURSE ${SCRATCH}/moved)
  file(RENAME ${SCRATCH}/prefix ${SCRATCH}/moved)
  set(ENV{PKG_CONFIG_PATH} ${SCRATCH}/moved/${LIBDIR}/pkgconfig)
  execute_process(COMMAND ${PKG_CONFIG} --cflags --libs nearmesh OUTPUT_VARIABLE flags
                  OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
  separate_arguments(flags UNIX_COMMAND "${flags}")
  run(${C} -std=c11 ${C_PROJECT}/two_cubes.c ${flags} -Wl,-rpath,${SCRATCH}/moved/${LIBDIR} -o ${SCRATCH}/c_build/by_pkg_config)
  run(${SCRATCH}/c_build/by_pkg_config ${SCRATCH}/cube.spm)
endif()
