# Which Eigen? A parent project's, else, to develop with, the wheel's, so that every machine compiles
# the same version and counts the same instructions; else the system's (Debian: libeigen3-dev).
if(NOT TARGET Eigen3::Eigen)
  if(TRUEPOSE_PYTHON OR TRUEPOSE_TESTS)
    # All components at once: a second find_package(Python) does not look for the headers of the first.
    find_package(Python 3.11 REQUIRED COMPONENTS Interpreter OPTIONAL_COMPONENTS Development.Module Development.SABIModule)
    # The wheel's CMake files lie under cmeel.prefix.
    execute_process(
      COMMAND "${Python_EXECUTABLE}" -c
              "import importlib.util as u, pathlib as p; print(p.Path(u.find_spec('cmeel').origin).parents[1] / 'cmeel.prefix')"
      OUTPUT_VARIABLE cmeel OUTPUT_STRIP_TRAILING_WHITESPACE COMMAND_ERROR_IS_FATAL ANY)
    find_package(Eigen3 3.4 REQUIRED CONFIG NO_DEFAULT_PATH PATHS "${cmeel}")
  else()
    find_package(Eigen3 3.4 REQUIRED CONFIG)
  endif()
endif()
