# cmake --install: headers, libraries, programs, and the package that find_package(cale) reads.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(include_dir ${CMAKE_INSTALL_INCLUDEDIR}/cale-${PROJECT_VERSION_MAJOR}.${PROJECT_VERSION_MINOR})
set(package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/cale)

get_property(libraries GLOBAL PROPERTY CALE_LIBRARIES)
get_property(header_folders GLOBAL PROPERTY CALE_HEADER_FOLDERS)
install(TARGETS ${libraries} EXPORT cale_targets
    LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR} ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR})
foreach(folder ${header_folders})
    install(DIRECTORY ${folder} DESTINATION ${include_dir} FILES_MATCHING PATTERN *.h)
endforeach()
get_property(programs GLOBAL PROPERTY CALE_PROGRAMS)
if(programs)
    install(TARGETS ${programs} RUNTIME DESTINATION ${CMAKE_INSTALL_BINDIR})
endif()
if(CALE_BUILD_TRAIN)
    install(DIRECTORY ${PROJECT_SOURCE_DIR}/configs DESTINATION ${CMAKE_INSTALL_DATADIR}/cale)
endif()

install(EXPORT cale_targets NAMESPACE cale:: DESTINATION ${package_dir})
configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/caleConfig.cmake.in
    ${PROJECT_BINARY_DIR}/caleConfig.cmake INSTALL_DESTINATION ${package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/caleConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/caleConfig.cmake ${PROJECT_BINARY_DIR}/caleConfigVersion.cmake
    ${PROJECT_SOURCE_DIR}/cmake/FindLibTorch.cmake ${PROJECT_SOURCE_DIR}/cmake/FindOpenCVModules.cmake
    DESTINATION ${package_dir})
