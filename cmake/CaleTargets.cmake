# How every library, program and test of this project is compiled.
find_program(CCACHE_PROGRAM ccache)
if(CCACHE_PROGRAM AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
    # Precompiled headers: ccache asks for these two to be waived.
    set(CMAKE_CXX_COMPILER_LAUNCHER
        ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE_PROGRAM})
endif()
find_program(MOLD_PROGRAM mold)

add_library(cale_options INTERFACE)
target_compile_options(cale_options INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion
    $<$<BOOL:${CALE_WARNINGS_AS_ERRORS}>:-Werror>
    # OpenCV's area resize rounds after every multiplication; a fused multiply-add would not.
    -ffp-contract=off)
if(MOLD_PROGRAM)
    target_link_options(cale_options INTERFACE -fuse-ld=mold)
endif()
if(CALE_SANITIZE)
    target_compile_options(cale_options INTERFACE -fsanitize=${CALE_SANITIZE} -fno-omit-frame-pointer)
    target_link_options(cale_options INTERFACE -fsanitize=${CALE_SANITIZE})
endif()

# One library per folder: cale_library(replay TORCH DEPENDS cale::env)
# makes cale_replay, known as cale::replay, from the folder's sources.
# TORCH: includes LibTorch's headers, so shares the precompiled header.
# SOURCES: where the library is not all of the folder's *.cpp.
# HEADERS: what a program outside may include. What is not listed is not installed.
# COMPONENT: what a user of the installed package asks for to get it: env, policy, policy_lite or, if nothing is
# said, train.
# A shared library shows what is in namespace cale; ALE and whatever else is in it stay inside.
function(cale_library name)
    cmake_parse_arguments(PARSE_ARGV 1 arg "TORCH" "COMPONENT" "SOURCES;HEADERS;DEPENDS;PRIVATE_DEPENDS")
    # What is header-only leaves nothing that a consumer would have to link.
    list(TRANSFORM arg_PRIVATE_DEPENDS REPLACE "^(CLI11::CLI11|nlohmann_json::nlohmann_json)$"
        "$<BUILD_INTERFACE:\\1>")
    if(NOT arg_SOURCES)
        file(GLOB arg_SOURCES CONFIGURE_DEPENDS ${CMAKE_CURRENT_SOURCE_DIR}/*.cpp)
    endif()
    add_library(cale_${name} ${arg_SOURCES})
    add_library(cale::${name} ALIAS cale_${name})
    set_target_properties(cale_${name} PROPERTIES EXPORT_NAME ${name})
    target_compile_features(cale_${name} PUBLIC cxx_std_20)
    target_include_directories(cale_${name} PUBLIC
        $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}>
        $<INSTALL_INTERFACE:${CALE_INCLUDE_DIR}>)
    target_link_libraries(cale_${name}
        PUBLIC ${arg_DEPENDS}
        PRIVATE ${arg_PRIVATE_DEPENDS} $<BUILD_INTERFACE:cale_options>)
    if(arg_TORCH)
        target_link_libraries(cale_${name} PUBLIC LibTorch::LibTorch)
        cale_use_torch_headers(cale_${name})
    endif()
    if(BUILD_SHARED_LIBS)
        set(map ${PROJECT_SOURCE_DIR}/cmake/interface.map)
        target_link_options(cale_${name} PRIVATE -Wl,--version-script=${map})
        set_target_properties(cale_${name} PROPERTIES LINK_DEPENDS ${map})
    endif()
    if(NOT arg_COMPONENT)
        set(arg_COMPONENT train)
    endif()
    cale_install_library(cale_${name} ${arg_COMPONENT} ${arg_HEADERS})
endfunction()

# Compiles a message description into a library of this folder.
function(cale_protobuf name description)
    protobuf_generate_cpp(sources headers ${description})
    target_sources(cale_${name} PRIVATE ${sources} ${headers})
    target_include_directories(cale_${name} SYSTEM PRIVATE $<BUILD_INTERFACE:${CMAKE_CURRENT_BINARY_DIR}>)
    # What protoc writes is not held to this project's warnings.
    set_source_files_properties(${sources} PROPERTIES COMPILE_OPTIONS -w SKIP_PRECOMPILE_HEADERS ON)
endfunction()

# Makes a library and its headers part of a component of the package.
function(cale_install_library target component)
    get_target_property(type ${target} TYPE)
    if(type STREQUAL SHARED_LIBRARY)
        set_target_properties(${target} PROPERTIES
            VERSION ${PROJECT_VERSION} SOVERSION ${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR}
            INSTALL_RPATH $ORIGIN INSTALL_RPATH_USE_LINK_PATH ON)
    endif()
    set_property(GLOBAL APPEND PROPERTY CALE_LIBRARIES_${component} ${target})
    set(headers ${ARGN})
    list(TRANSFORM headers PREPEND ${CMAKE_CURRENT_SOURCE_DIR}/)
    set_property(GLOBAL APPEND PROPERTY CALE_HEADERS_${component} ${headers})
endfunction()

# What most files include of LibTorch is compiled once. Not <torch/torch.h>: GCC instantiates the templates that its
# modules use again in every file, precompiled or not, at 4 s each.
set(CALE_TORCH_HEADERS <torch/types.h> <torch/utils.h> <torch/nn/module.h> <torch/nn/pimpl.h>)
# Further arguments: the only sources of the target that see LibTorch; without its headers the others compile faster.
function(cale_use_torch_headers target)
    if(NOT TARGET cale_torch_headers)
        cale_precompile(cale_torch_headers LIBRARIES LibTorch::LibTorch cale_options HEADERS ${CALE_TORCH_HEADERS})
    endif()
    cale_reuse_precompiled(${target} cale_torch_headers)
    if(ARGN)
        get_target_property(others ${target} SOURCES)
        list(JOIN ARGN "|" seeing)
        list(FILTER others EXCLUDE REGEX "(^|/)(${seeing})$")
        set_source_files_properties(${others} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
    endif()
endfunction()

# A target that carries a precompiled header and nothing else.
function(cale_precompile name)
    cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "LIBRARIES;HEADERS")
    file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/${name}.cpp CONTENT "// Carries a precompiled header.\n")
    add_library(${name} OBJECT ${PROJECT_BINARY_DIR}/${name}.cpp)
    target_compile_features(${name} PUBLIC cxx_std_20)
    target_link_libraries(${name} PRIVATE ${arg_LIBRARIES})
    target_precompile_headers(${name} PRIVATE ${arg_HEADERS})
endfunction()

function(cale_reuse_precompiled target carrier)
    # The header is compiled with -fPIC; the -fPIE of an executable would not match it.
    get_target_property(type ${target} TYPE)
    if(type STREQUAL EXECUTABLE)
        set_target_properties(${target} PROPERTIES POSITION_INDEPENDENT_CODE OFF)
        target_compile_options(${target} PRIVATE -fPIC)
    endif()
    set_target_properties(${target} PROPERTIES CXX_EXTENSIONS OFF)  # as the header, in a stranger's project too
    target_precompile_headers(${target} REUSE_FROM ${carrier})
endfunction()

# build/bin/train_NAME of this folder's train_NAME.cpp and further sources.
function(cale_train_program agent)
    add_executable(train_${agent} train_${agent}.cpp ${ARGN})
    target_include_directories(train_${agent} PRIVATE ${PROJECT_SOURCE_DIR})
    target_link_libraries(train_${agent} PRIVATE cale::train cale::agents cale_options)
    cale_use_torch_headers(train_${agent})
endfunction()
