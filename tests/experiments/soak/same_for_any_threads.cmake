# Runs a slice of the soak with one thread and with two: neither may find a false answer, and both must print the same.
foreach(threads 1 2)
  execute_process(COMMAND ${PROGRAM} --poses 1600 --seed 20 --threads ${threads}
                  OUTPUT_VARIABLE table_${threads} RESULT_VARIABLE result)
  if(NOT result EQUAL 0)
    message(FATAL_ERROR "${threads} threads: exit ${result}\n${table_${threads}}")
  endif()
endforeach()
if(NOT table_1 STREQUAL table_2)
  message(FATAL_ERROR "One thread:\n${table_1}\nTwo threads:\n${table_2}")
endif()
message("${table_1}")
