# Writes a header with the commit of the sources, but only where it has changed, so that nothing else is compiled
# again. Run by every build as: cmake -DSOURCE_DIR=... -DHEADER=... -P write_commit.cmake
cmake_policy(VERSION 3.25)
set(commit unknown)
find_program(GIT git)
if(GIT)
    # Root in a container does not own the checkout that it is given.
    list(APPEND GIT -c safe.directory=*)
    # What lies inside somebody else's checkout, unpacked, has no commit.
    execute_process(COMMAND ${GIT} rev-parse --show-prefix
        WORKING_DIRECTORY ${SOURCE_DIR} OUTPUT_VARIABLE prefix OUTPUT_STRIP_TRAILING_WHITESPACE
        RESULT_VARIABLE failure ERROR_QUIET)
    if(failure EQUAL 0 AND prefix STREQUAL "")
        execute_process(COMMAND ${GIT} --no-optional-locks describe --always --abbrev=12 --dirty --exclude=*
            WORKING_DIRECTORY ${SOURCE_DIR} OUTPUT_VARIABLE described OUTPUT_STRIP_TRAILING_WHITESPACE
            RESULT_VARIABLE failure ERROR_QUIET)
        if(failure EQUAL 0 AND described)
            set(commit ${described})
        endif()
    endif()
endif()
set(text "#define CALE_COMMIT \"${commit}\"\n")
if(EXISTS ${HEADER})
    file(READ ${HEADER} before)
endif()
if(NOT before STREQUAL text)
    file(WRITE ${HEADER} "${text}")
endif()
