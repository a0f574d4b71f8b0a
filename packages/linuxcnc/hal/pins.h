/* Pins and function of a component that runs in a thread: a row of pins of one name for each motor,
 * sensor or freedom, and machine units. Include it once, after COMPONENT and PINS(PIN), the list
 * PIN(row, kind, direction, member, name, value): of a name there is ONE pin, or one of each MOTOR,
 * SENSOR, READING (motors, then sensors) or freedom of the POSE. */
#ifndef TRUEPOSE_LINUXCNC_PINS_H
#define TRUEPOSE_LINUXCNC_PINS_H

#include "component.h"

static int period_us = 1000;
RTAPI_MP_INT(period_us, "of the thread, microseconds");

enum { ONE, MOTOR, SENSOR, READING, POSE };
#define TRUEPOSE_ONE
#define TRUEPOSE_MOTOR [6]
#define TRUEPOSE_POSE [6]
#define TRUEPOSE_SENSOR [TRUEPOSE_SENSORS]
#define TRUEPOSE_READING [TRUEPOSE_READINGS]
#define TRUEPOSE_float HAL_FLOAT
#define TRUEPOSE_bit HAL_BIT
#define TRUEPOSE_s32 HAL_S32
#define TRUEPOSE_u32 HAL_U32
#define TRUEPOSE_POINTER(row, kind, direction, member, name, value) \
  hal_##kind##_t* member TRUEPOSE_##row;
#define TRUEPOSE_MAKE(row, kind, direction, member, name, value) \
  bad |= new_row(row, TRUEPOSE_##kind, &pins->member, HAL_##direction, value, name);

static struct pins {
  PINS(TRUEPOSE_POINTER)
}* pins;
static int motors, readings;                   /* of the robot; */
static truepose_real scale[TRUEPOSE_READINGS]; /* rad or m per machine unit, of readings */
static truepose_real pose_scale[6];            /* and of the pose's freedoms */

/** Creates the pins of a name. @return 0: created */
static int new_row(int row, hal_type_t type, void* first, hal_pin_dir_t direction, double value,
                   const char* name) {
  const int end = row == ONE ? 1 : row == MOTOR || row == POSE ? motors : readings;
  void** pin = first;
  int bad = 0;
  for (int c = row == SENSOR ? motors : 0; c < end; ++c, ++pin)
    if (row == ONE)
      bad |= new_pin(type, pin, direction, value, COMPONENT ".%s", name);
    else if (row == POSE)
      bad |= new_pin(type, pin, direction, value, COMPONENT ".%s.%d", name, c);
    else if (c < motors)
      bad |= new_pin(type, pin, direction, value, COMPONENT ".%d.%s", c, name);
    else
      bad |= new_pin(type, pin, direction, value, COMPONENT ".sensor.%d.%s", c - motors, name);
  return bad;
}

/** Creates the pins for a robot, and the function. @return 0: created */
static int begin_cycles(const truepose_description* robot, void (*cycle)(void*, long)) {
  int bad = 0;
  motors = robot->motors;
  readings = motors + robot->sensors;
  for (int c = 0; c < readings; ++c)
    scale[c] = truepose_reading_scale(robot, c, truepose_unit(unit));
  for (int k = 0; k < motors; ++k)
    pose_scale[k] = truepose_freedom_scale(robot, k, truepose_unit(unit));
  pins = hal_malloc(sizeof *pins);
  if (pins == NULL) return -1;
  PINS(TRUEPOSE_MAKE)
  return bad != 0 ? -1 : hal_export_funct(COMPONENT, cycle, NULL, 1, 0, id);
}

#endif
