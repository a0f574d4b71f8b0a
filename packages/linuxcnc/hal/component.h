/* Common code of the LinuxCNC components truepose_kins, truepose_tej and truepose_plant: loading,
 * parameters, pins with an initial value. Include it once per component, after
 * `#define COMPONENT "name"`; the component defines begin() and rtapi_app_exit(). Those with a
 * function for a thread include cycles.h as well. */
#ifndef TRUEPOSE_LINUXCNC_COMPONENT_H
#define TRUEPOSE_LINUXCNC_COMPONENT_H

#include "rtapi.h"

#include "rtapi_app.h"
#include "rtapi_string.h"

#include "hal.h"

#include "table.h"

#include <stdarg.h>

MODULE_LICENSE("Dual MIT/GPL"); /* truepose is MIT, loadable with GPL-2 */

static char* table = "";
RTAPI_MP_STRING(table, "file of truepose export linuxcnc");
static char* unit = "mm";
RTAPI_MP_STRING(unit, "machine unit of length: mm, inch, m");

static int id; /* HAL's id of this component */

/** Prints why a component is not loaded. @return -1 */
static inline int wrong(const char* what, const char* value, const char* why) {
  rtapi_print_msg(RTAPI_MSG_ERR, "%s: %s=%s: %s\n", COMPONENT, what, value, why);
  return -1;
}
/** The same for a status of the library. @return 0 if it is ok */
static inline int refused(const char* what, const char* value, truepose_outcome outcome) {
  return outcome.status > TRUEPOSE_OK ? wrong(what, value, truepose_status_text(outcome.status))
                                      : 0;
}

/** Reads the table and the unit given to the component. @return 0, or -1 if one is invalid */
static inline int read_parameters(truepose_table* read) {
  const char* const why = truepose_read_table(table, read);
  if (why != NULL) return wrong("table", table, why);
  return truepose_unit(unit) == 0 ? wrong("unit", unit, "choose mm, inch or m") : 0;
}

/** Creates a pin named by format, with initial `value`. @param pin  its pointer @return 0: created
 */
static inline __attribute__((format(printf, 5, 6))) int new_pin(hal_type_t type, void* pin,
                                                                hal_pin_dir_t direction,
                                                                double value, const char* format,
                                                                ...) {
  char name[HAL_NAME_LEN + 1];
  va_list arguments;
  va_start(arguments, format);
  rtapi_vsnprintf(name, sizeof name, format, arguments);
  va_end(arguments);
  if (hal_pin_new(name, type, direction, pin, id) != 0) return -1;
  void* const at = *(void**)pin;
  if (type == HAL_FLOAT)
    *(hal_float_t*)at = value;
  else if (type == HAL_BIT)
    *(hal_bit_t*)at = value != 0;
  else
    *(hal_s32_t*)at = value;
  return 0;
}

/** Reads the parameters, creates pins and functions. @return 0, or nonzero: not loaded */
static int begin(void);

int rtapi_app_main(void) {
  id = hal_init(COMPONENT);
  if (id < 0) return id;
  if (begin() != 0) {
    hal_exit(id);
    return -22;
  }
  hal_ready(id);
  return 0;
}

#endif
