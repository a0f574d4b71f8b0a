/* Function of a component that runs in a thread, with its pins (pins.h). */
#ifndef TRUEPOSE_LINUXCNC_CYCLES_H
#define TRUEPOSE_LINUXCNC_CYCLES_H

#include "pins.h"

static int period_us = 1000;
RTAPI_MP_INT(period_us, "of the thread, microseconds");

static truepose_real scale[TRUEPOSE_READINGS]; /* rad or m per machine unit, of readings */
static truepose_real pose_scale[6];            /* and of the pose's freedoms */

/** Creates the pins for a robot, and the function. @return 0: created */
static int begin_cycles(const truepose_description* robot, void (*cycle)(void*, long)) {
  motors = robot->motors;
  readings = motors + robot->sensors;
  for (int c = 0; c < readings; ++c)
    scale[c] = truepose_reading_scale(robot, c, truepose_unit(unit));
  for (int k = 0; k < motors; ++k)
    pose_scale[k] = truepose_freedom_scale(robot, k, truepose_unit(unit));
  return make_pins() != 0 ? -1 : hal_export_funct(COMPONENT, cycle, NULL, 1, 0, id);
}

#endif
