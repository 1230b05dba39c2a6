# Installs the build into an empty folder, then builds strangers' projects against it: examples and consumers that lie
# elsewhere, with CMake and with pkg-config, and one that has the sources as a subdirectory.
# cmake -DBUILD_DIR=... -DSOURCE_DIR=... -DWORK_DIR=... -DCXX_FLAGS=... -DDEPS_DIR=... -DTRAIN=ON|OFF
# -DPOLICY=... -P run.cmake
cmake_policy(VERSION 3.25)

include(${CMAKE_CURRENT_LIST_DIR}/steps.cmake)

file(REMOVE_RECURSE ${WORK_DIR})
run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${WORK_DIR}/installed)
run(${CMAKE_COMMAND} --install ${BUILD_DIR} --prefix ${WORK_DIR}/only_lite --component policy_lite)
# Nothing of this tree may be within a stranger's reach.
file(COPY ${SOURCE_DIR}/tests/consumer ${SOURCE_DIR}/examples DESTINATION ${WORK_DIR}/strangers)
set(strangers ${WORK_DIR}/strangers)

# What is installed does not know where it was built. It may know its dependencies, which can lie in this tree.
function(refuse_own_folders text what)
    foreach(folder ${BUILD_DIR} ${SOURCE_DIR})
        string(FIND "${text}" "${folder}" place)
        if(NOT place EQUAL -1)
            message(FATAL_ERROR "${what} ${folder}")
        endif()
    endforeach()
endfunction()
file(GLOB_RECURSE texts ${WORK_DIR}/installed/*.cmake ${WORK_DIR}/installed/*.pc)
foreach(text ${texts})
    file(READ ${text} content)
    string(REPLACE ${DEPS_DIR} "" content "${content}")
    string(REPLACE ${WORK_DIR} "" content "${content}")
    refuse_own_folders("${content}" "${text} names")
endforeach()
file(GLOB binaries ${WORK_DIR}/installed/bin/* ${WORK_DIR}/installed/lib*/*.so ${WORK_DIR}/installed/lib*/*/*.so)
foreach(binary ${binaries})
    run(readelf -d ${binary})
    string(REPLACE ${DEPS_DIR} "" output "${output}")
    string(REGEX MATCHALL "R(UN)?PATH[^\n]*" searched "${output}")
    refuse_own_folders("${searched}" "${binary} looks for libraries in")
endforeach()

# The C interface is all that its library shows.
file(GLOB c_library ${WORK_DIR}/installed/lib*/libcale_policy_c.so ${WORK_DIR}/installed/lib*/*/libcale_policy_c.so)
run(nm -D --defined-only ${c_library})
string(REGEX REPLACE "[0-9a-f]+ T (cale_policy_|cale_session_)[a-z_]+\n" "" others "${output}")
if(NOT output MATCHES " T cale_policy_load\n" OR NOT others STREQUAL "")
    message(FATAL_ERROR "${c_library} shows\n${output}")
endif()

# Each header includes what it needs, from its own component.
file(GLOB include ${WORK_DIR}/only_lite/include/cale-*)
file(GLOB_RECURSE headers RELATIVE ${include} ${include}/*.h)
foreach(header ${headers})
    run(c++ -std=c++20 -fsyntax-only -I${include} -include ${header} -x c++ /dev/null)
endforeach()

# With CMake.
build(${strangers}/consumer installed consumer)
run(${WORK_DIR}/consumer/random_play)
message(STATUS "random_play: ${output}")
run(${WORK_DIR}/consumer/lite_play ${POLICY})
build(${strangers}/examples/c_caller installed c_caller)
build(${strangers}/examples/embed_policy_lite installed embed_policy_lite)
if(TRAIN)
    run(${WORK_DIR}/c_caller/c_caller ${POLICY})
    run(${WORK_DIR}/embed_policy_lite/embed_policy_lite ${POLICY})
    build(${strangers}/examples/embed_policy installed embed_policy)
    run(${WORK_DIR}/embed_policy/embed_policy ${POLICY} 100)
    message(STATUS "embed_policy: ${output}")
    build(${strangers}/examples/custom_environment installed custom_environment)
    run(${WORK_DIR}/installed/bin/cale --version)
endif()

# With pkg-config.
file(GLOB pkg_config_path ${WORK_DIR}/installed/lib*/pkgconfig ${WORK_DIR}/installed/lib*/*/pkgconfig)
set(ENV{PKG_CONFIG_PATH} ${pkg_config_path})
function(build_with_pkg_config package output_file)
    execute_process(COMMAND pkg-config --cflags --libs ${package} OUTPUT_VARIABLE flags COMMAND_ERROR_IS_FATAL ANY)
    separate_arguments(flags UNIX_COMMAND "${flags} ${CXX_FLAGS}")
    run(${ARGN} -o ${WORK_DIR}/${output_file} ${flags} -Wl,-rpath,${WORK_DIR}/installed/lib)
endfunction()
build_with_pkg_config(cale-env random_play c++ -std=c++20 ${strangers}/consumer/random_play.cpp)
run(${WORK_DIR}/random_play)
build_with_pkg_config(cale-policy-lite lite_play c++ -std=c++20 ${strangers}/consumer/lite_play.cpp)
run(${WORK_DIR}/lite_play ${POLICY})
build_with_pkg_config(cale-policy-c c_player cc ${strangers}/examples/c_caller/play.c)
if(TRAIN)
    run(${WORK_DIR}/c_player ${POLICY})
    file(GLOB_RECURSE object ${WORK_DIR}/embed_policy/*main.cpp.o)
    build_with_pkg_config("cale-policy;cale-env" policy_player c++ ${object})
    run(${WORK_DIR}/policy_player ${POLICY} 100)
endif()

# What is not there is said in one sentence.
function(expect_refusal sentence prefix)
    execute_process(COMMAND ${CMAKE_COMMAND} -S ${strangers}/consumer/finds -B ${WORK_DIR}/finds --fresh
        -DCMAKE_PREFIX_PATH=${WORK_DIR}/${prefix} ${ARGN}
        RESULT_VARIABLE status OUTPUT_VARIABLE output ERROR_VARIABLE output)
    string(REGEX REPLACE "[ \n]+" " " output "${output}")
    if(status EQUAL 0 OR NOT output MATCHES "${sentence}")
        message(FATAL_ERROR "looking for ${ARGN} should have said: ${sentence}\n${output}")
    endif()
endfunction()
expect_refusal("cale has no component 'tools': its components are policy_lite, env, policy, train"
    installed -DCOMPONENTS=tools)
expect_refusal("the component 'env' is not part of this installation of cale, which has policy_lite"
    only_lite -DCOMPONENTS=env)
if(TRAIN)
    expect_refusal("the component 'policy' of cale needs LibTorch, which was not found"
        installed -DCOMPONENTS=policy -DCMAKE_DISABLE_FIND_PACKAGE_LibTorch=ON)
endif()
run(${CMAKE_COMMAND} -S ${strangers}/consumer/finds -B ${WORK_DIR}/finds --fresh
    -DCMAKE_PREFIX_PATH=${WORK_DIR}/only_lite -DCOMPONENTS=policy_lite)

# As a subdirectory.
run(${configure} -S ${strangers}/consumer/fetched -B ${WORK_DIR}/fetched -DCALE_SOURCE_DIR=${SOURCE_DIR})
run(${CMAKE_COMMAND} --build ${WORK_DIR}/fetched --target random_play)
run(${WORK_DIR}/fetched/random_play)
