# The compiled library, static and shared, of truepose.h (C) and truepose.hpp (C++): needs libm and libc alone.
enable_language(C)
file(STRINGS include/truepose/truepose.h abi REGEX "^#define TRUEPOSE_ABI ")
string(REGEX MATCH "[0-9]+" abi "${abi}")

add_library(truepose_c_objects OBJECT ${TRUEPOSE_C_SOURCES})
target_link_libraries(truepose_c_objects PRIVATE truepose_core)
target_compile_definitions(truepose_c_objects PRIVATE TRUEPOSE_BUILDS_SHARED NDEBUG)
target_compile_options(truepose_c_objects PRIVATE ${TRUEPOSE_WARNINGS} ${TRUEPOSE_THIN}
  ${TRUEPOSE_BARE})
set_target_properties(truepose_c_objects PROPERTIES
  POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)

foreach(kind static shared)
  string(TOUPPER ${kind} KIND)
  add_library(truepose_c_${kind} ${KIND} $<TARGET_OBJECTS:truepose_c_objects>)
  add_library(truepose::${kind} ALIAS truepose_c_${kind})
  target_include_directories(truepose_c_${kind} INTERFACE
    $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>)
  target_link_libraries(truepose_c_${kind} PUBLIC m)
  target_compile_definitions(truepose_c_${kind} INTERFACE $<$<BOOL:${TRUEPOSE_SINGLE}>:TRUEPOSE_SINGLE>)
  set_target_properties(truepose_c_${kind} PROPERTIES
    OUTPUT_NAME truepose EXPORT_NAME ${kind} LINKER_LANGUAGE C
    VERSION ${abi}.${PROJECT_VERSION} SOVERSION ${abi})
endforeach()
set(TRUEPOSE_C_LIBRARIES truepose_c_static truepose_c_shared)
# Calibration, for computers without a deadline: it allocates and needs the C++ library, so that it is a library apart.
if(NOT TRUEPOSE_SINGLE)
  add_library(truepose_c_offline STATIC src/c/calibrate.cpp)
  add_library(truepose::offline ALIAS truepose_c_offline)
  target_link_libraries(truepose_c_offline PRIVATE $<BUILD_INTERFACE:truepose_core> PUBLIC truepose_c_static)
  target_compile_definitions(truepose_c_offline PRIVATE TRUEPOSE_BUILDS_SHARED NDEBUG)
  target_compile_options(truepose_c_offline PRIVATE ${TRUEPOSE_WARNINGS} ${TRUEPOSE_THIN} ${TRUEPOSE_BARE})
  set_target_properties(truepose_c_offline PROPERTIES OUTPUT_NAME truepose-offline EXPORT_NAME offline
    POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  list(APPEND TRUEPOSE_C_LIBRARIES truepose_c_offline)
endif()
add_library(truepose::truepose ALIAS truepose_c_static)
if(CMAKE_SYSTEM_NAME STREQUAL "Linux")  # whatever else it needed would be an error of the linker
  target_link_options(truepose_c_shared PRIVATE -Wl,-z,defs -Wl,--gc-sections)
endif()
