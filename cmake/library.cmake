# The compiled library of truepose.h (C) and truepose.hpp (C++), static and shared: the control path, which needs
# libm and libc alone. Calibration and simulation, for computers without a deadline, allocate, and need the C++
# library: a library apart.
file(STRINGS include/truepose/truepose.h abi REGEX "^#define TRUEPOSE_ABI ")
string(REGEX MATCH "[0-9]+" abi "${abi}")
foreach(room math mechanism estimation control c)
  file(GLOB sources CONFIGURE_DEPENDS src/${room}/*.cpp)
  list(APPEND control_path ${sources})
endforeach()
list(REMOVE_ITEM control_path ${CMAKE_CURRENT_SOURCE_DIR}/src/c/calibrate.cpp)
file(GLOB offline CONFIGURE_DEPENDS src/calibration/*.cpp src/simulation/*.cpp)
list(APPEND offline src/c/calibrate.cpp)

# How the library itself is compiled, and what sees its own headers: the module, tests, packages of this repository.
add_library(truepose_internal INTERFACE)
target_include_directories(truepose_internal INTERFACE ${CMAKE_CURRENT_SOURCE_DIR}/include ${CMAKE_CURRENT_SOURCE_DIR}/src)
target_compile_features(truepose_internal INTERFACE cxx_std_20)
target_compile_options(truepose_internal INTERFACE -fno-math-errno
  $<$<BOOL:${TRUEPOSE_SINGLE}>:-fsingle-precision-constant>)
target_compile_definitions(truepose_internal INTERFACE TRUEPOSE_BUILDS_SHARED
  $<$<BOOL:${TRUEPOSE_SINGLE}>:TRUEPOSE_SINGLE>)

# A wheel is built once, from nothing: its sources in batches, each of which reads the headers once. c/'s files,
# which name their own parts alike, stay apart.
if(SKBUILD)
  set(wheel ON)
endif()
option(TRUEPOSE_BATCHES "Compile the library in batches of sources: in a third of the time, if from nothing" ${wheel})
file(GLOB apart CONFIGURE_DEPENDS src/c/*.cpp)
# Packed in pairs, numbers that are read one by one soon after take a fifth longer.
set_source_files_properties(src/math/square.cpp src/mechanism/fkm.cpp src/mechanism/pose.cpp PROPERTIES
  COMPILE_OPTIONS -fno-tree-slp-vectorize)
set_source_files_properties(${apart} PROPERTIES SKIP_UNITY_BUILD_INCLUSION ON)
function(truepose_library name)
  set_target_properties(${name} PROPERTIES UNITY_BUILD "${TRUEPOSE_BATCHES}" UNITY_BUILD_BATCH_SIZE 16
    POSITION_INDEPENDENT_CODE ON CXX_VISIBILITY_PRESET hidden VISIBILITY_INLINES_HIDDEN ON)
  target_link_libraries(${name} PRIVATE $<BUILD_INTERFACE:truepose_internal>)
  target_compile_options(${name} PRIVATE ${TRUEPOSE_WARNINGS} $<$<CONFIG:Release>:-O2>)
endfunction()

add_library(truepose_objects OBJECT ${control_path})
truepose_library(truepose_objects)
target_compile_options(truepose_objects PRIVATE ${TRUEPOSE_BARE})
add_library(truepose_static STATIC $<TARGET_OBJECTS:truepose_objects>)
set(truepose_libraries truepose_static)
if(TRUEPOSE_INSTALL AND NOT TRUEPOSE_TESTS AND NOT SKBUILD)
  add_library(truepose_shared SHARED $<TARGET_OBJECTS:truepose_objects>)
  list(APPEND truepose_libraries truepose_shared)
  if(CMAKE_SYSTEM_NAME STREQUAL "Linux")  # whatever else it needed would be an error of the linker
    target_link_options(truepose_shared PRIVATE -Wl,-z,defs -Wl,--gc-sections)
  endif()
endif()
foreach(library ${truepose_libraries})
  string(REPLACE "truepose_" "" kind ${library})
  add_library(truepose::${kind} ALIAS ${library})
  target_include_directories(${library} INTERFACE $<BUILD_INTERFACE:${PROJECT_SOURCE_DIR}/include>)
  target_link_libraries(${library} PUBLIC m)
  target_compile_definitions(${library} INTERFACE $<$<BOOL:${TRUEPOSE_SINGLE}>:TRUEPOSE_SINGLE>)
  set_target_properties(${library} PROPERTIES OUTPUT_NAME truepose EXPORT_NAME ${kind} LINKER_LANGUAGE CXX
    VERSION ${abi}.${PROJECT_VERSION} SOVERSION ${abi})
endforeach()
add_library(truepose::truepose ALIAS truepose_static)

if(NOT TRUEPOSE_SINGLE)
  add_library(truepose_offline STATIC ${offline})
  truepose_library(truepose_offline)
  target_link_libraries(truepose_offline PUBLIC truepose_static)
  set_target_properties(truepose_offline PROPERTIES OUTPUT_NAME truepose-offline EXPORT_NAME offline)
  add_library(truepose::offline ALIAS truepose_offline)
  list(APPEND truepose_libraries truepose_offline)
endif()
