# cpack: a .deb and a .tgz of what cmake --install installs.
set(CPACK_GENERATOR DEB TGZ)
set(CPACK_PACKAGE_NAME cale)
set(CPACK_PACKAGE_VENDOR "The cale authors")
set(CPACK_PACKAGE_CONTACT "The cale authors")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY ${PROJECT_DESCRIPTION})
set(CPACK_PACKAGE_DESCRIPTION "Headers, libraries and programs of cale. cale::policy_lite and cale::policy, which load \
and run a trained policy, are under the MIT licence. What contains the Arcade Learning Environment (cale::env, \
cale::train and the programs) is distributed under ALE's licence, the GPL-2.0.")
set(CPACK_RESOURCE_FILE_LICENSE ${PROJECT_SOURCE_DIR}/LICENSE)
set(CPACK_STRIP_FILES ON)
set(CPACK_MONOLITHIC_INSTALL ON)  # one package, not one per component
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
include(CPack)
