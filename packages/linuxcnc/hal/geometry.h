/* Robots that LinuxCNC's own kinematics modules describe by pins, as truepose's descriptions. Pure
 * functions; numbers are the pins', in machine units. */
#ifndef TRUEPOSE_LINUXCNC_GEOMETRY_H
#define TRUEPOSE_LINUXCNC_GEOMETRY_H

#include "kins_core.h"

/** genhexkins' pins. */
typedef struct truepose_hexapod {
  truepose_real base[6][3], platform[6][3];     /**< the struts' ends */
  truepose_real base_n[6][3], platform_n[6][3]; /**< their joints' axes, used with a screw */
  truepose_real spindle_offset, tool_offset;    /**< added to every z: moves the reference point */
  truepose_real screw_lead;
} truepose_hexapod;

/** Six legs. Home is above the base, level, where they hold the platform best.
 * @return as truepose_load(); the previous robot is lost */
truepose_outcome truepose_kins_hexapod(truepose_kins* kins, const truepose_hexapod* pins);

/** lineardeltakins' pins: carriages on vertical rails, at R from the axis. */
typedef struct truepose_linear_delta {
  truepose_real R, L;
} truepose_linear_delta;
truepose_outcome truepose_kins_linear_delta(truepose_kins* kins, const truepose_linear_delta* pins);

/** rotarydeltakins' pins. Joints in degrees, positive below the horizontal. */
typedef struct truepose_rotary_delta {
  truepose_real platform_radius, thigh_length, shin_length, foot_radius;
} truepose_rotary_delta;
truepose_outcome truepose_kins_rotary_delta(truepose_kins* kins, const truepose_rotary_delta* pins);

#endif
