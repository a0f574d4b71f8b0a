/* Pins of a component: a row of pins of one name for each motor, sensor or freedom, and machine
 * units. Include it once, after COMPONENT and PINS(PIN), the list PIN(row, kind, direction, member,
 * name, value): of a name there is ONE pin, or one of each MOTOR, SENSOR, READING (motors, then
 * sensors), freedom of the POSE or AXIS of LinuxCNC. A seventh argument is what PINS(TRUEPOSE_SHOW)
 * writes to the pin. */
#ifndef TRUEPOSE_LINUXCNC_PINS_H
#define TRUEPOSE_LINUXCNC_PINS_H

#include "component.h"

enum { ONE, MOTOR, SENSOR, READING, POSE, AXIS };
#define TRUEPOSE_ONE
#define TRUEPOSE_MOTOR [TRUEPOSE_MOTORS]
#define TRUEPOSE_POSE [TRUEPOSE_FREEDOMS]
#define TRUEPOSE_AXIS [9]
#define TRUEPOSE_SENSOR [TRUEPOSE_SENSORS]
#define TRUEPOSE_READING [TRUEPOSE_READINGS]
#define TRUEPOSE_float HAL_FLOAT
#define TRUEPOSE_bit HAL_BIT
#define TRUEPOSE_s32 HAL_S32
#define TRUEPOSE_u32 HAL_U32
#define TRUEPOSE_port HAL_PORT
#define TRUEPOSE_POINTER(row, kind, direction, member, ...) hal_##kind##_t* member TRUEPOSE_##row;
#define TRUEPOSE_MAKE(row, kind, direction, member, name, value, ...) \
  bad |= new_row(row, TRUEPOSE_##kind, &pin->member, HAL_##direction, value, name);
#define TRUEPOSE_SHOW(row, kind, direction, member, name, value, ...) \
  __VA_OPT__(*pin->member = __VA_ARGS__;)

static struct pins {
  PINS(TRUEPOSE_POINTER)
}* pin;
static int motors, readings; /* of the robot */

/** Creates the pins of a name. @return 0: created */
static int new_row(int row, hal_type_t type, void* first, hal_pin_dir_t direction, double value,
                   const char* name) {
  const int ends[] = {1, motors, readings, readings, motors, 9};
  void** at = first;
  int bad = 0;
  for (int c = row == SENSOR ? motors : 0; c < ends[row]; ++c, ++at)
    if (row == ONE)
      bad |= new_pin(type, at, direction, value, COMPONENT ".%s", name);
    else if (row == POSE)
      bad |= new_pin(type, at, direction, value, COMPONENT ".%s.%d", name, c);
    else if (row == AXIS)
      bad |= new_pin(type, at, direction, value, COMPONENT ".%s.%c", name, "xyzabcuvw"[c]);
    else if (c < motors)
      bad |= new_pin(type, at, direction, value, COMPONENT ".%d.%s", c, name);
    else
      bad |= new_pin(type, at, direction, value, COMPONENT ".sensor.%d.%s", c - motors, name);
  return bad;
}

/** Creates all pins. @return 0: created */
static int make_pins(void) {
  int bad = 0;
  pin = hal_malloc(sizeof *pin);
  if (pin == NULL) return -1;
  PINS(TRUEPOSE_MAKE)
  return bad;
}

#endif
