# What `cmake --install` and the wheel give to C and C++ projects: the library, its public headers, what
# find_package(truepose) reads, and the file of pkg-config.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

if(SKBUILD)  # the wheel keeps all that is not Python in one folder; pyproject.toml: cmake.prefix
  set(CMAKE_INSTALL_INCLUDEDIR truepose/_data/include)
  set(CMAKE_INSTALL_LIBDIR truepose/_data/lib)
  set(CMAKE_INSTALL_DATADIR truepose/_data/share)
endif()
set(config ${CMAKE_INSTALL_DATADIR}/cmake/truepose)
set(pkgconfig ${CMAKE_INSTALL_DATADIR}/pkgconfig)

install(DIRECTORY include/truepose DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(TARGETS ${truepose_libraries} EXPORT truepose
  ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} LIBRARY DESTINATION ${CMAKE_INSTALL_LIBDIR}
  INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(EXPORT truepose NAMESPACE truepose:: FILE trueposeTargets.cmake DESTINATION ${config})

configure_package_config_file(cmake/trueposeConfig.cmake.in trueposeConfig.cmake
  INSTALL_DESTINATION ${config} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(trueposeConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfigVersion.cmake DESTINATION ${config})

file(RELATIVE_PATH libraries /${pkgconfig} /${CMAKE_INSTALL_LIBDIR})
file(RELATIVE_PATH headers /${pkgconfig} /${CMAKE_INSTALL_INCLUDEDIR})
set(single "")
if(TRUEPOSE_SINGLE)
  set(single " -DTRUEPOSE_SINGLE")
endif()
configure_file(cmake/truepose.pc.in truepose.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/truepose.pc DESTINATION ${pkgconfig})
