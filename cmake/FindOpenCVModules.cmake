# The OpenCV modules that this project uses, as the targets opencv_core, ...
#
# Debian keeps OpenCVConfig.cmake in libopencv-dev, which drags in every module
# and their 200 packages. Its libopencv-<module>-dev packages have all that is
# needed but that file, so where it is missing the modules are looked up one by one.
find_package(OpenCV CONFIG QUIET COMPONENTS ${OpenCVModules_FIND_COMPONENTS})
if(NOT OpenCV_FOUND)
    find_path(OpenCVModules_INCLUDE_DIR opencv2/core.hpp PATH_SUFFIXES opencv4)
    foreach(module ${OpenCVModules_FIND_COMPONENTS})
        find_library(OpenCVModules_${module}_LIBRARY opencv_${module})
        list(APPEND required OpenCVModules_${module}_LIBRARY)
        if(OpenCVModules_${module}_LIBRARY AND OpenCVModules_INCLUDE_DIR AND NOT TARGET opencv_${module})
            add_library(opencv_${module} UNKNOWN IMPORTED)
            set_target_properties(opencv_${module} PROPERTIES
                IMPORTED_LOCATION ${OpenCVModules_${module}_LIBRARY}
                INTERFACE_INCLUDE_DIRECTORIES ${OpenCVModules_INCLUDE_DIR})
        endif()
    endforeach()
    include(FindPackageHandleStandardArgs)
    find_package_handle_standard_args(OpenCVModules REQUIRED_VARS OpenCVModules_INCLUDE_DIR ${required})
else()
    set(OpenCVModules_FOUND TRUE)
endif()
