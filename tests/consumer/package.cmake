# Makes the .deb and the .tgz of all that needs no LibTorch, as shared libraries, removes the build, unpacks both
# packages and builds a stranger's project against each.
# cmake -DSOURCE_DIR=... -DWORK_DIR=... -P package.cmake
include(${CMAKE_CURRENT_LIST_DIR}/steps.cmake)

file(REMOVE_RECURSE ${WORK_DIR})
file(COPY ${SOURCE_DIR}/tests/consumer ${SOURCE_DIR}/examples/c_caller DESTINATION ${WORK_DIR}/strangers)
run(${configure} -S ${SOURCE_DIR} -B ${WORK_DIR}/build -DCMAKE_BUILD_TYPE=Release -DBUILD_SHARED_LIBS=ON
    -DCALE_BUILD_TRAIN=OFF -DCALE_BUILD_TESTS=OFF -DCALE_BUILD_EXAMPLES=OFF -DCALE_BUILD_BENCHMARKS=OFF)
run(${CMAKE_COMMAND} --build ${WORK_DIR}/build)
run(${CMAKE_COMMAND} -E chdir ${WORK_DIR}/build cpack -B ${WORK_DIR})
file(REMOVE_RECURSE ${WORK_DIR}/build)

file(GLOB deb ${WORK_DIR}/*.deb)
file(GLOB tgz ${WORK_DIR}/*.tar.gz)
run(dpkg-deb -f ${deb} Package Version Depends)
if(NOT output MATCHES "Package: cale\n" OR NOT output MATCHES "Depends:[^\n]*libstdc\\+\\+6")
    message(FATAL_ERROR "${deb} says of itself\n${output}")
endif()
run(dpkg-deb -x ${deb} ${WORK_DIR}/deb)
file(READ ${WORK_DIR}/deb/usr/share/doc/cale/copyright copyright)
if(NOT copyright MATCHES "MIT License.*GNU General Public License, version 2")
    message(FATAL_ERROR "the package does not state its licences:\n${copyright}")
endif()
file(READ ${WORK_DIR}/deb/usr/share/doc/cale/GPL-2 gpl)
if(NOT gpl MATCHES "GNU GENERAL PUBLIC LICENSE[\n ]*Version 2, June 1991")
    message(FATAL_ERROR "the package has ALE without its licence")
endif()
file(ARCHIVE_EXTRACT INPUT ${tgz} DESTINATION ${WORK_DIR}/tgz)
file(GLOB unpacked RELATIVE ${WORK_DIR} ${WORK_DIR}/tgz/*)

foreach(prefix deb/usr ${unpacked})
    string(REPLACE / _ folder from_${prefix})
    build(${WORK_DIR}/strangers/consumer ${prefix} ${folder})
    run(${WORK_DIR}/${folder}/random_play)
    message(STATUS "${prefix}: ${output}")
    run(${WORK_DIR}/${folder}/lite_play)
    build(${WORK_DIR}/strangers/c_caller ${prefix} ${folder}_c)
    run(${WORK_DIR}/${folder}_c/c_caller --help)  # starts if every library finds those it needs itself
endforeach()

# What the library shows is what it promises: nothing of the emulator's. Of function templates nm prints the type that
# they return, too.
run(nm -DC --defined-only ${WORK_DIR}/deb/usr/lib/libcale_env.so)
string(REGEX REPLACE "\n[0-9a-f]+ [A-Za-z] ((typeinfo|typeinfo name|vtable) for |[^\n(]* )?cale::[^\n]*" "" others "\n${output}")
if(NOT output MATCHES "cale::Env::step" OR NOT others STREQUAL "\n")
    message(FATAL_ERROR "libcale_env.so shows, beside cale's,\n${others}")
endif()
