/* What components share: pins with a first value, and how a refusal to load is said. */
#ifndef TRUEPOSE_LINUXCNC_PINS_H
#define TRUEPOSE_LINUXCNC_PINS_H

#include <stdarg.h>

#include "hal.h"
#include "rtapi.h"
#include "rtapi_string.h"

/** new_float, new_bit, new_s32: a pin of a name by format, which starts at `value`. @return 0: made
 */
#define TRUEPOSE_NEW(kind)                                                                     \
  static inline __attribute__((format(printf, 5, 6))) int new_##kind(                          \
      int id, hal_##kind##_t** pin, hal_pin_dir_t direction, double value, const char* format, \
      ...) {                                                                                   \
    char name[HAL_NAME_LEN + 1];                                                               \
    va_list arguments;                                                                         \
    va_start(arguments, format);                                                               \
    rtapi_vsnprintf(name, sizeof name, format, arguments);                                     \
    va_end(arguments);                                                                         \
    const int result = hal_pin_##kind##_newf(direction, pin, id, "%s", name);                  \
    if (result == 0) **pin = value;                                                            \
    return result;                                                                             \
  }
TRUEPOSE_NEW(float)
TRUEPOSE_NEW(bit)
TRUEPOSE_NEW(s32)
TRUEPOSE_NEW(u32)

/** Says why a component is not loaded. @return -1 */
static inline int wrong(const char* component, const char* what, const char* value,
                        const char* why) {
  rtapi_print_msg(RTAPI_MSG_ERR, "%s: %s=%s: %s\n", component, what, value, why);
  return -1;
}

#endif
