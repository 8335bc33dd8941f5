# What CMake's strip leaves, and Debian's takes: archives' debug sections, and notes that name the compiler.
file(GLOB_RECURSE archives ${CPACK_TEMPORARY_DIRECTORY}/*.a)
foreach(archive ${archives})
  execute_process(COMMAND strip --strip-debug --enable-deterministic-archives --remove-section=.comment
                          --remove-section=.note ${archive} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
file(GLOB programs ${CPACK_TEMPORARY_DIRECTORY}/*/usr/bin/* ${CPACK_TEMPORARY_DIRECTORY}/usr/bin/*)
file(GLOB_RECURSE libraries ${CPACK_TEMPORARY_DIRECTORY}/*.so ${CPACK_TEMPORARY_DIRECTORY}/*.so.*)
foreach(program ${programs} ${libraries})
  if(IS_SYMLINK ${program})
    continue()
  endif()
  execute_process(COMMAND strip --remove-section=.comment --remove-section=.note ${program} COMMAND_ERROR_IS_FATAL ANY)
endforeach()
