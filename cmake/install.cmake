# What `cmake --install` and the wheel give to C and C++ projects: the headers, what find_package(truepose)
# reads, and the files of pkg-config. All of it under share: headers serve every architecture.
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
  FILES_MATCHING PATTERN *.hpp PATTERN *.h)
install(EXPORT truepose NAMESPACE truepose:: FILE trueposeTargets.cmake DESTINATION ${config})

# Without a build there is no C library to install, and the C++ package is whole all the same.
if(TRUEPOSE_C)
  install(TARGETS ${TRUEPOSE_C_LIBRARIES} EXPORT truepose_c OPTIONAL
    INCLUDES DESTINATION ${CMAKE_INSTALL_INCLUDEDIR})
  install(EXPORT truepose_c NAMESPACE truepose:: FILE trueposeCTargets.cmake DESTINATION ${config})
endif()

configure_package_config_file(cmake/trueposeConfig.cmake.in trueposeConfig.cmake
  INSTALL_DESTINATION ${config} NO_SET_AND_CHECK_MACRO)
write_basic_package_version_file(trueposeConfigVersion.cmake COMPATIBILITY SameMinorVersion
  ARCH_INDEPENDENT)
install(FILES ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfig.cmake
              ${CMAKE_CURRENT_BINARY_DIR}/trueposeConfigVersion.cmake DESTINATION ${config})

# truepose.pc is for C programs, truepose-core.pc for C++ programs that include the headers.
file(RELATIVE_PATH libraries /${pkgconfig} /${CMAKE_INSTALL_LIBDIR})
file(RELATIVE_PATH headers /${pkgconfig} /${CMAKE_INSTALL_INCLUDEDIR})
function(truepose_pkg_config package description needs flags)
  configure_file(cmake/truepose.pc.in ${package}.pc @ONLY)
  install(FILES ${CMAKE_CURRENT_BINARY_DIR}/${package}.pc DESTINATION ${pkgconfig})
endfunction()
set(single "")
set(single_core "")
if(TRUEPOSE_SINGLE)
  set(single " -DTRUEPOSE_SINGLE")
  set(single_core " -DTRUEPOSE_SINGLE -fsingle-precision-constant")
endif()
truepose_pkg_config(truepose-core "Makes parallel robots accurate with redundant sensors: C++ headers"
  "Requires: eigen3 >= 3.4" " -fno-math-errno${single_core}")
if(TRUEPOSE_C)
  truepose_pkg_config(truepose "Makes parallel robots accurate with redundant sensors: C library"
    "Libs: -L\${libdir} -ltruepose\nLibs.private: -lm" "${single}")
endif()
