set(config_dir ${CMAKE_INSTALL_LIBDIR}/cmake/rubato)
configure_package_config_file(cmake/rubato-config.cmake.in ${PROJECT_BINARY_DIR}/rubato-config.cmake
  INSTALL_DESTINATION ${config_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/rubato-config-version.cmake COMPATIBILITY SameMajorVersion)
install(EXPORT rubato-targets NAMESPACE rubato:: DESTINATION ${config_dir})
install(FILES ${PROJECT_BINARY_DIR}/rubato-config.cmake ${PROJECT_BINARY_DIR}/rubato-config-version.cmake
  DESTINATION ${config_dir})
install(FILES README.md CHANGELOG.md CITATION.cff DESTINATION ${CMAKE_INSTALL_DOCDIR} COMPONENT program)
