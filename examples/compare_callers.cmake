# Programs in C, C++ and Python play the same "game" with the same policy: they must decide the same.
set(command_C ${C_CALLER})
set(command_CXX ${CXX_CALLER})
set(command_Python ${PYTHON} ${PYTHON_CALLER} ${LIBRARY})
foreach(language C CXX Python)
    execute_process(COMMAND ${command_${language}} ${POLICY} RESULT_VARIABLE status OUTPUT_VARIABLE output_${language}
        ERROR_VARIABLE errors)
    if(NOT status EQUAL 0)
        message(FATAL_ERROR "the program in ${language} failed: ${status}\n${errors}")
    endif()
    if(NOT output_C MATCHES "^0 [0-9]+\n4 [0-9]+\n" OR NOT output_${language} STREQUAL output_C)
        message(FATAL_ERROR "the program in C printed\n${output_C}\nand that in ${language}\n${output_${language}}")
    endif()
endforeach()
