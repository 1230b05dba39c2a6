# What run.cmake and package.cmake are made of.
cmake_policy(VERSION 3.25)

# Runs a command and stores what it prints in `output`.
function(run)
    execute_process(COMMAND ${ARGN} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
    if(NOT status EQUAL 0)
        list(JOIN ARGN " " text)
        message(FATAL_ERROR "failed: ${text}\n${output}")
    endif()
    set(output "${output}" PARENT_SCOPE)
endfunction()

find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM)
    set(ENV{CMAKE_CXX_COMPILER_LAUNCHER} ${CCACHE_PROGRAM})
endif()
set(configure ${CMAKE_COMMAND} -G Ninja -DCMAKE_CXX_FLAGS=${CXX_FLAGS} -DCMAKE_C_FLAGS=${CXX_FLAGS})

# Builds a stranger's project against what is installed in WORK_DIR/prefix.
function(build project prefix folder)
    run(${configure} -S ${project} -B ${WORK_DIR}/${folder} -DCMAKE_PREFIX_PATH=${WORK_DIR}/${prefix})
    run(${CMAKE_COMMAND} --build ${WORK_DIR}/${folder})
endfunction()
