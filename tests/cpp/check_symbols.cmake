# Compiles realtime_object.cpp and fails if it needs more than libm and the compiler's own copying.
# Compiled here, not as a target, so that no build type or sanitizer adds flags of its own.
execute_process(
  COMMAND "${COMPILER}" -std=c++20 -O3 -DNDEBUG -fno-math-errno -fno-exceptions -fno-rtti
          "-I${INCLUDE}" -isystem "${EIGEN}" -c "${SOURCE}" -o "${OBJECT}"
  COMMAND_ERROR_IS_FATAL ANY)
execute_process(COMMAND "${NM}" --undefined-only --format=posix "${OBJECT}"
                OUTPUT_VARIABLE table COMMAND_ERROR_IS_FATAL ANY)
string(REGEX MATCHALL "[^\n]+" lines "${table}")
set(allowed sin cos sincos tan atan atan2 exp erfc tanh sqrt remainder nearbyint lround memcpy memset memmove
            _GLOBAL_OFFSET_TABLE_)
set(needed "")
set(foreign "")
foreach(line IN LISTS lines)
  string(REGEX REPLACE " .*" "" symbol "${line}")
  list(APPEND needed ${symbol})
  if(NOT symbol IN_LIST allowed)
    list(APPEND foreign ${symbol})
  endif()
endforeach()
if(NOT "atan2" IN_LIST needed)
  message(FATAL_ERROR "The inverse model needs atan2; finding none, this check looked at nothing.")
endif()
if(foreign)
  message(FATAL_ERROR "The real-time core needs symbols it may not: ${foreign}")
endif()
message("The real-time core needs ${needed}")
