# LibTorch, from PyPI's wheel or from any other package of it, as the target
# LibTorch::LibTorch.
#
# TorchConfig.cmake of a CUDA build insists on a CUDA toolkit (nvcc). Nothing here
# compiles CUDA code, so this module looks for the headers and the libraries
# themselves. Torch_DIR, CMAKE_PREFIX_PATH and LibTorch_ROOT are respected.
#
# LibTorch_CUDA_FOUND: it is a build with CUDA, its CUDA libraries are beside it (PyPI's packages
# or LibTorch's own copies), and the runtime's headers are there, or those of a toolkit.
# LibTorch_NCCL_FOUND: and NCCL's header, with which processes on several GPUs train together.
if(Torch_DIR)
    get_filename_component(torch_hint ${Torch_DIR}/../../.. ABSOLUTE)
endif()
find_path(LibTorch_INCLUDE_DIR torch/csrc/api/include/torch/torch.h
    HINTS ${torch_hint} PATH_SUFFIXES include)
find_library(LibTorch_CPU_LIBRARY torch_cpu HINTS ${torch_hint} PATH_SUFFIXES lib)
find_library(LibTorch_C10_LIBRARY c10 HINTS ${torch_hint} PATH_SUFFIXES lib)

get_filename_component(torch_root ${LibTorch_INCLUDE_DIR}/.. REALPATH)
find_library(LibTorch_CUDA_LIBRARY torch_cuda HINTS ${torch_hint} PATH_SUFFIXES lib)
find_library(LibTorch_C10_CUDA_LIBRARY c10_cuda HINTS ${torch_hint} PATH_SUFFIXES lib)
# Forget header folders that have gone, as those of a LibTorch that scripts/setup has replaced.
foreach(folder LibTorch_CUDA_INCLUDE_DIR LibTorch_NCCL_INCLUDE_DIR)
    if(${folder} AND NOT EXISTS ${${folder}})
        unset(${folder} CACHE)
    endif()
endforeach()
file(GLOB cuda_folders ${torch_root}/../nvidia/cu*)
find_path(LibTorch_CUDA_INCLUDE_DIR cuda_runtime_api.h
    HINTS ${cuda_folders} PATHS /usr/local/cuda ENV CUDA_HOME PATH_SUFFIXES include)
file(GLOB cuda_runtime ${torch_root}/../nvidia/cu*/lib/libcudart.so.* ${torch_root}/lib/libcudart*.so*)
# The small set of scripts/setup --cpu has the runtime, as LibTorch's loader asks for it, but not cuBLAS.
file(GLOB cublas ${torch_root}/../nvidia/cu*/lib/libcublas.so.* ${torch_root}/lib/libcublas.so*)
set(LibTorch_CUDA_FOUND FALSE)
if(LibTorch_CUDA_LIBRARY AND LibTorch_C10_CUDA_LIBRARY AND LibTorch_CUDA_INCLUDE_DIR AND cuda_runtime AND cublas)
    set(LibTorch_CUDA_FOUND TRUE)
endif()
find_path(LibTorch_NCCL_INCLUDE_DIR nccl.h
    HINTS ${torch_root}/../nvidia/nccl PATHS /usr/local/cuda ENV CUDA_HOME PATH_SUFFIXES include)
set(LibTorch_NCCL_FOUND FALSE)
if(LibTorch_CUDA_FOUND AND LibTorch_NCCL_INCLUDE_DIR)
    set(LibTorch_NCCL_FOUND TRUE)
endif()

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
    # libraries, and these must not hide the system's. In quotes, as SHELL: splits at spaces.
    target_compile_options(LibTorch::LibTorch INTERFACE
        "SHELL:-idirafter \"${LibTorch_INCLUDE_DIR}\""
        "SHELL:-idirafter \"${LibTorch_INCLUDE_DIR}/torch/csrc/api/include\"")
    target_link_libraries(LibTorch::LibTorch INTERFACE
        ${LibTorch_CPU_LIBRARY} ${LibTorch_C10_LIBRARY})
    if(LibTorch_CUDA_FOUND)
        target_compile_options(LibTorch::LibTorch INTERFACE "SHELL:-idirafter \"${LibTorch_CUDA_INCLUDE_DIR}\"")
        # Always linked: a program that only moves tensors to a device names no symbol of it, and compilers that
        # link as needed would drop it.
        target_link_libraries(LibTorch::LibTorch INTERFACE
            "-Wl,--push-state,--no-as-needed,\"${LibTorch_CUDA_LIBRARY}\",--pop-state"
            ${LibTorch_C10_CUDA_LIBRARY} ${cuda_runtime})
    endif()
endif()
