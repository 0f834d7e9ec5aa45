# Installs the client SDK so that find_package(mapp) gives mapp::client and mapp::core. The other archives are there
# because static libraries need them at link time; their headers are not installed.
include(GNUInstallDirs)
include(CMakePackageConfigHelpers)

set(mapp_package_dir ${CMAKE_INSTALL_LIBDIR}/cmake/mapp)

install(TARGETS mapp_core mapp_client mapp_tracker mapp_vision mapp_api mapp_proto
  EXPORT mappTargets
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT sdk)
install(DIRECTORY ${PROJECT_SOURCE_DIR}/core/include/ ${PROJECT_SOURCE_DIR}/client_sdk/include/
  DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT sdk)
install(EXPORT mappTargets NAMESPACE mapp:: DESTINATION ${mapp_package_dir} COMPONENT sdk)

configure_package_config_file(${PROJECT_SOURCE_DIR}/cmake/mappConfig.cmake.in ${PROJECT_BINARY_DIR}/mappConfig.cmake
  INSTALL_DESTINATION ${mapp_package_dir})
write_basic_package_version_file(${PROJECT_BINARY_DIR}/mappConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/mappConfig.cmake ${PROJECT_BINARY_DIR}/mappConfigVersion.cmake
  DESTINATION ${mapp_package_dir} COMPONENT sdk)
