# What does a C++ project find after `cmake --install`, or in the wheel? The headers, what
# find_package(truepose) reads, and truepose.pc. All of it under share: headers serve every
# architecture. So kernels.hpp stays behind, which only declares what a library has compiled.
include(CMakePackageConfigHelpers)
include(GNUInstallDirs)

if(SKBUILD)  # the wheel keeps all that is not Python in one folder; pyproject.toml: cmake.prefix
  set(CMAKE_INSTALL_INCLUDEDIR truepose/_data/include)
  set(CMAKE_INSTALL_DATADIR truepose/_data/share)
endif()
set(config ${CMAKE_INSTALL_DATADIR}/cmake/truepose)
set(pkgconfig ${CMAKE_INSTALL_DATADIR}/pkgconfig)

set_target_properties(truepose_core PROPERTIES EXPORT_NAME core)
install(TARGETS truepose_core EXPORT truepose INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
install(DIRECTORY include/truepose DESTINATION ${CMAKE_INSTALL_INCLUDEDIR}
  FILES_MATCHING PATTERN *.hpp PATTERN *.h PATTERN kernels.hpp EXCLUDE)
install(EXPORT truepose NAMESPACE truepose:: FILE trueposeTargets.cmake DESTINATION ${config})

# Without a build there is no C library to install, and the C++ package is whole all the same.
if(TRUEPOSE_C)
  install(TARGETS truepose_c_static truepose_c_shared EXPORT truepose_c OPTIONAL
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
  install(EXPORT truepose_c NAMESPACE truepose:: FILE trueposeCTargets.cmake DESTINATION ${config})
endif()

configure_package_config_file(cmake/trueposeConfig.cmake.in trueposeConfig.cmake
  INSTALL_DESTINATION ${config} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(trueposeConfigVersion.cmake COMPATIBILITY SameMinorVersion
  ARCH_INDEPENDENT)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfigVersion.cmake DESTINATION ${config})

file(RELATIVE_PATH libraries /${pkgconfig} /${CMAKE_INSTALL_LIBDIR})
if(TRUEPOSE_C)  # C callers need no Eigen: where it is, for C++, is said rather than required
  get_target_property(eigen Eigen3::Eigen INTERFACE_INCLUDE_DIRECTORIES)
  set(needs "Libs: -L\${libdir} -ltruepose\nLibs.private: -lm")
  set(flags "-I${eigen}")
else()
  set(needs "Requires: eigen3 >= 3.4")
  set(flags "")
endif()
if(TRUEPOSE_SINGLE)
  string(APPEND flags " -DTRUEPOSE_SINGLE -fsingle-precision-constant")
endif()
file(RELATIVE_PATH headers /${pkgconfig} /${CMAKE_INSTALL_INCLUDEDIR})
configure_file(cmake/truepose.pc.in truepose.pc @ONLY)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/truepose.pc DESTINATION ${pkgconfig})
