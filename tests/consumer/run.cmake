# Installs the build into an empty folder and builds the stranger's project against it.
# cmake -DBUILD_DIR=... -DSOURCE_DIR=... -DWORK_DIR=... -DCXX_FLAGS=... -P run.cmake
file(REMOVE_RECURSE ${WORK_DIR})
foreach(command
        "${CMAKE_COMMAND};--install;${BUILD_DIR};--prefix;${WORK_DIR}/installed"
        "${CMAKE_COMMAND};-S;${SOURCE_DIR}/tests/consumer;-B;${WORK_DIR}/build;-DCMAKE_PREFIX_PATH=${WORK_DIR}/installed;-DCMAKE_CXX_FLAGS=${CXX_FLAGS}"
        "${CMAKE_COMMAND};--build;${WORK_DIR}/build"
        "${WORK_DIR}/build/random_play")
    execute_process(COMMAND ${command} RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
    if(NOT status EQUAL 0)
        list(JOIN command " " text)
        message(FATAL_ERROR "failed: ${text}\n${output}")
    endif()
endforeach()
message(STATUS "random_play: ${output}")
