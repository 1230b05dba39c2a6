# Finds what scripts/setup installed, and before that whatever the user points at
# with CMAKE_PREFIX_PATH, ale_DIR or Torch_DIR.
if(DEFINED ENV{CALE_DEPS_DIR})
    set(default_deps $ENV{CALE_DEPS_DIR})
elseif(DEFINED ENV{XDG_CACHE_HOME})
    set(default_deps $ENV{XDG_CACHE_HOME}/cale)
else()
    set(default_deps $ENV{HOME}/.cache/cale)
endif()
set(CALE_DEPS_DIR ${default_deps} CACHE PATH "Where scripts/setup put ALE and LibTorch")

# A program that has this project as a subdirectory links what is found here.
set(CMAKE_FIND_PACKAGE_TARGETS_GLOBAL ON)
if(CALE_BUILD_ENV)
    list(APPEND CMAKE_PREFIX_PATH ${CALE_DEPS_DIR}/ale-0.12.1)
    find_package(ZLIB REQUIRED)
    find_package(Threads REQUIRED)
    find_package(ale 0.12 CONFIG)
    if(NOT ale_FOUND)
        message(FATAL_ERROR "ALE 0.12.1, the emulator's C++ library, was not found in ${CALE_DEPS_DIR}. "
            "Run scripts/setup, or point CMAKE_PREFIX_PATH at an installation of your own.")
    endif()
endif()

if(CALE_BUILD_POLICY)
    list(APPEND CMAKE_PREFIX_PATH ${CALE_DEPS_DIR}/libtorch)
    find_package(LibTorch REQUIRED)
endif()

if(CALE_BUILD_TRAIN)
    find_package(OpenCVModules REQUIRED COMPONENTS core imgproc imgcodecs videoio)
    find_package(yaml-cpp REQUIRED)
    find_package(fmt REQUIRED)
    find_package(CLI11 REQUIRED)
    find_package(nlohmann_json REQUIRED)
    # LibTorch brings the headers and the compiler of an old protobuf, without its library.
    cmake_path(GET LibTorch_INCLUDE_DIR PARENT_PATH CMAKE_IGNORE_PREFIX_PATH)
    list(APPEND CMAKE_IGNORE_PREFIX_PATH ${CALE_DEPS_DIR}/libtorch)
    find_package(Protobuf REQUIRED)
    unset(CMAKE_IGNORE_PREFIX_PATH)
    find_library(ZSTD_LIBRARY zstd REQUIRED)
    find_path(ZSTD_INCLUDE_DIR zstd.h REQUIRED)
endif()
