# LibTorch, from PyPI's wheel or from any other package of it, as the target
# LibTorch::LibTorch.
#
# TorchConfig.cmake of a CUDA build insists on a CUDA toolkit (nvcc). Nothing here
# compiles CUDA code, so this module looks for the headers and the libraries
# themselves. Torch_DIR, CMAKE_PREFIX_PATH and LibTorch_ROOT are respected.
if(Torch_DIR)
    get_filename_component(torch_hint ${Torch_DIR}/../../.. ABSOLUTE)
endif()
find_path(LibTorch_INCLUDE_DIR torch/csrc/api/include/torch/torch.h
    HINTS ${torch_hint} PATH_SUFFIXES include)
find_library(LibTorch_CPU_LIBRARY torch_cpu HINTS ${torch_hint} PATH_SUFFIXES lib)
find_library(LibTorch_C10_LIBRARY c10 HINTS ${torch_hint} PATH_SUFFIXES lib)

if(LibTorch_INCLUDE_DIR AND EXISTS ${LibTorch_INCLUDE_DIR}/torch/headeronly/version.h)
    file(STRINGS ${LibTorch_INCLUDE_DIR}/torch/headeronly/version.h version_lines
        REGEX "#define TORCH_VERSION_(MAJOR|MINOR|PATCH) ")
    string(REGEX REPLACE "[^0-9]+([0-9]+)[^0-9]+([0-9]+)[^0-9]+([0-9]+).*" "\\1.\\2.\\3"
        LibTorch_VERSION "${version_lines}")
endif()

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(LibTorch
    REQUIRED_VARS LibTorch_CPU_LIBRARY LibTorch_C10_LIBRARY LibTorch_INCLUDE_DIR
    VERSION_VAR LibTorch_VERSION
    REASON_FAILURE_MESSAGE "run scripts/setup, or point CMAKE_PREFIX_PATH at your LibTorch")

if(LibTorch_FOUND AND NOT TARGET LibTorch::LibTorch)
    add_library(LibTorch::LibTorch INTERFACE IMPORTED)
    # Searched last: the wheel also carries its own fmt and protobuf headers, without their
    # libraries, and these must not hide the system's.
    target_compile_options(LibTorch::LibTorch INTERFACE
        "SHELL:-idirafter ${LibTorch_INCLUDE_DIR}"
        "SHELL:-idirafter ${LibTorch_INCLUDE_DIR}/torch/csrc/api/include")
    target_link_libraries(LibTorch::LibTorch INTERFACE
        ${LibTorch_CPU_LIBRARY} ${LibTorch_C10_LIBRARY})
endif()
