# cmake --install: headers, libraries, programs; the package that find_package(cale) reads; pkg-config's files.
# policy_lite can be installed alone (cmake --install build --component policy_lite); env and policy need it, train needs
# all three.
include(CMakePackageConfigHelpers)
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/cale)
set(pkgconfig_dir ${CMAKE_INSTALL_LIBDIR}/pkgconfig)

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/caleConfig.cmake.in
    ${PROJECT_BINARY_DIR}/caleConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/caleConfigVersion.cmake COMPATIBILITY SameMinorVersion)

foreach(component policy_lite env policy train)
    get_property(libraries GLOBAL PROPERTY CALE_LIBRARIES_${component})
    if(NOT libraries)
        continue()
    endif()
    install(TARGETS ${libraries} EXPORT cale_${component}_targets
        LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${component} NAMELINK_COMPONENT ${component}
        ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT ${component})
    if(TARGET programs)
        add_dependencies(programs ${libraries})  # so that what README builds can be installed
    endif()
    install(EXPORT cale_${component}_targets NAMESPACE cale:: DESTINATION ${package_dir} COMPONENT ${component})
    get_property(headers GLOBAL PROPERTY CALE_HEADERS_${component})
    foreach(header ${headers})
        cmake_path(RELATIVE_PATH header BASE_DIRECTORY ${PROJECT_SOURCE_DIR} OUTPUT_VARIABLE folder)
        string(APPEND installed_headers "${folder}\n")
        cmake_path(GET folder PARENT_PATH folder)
        install(FILES ${header} DESTINATION ${CALE_INCLUDE_DIR}/${folder} COMPONENT ${component})
    endforeach()
    # Whichever component comes first brings what all of them need.
    install(FILES ${PROJECT_BINARY_DIR}/caleConfig.cmake ${PROJECT_BINARY_DIR}/caleConfigVersion.cmake
        ${PROJECT_SOURCE_DIR}/cmake/FindLibTorch.cmake ${PROJECT_SOURCE_DIR}/cmake/FindOpenCVModules.cmake
        DESTINATION ${package_dir} COMPONENT ${component})
    install(FILES ${PROJECT_SOURCE_DIR}/LICENSE DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME copyright
        COMPONENT ${component})
    if(component MATCHES "^(env|train)$")  # they contain ALE
        install(FILES ${PROJECT_SOURCE_DIR}/python/COPYING DESTINATION ${CMAKE_INSTALL_DOCDIR} RENAME GPL-2
            COMPONENT ${component})
    endif()
endforeach()

# What scripts/docs describes.
file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/installed_headers.txt CONTENT "${installed_headers}")

get_property(programs GLOBAL PROPERTY CALE_PROGRAMS)
if(programs)
    set_target_properties(${programs} PROPERTIES
        INSTALL_RPATH $ORIGIN/../${CMAKE_INSTALL_LIBDIR} INSTALL_RPATH_USE_LINK_PATH ON)
    install(TARGETS ${programs} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR} COMPONENT train)
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/configs ${PROJECT_SOURCE_DIR}/sweeps
        ${PROJECT_SOURCE_DIR}/data ${PROJECT_SOURCE_DIR}/policies DESTINATION ${CMAKE_INSTALL_DATADIR}/cale COMPONENT train)
    # Where scripts/web has built it.
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/build-web/page/ DESTINATION ${CMAKE_INSTALL_DATADIR}/cale/web
        COMPONENT train OPTIONAL)
endif()

# cale-NAME.pc: what a program without CMake says to the compiler and to the linker. VARIABLE names a dependency's
# place, so that pkg-config --define-variable can name another; a space in it would end an argument.
function(cale_pkg_config library component description)
    cmake_parse_arguments(PARSE_ARGV 3 arg "" "VARIABLE;CFLAGS;LIBS" "")
    string(REPLACE _ - name cale-${library})
    string(REPLACE " " "\\ " arg_VARIABLE "${arg_VARIABLE}")
    configure_file(${PROJECT_SOURCE_DIR}/cmake/cale.pc.in ${PROJECT_BINARY_DIR}/${name}.pc @ONLY)
    install(FILES ${PROJECT_BINARY_DIR}/${name}.pc DESTINATION ${pkgconfig_dir} COMPONENT ${component})
endfunction()
cmake_path(RELATIVE_PATH CMAKE_INSTALL_PREFIX BASE_DIRECTORY ${CMAKE_INSTALL_PREFIX}/${pkgconfig_dir}
    OUTPUT_VARIABLE prefix_from_pkgconfig)

cale_pkg_config(policy_lite policy_lite "Trained policies without LibTorch (MIT)" LIBS "-lcale_policy_lite -lcale_frames")
cale_pkg_config(policy_c policy_lite "Trained policies for C and whatever can call C (MIT)"
    CFLAGS "-I\${prefix}/${CALE_INCLUDE_DIR} -I\${prefix}/${CALE_INCLUDE_DIR}/policy" LIBS -lcale_policy_c)
if(TARGET cale_env AND BUILD_SHARED_LIBS)
    cale_pkg_config(env env "The Continuous Arcade Learning Environment (contains ALE: GPL-2.0)"
        LIBS "-lcale_env -lcale_frames")
elseif(TARGET cale_env)
    get_target_property(ale_library ale::ale-lib LOCATION)
    cale_pkg_config(env env "The Continuous Arcade Learning Environment (links ALE: GPL-2.0)"
        VARIABLE ale=${ale_library} LIBS "-lcale_env -lcale_frames \${ale} -lz -pthread")
endif()
if(TARGET cale_policy)
    cmake_path(GET LibTorch_INCLUDE_DIR PARENT_PATH libtorch)
    cmake_path(GET LibTorch_CPU_LIBRARY PARENT_PATH libtorch_libraries)
    string(REPLACE ${libtorch} "\${libtorch}" libtorch_libraries ${libtorch_libraries})
    set(libtorch_cuda "")
    if(LibTorch_CUDA_FOUND)
        set(libtorch_cuda " -Wl,--push-state,--no-as-needed,-ltorch_cuda,--pop-state")  # as FindLibTorch.cmake
    endif()
    cale_pkg_config(policy policy "Trained policies with LibTorch (MIT)" VARIABLE libtorch=${libtorch}
        CFLAGS "-idirafter \${libtorch}/include -idirafter \${libtorch}/include/torch/csrc/api/include"
        LIBS "-lcale_policy -lcale_networks -lcale_policy_lite -lcale_frames -L${libtorch_libraries} \
-Wl,-rpath,${libtorch_libraries} -ltorch_cpu -lc10${libtorch_cuda}")
endif()
