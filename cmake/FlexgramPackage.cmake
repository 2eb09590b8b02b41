# The Debian package of scripts/package: the component `debian`, of what runs.
set(from ${CMAKE_BINARY_DIR}/share)
install(TARGETS flexgram RUNTIME DESTINATION bin COMPONENT debian EXCLUDE_FROM_ALL)
if(FLEXGRAM_PYTHON_PACKAGES)
  install(DIRECTORY python/flexgram DESTINATION ${FLEXGRAM_PYTHON_PACKAGES} COMPONENT debian EXCLUDE_FROM_ALL
          PATTERN "__pycache__" EXCLUDE)
  install(TARGETS flexgram_python LIBRARY DESTINATION ${FLEXGRAM_PYTHON_PACKAGES} COMPONENT debian EXCLUDE_FROM_ALL)
endif()
install(FILES ${from}/flexgram.bash DESTINATION share/bash-completion/completions RENAME flexgram
        COMPONENT debian EXCLUDE_FROM_ALL)
install(FILES ${from}/flexgram.zsh DESTINATION share/zsh/vendor-completions RENAME _flexgram
        COMPONENT debian EXCLUDE_FROM_ALL)
install(FILES ${from}/flexgram.1 DESTINATION share/man/man1 COMPONENT debian EXCLUDE_FROM_ALL)
install(FILES LICENSE RENAME copyright DESTINATION share/doc/flexgram COMPONENT debian EXCLUDE_FROM_ALL)
install(FILES meshes/rack.msh meshes/rack.yaml DESTINATION share/doc/flexgram/examples
        COMPONENT debian EXCLUDE_FROM_ALL)

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME flexgram)
set(CPACK_PACKAGE_VENDOR "the flexgram maintainers")
set(CPACK_PACKAGE_CONTACT "the flexgram maintainers <maintainers@flexgram.invalid>")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL debian)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_COMPONENTS_GROUPING ONE_PER_GROUP)
set(CPACK_DEBIAN_DEBIAN_PACKAGE_NAME flexgram)
set(CPACK_DEBIAN_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "openmpi-bin, python3, python3-numpy, python3-scipy, python3-h5py, \
python3-meshio, python3-yaml, python3-matplotlib, python3-mpi4py, libjs-three, \
libjs-dygraphs")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "${PROJECT_DESCRIPTION}")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
    "It takes finite-element meshes, or matrices of FE codes, and proves the error over a frequency
 band. Reduced bodies go to multibody codes.")
include(CPack)
