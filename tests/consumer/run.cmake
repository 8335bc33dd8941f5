# Called by the test "consumer": install, configure, build, run; each must succeed.
function(run)
  execute_process(COMMAND ${ARGN} COMMAND_ECHO STDOUT COMMAND_ERROR_IS_FATAL ANY)
endfunction()

# From nothing each time, so that no file of an earlier install can help.
file(REMOVE_RECURSE ${SCRATCH}/prefix ${SCRATCH}/build)
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
