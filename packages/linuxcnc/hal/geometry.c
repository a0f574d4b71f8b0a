/* Robots described by the pins of LinuxCNC's own modules. */
#include "geometry.h"

#include <math.h>
#include <string.h>

static truepose_description begun(int32_t mobility, int32_t motors) {
  truepose_description robot;
  memset(&robot, 0, sizeof robot);
  robot.abi = TRUEPOSE_ABI;
  robot.size = sizeof robot;
  robot.mobility = mobility;
  robot.chains = robot.motors = motors;
  for (int i = 0; i < motors; ++i) {
    truepose_chain* chain = &robot.chain[i];
    chain->working_mode = 1;
    chain->bar = -1;
    chain->encoder_gain = chain->gear = 1;
    chain->low = -HUGE_VAL;
    chain->high = HUGE_VAL;
  }
  return robot;
}

static truepose_real mean(const truepose_real (*points)[3], int k) {
  truepose_real sum = 0;
  for (int i = 0; i < 6; ++i) sum += points[i][k] / 6;
  return sum;
}

truepose_outcome truepose_kins_hexapod(truepose_kins* kins, const truepose_hexapod* pins) {
  static const truepose_real heights[] = {1, 0.5, 2, 0.25, 4}; /* of home, in base radii */
  truepose_description robot = begun(TRUEPOSE_SPATIAL, 6);
  const truepose_real offset = pins->spindle_offset + pins->tool_offset;
  const truepose_real cx = mean(pins->base, 0), cy = mean(pins->base, 1);
  truepose_real radius = 0;
  truepose_outcome outcome = {TRUEPOSE_NO_SUCH_VALUE, -1};
  for (int i = 0; i < 6; ++i) radius += hypot(pins->base[i][0] - cx, pins->base[i][1] - cy) / 6;
  const truepose_real unit = 1 / radius; /* scales the core's robot to about a metre */
  for (int i = 0; i < 6; ++i) {
    truepose_chain* chain = &robot.chain[i];
    chain->actuator = TRUEPOSE_TELESCOPIC;
    for (int k = 0; k < 3; ++k) {
      chain->base[k] = (pins->base[i][k] + (k == 2 ? offset : 0)) * unit;
      chain->pivot[k] = (pins->platform[i][k] + (k == 2 ? offset : 0)) * unit;
    }
  }
  robot.home[0] = (cx - mean(pins->platform, 0)) * unit;
  robot.home[1] = (cy - mean(pins->platform, 1)) * unit;
  for (unsigned h = 0; h < sizeof heights / sizeof *heights; ++h) {
    robot.home[2] = heights[h] + (mean(pins->base, 2) - mean(pins->platform, 2)) * unit;
    outcome = truepose_kins_load(kins, &robot, unit);
    if (outcome.status <= TRUEPOSE_OK) break;
  }
  kins->screw.lead = pins->screw_lead;
  memcpy(kins->screw.base_axis, pins->base_n, sizeof pins->base_n);
  memcpy(kins->screw.platform_axis, pins->platform_n, sizeof pins->platform_n);
  return outcome;
}

/** Directions of three chains, 120° apart, counter-clockwise seen from above. */
static void thirds(int i, truepose_real first, truepose_real direction[3]) {
  const truepose_real third = 2.0943951023931953;
  direction[0] = cos(first + i * third);
  direction[1] = sin(first + i * third);
  direction[2] = 0;
}

truepose_outcome truepose_kins_linear_delta(truepose_kins* kins,
                                            const truepose_linear_delta* pins) {
  truepose_description robot = begun(TRUEPOSE_TRANSLATION, 3);
  const truepose_real unit = 1 / pins->L;
  for (int i = 0; i < 3; ++i) {
    truepose_chain* chain = &robot.chain[i];
    truepose_real direction[3];
    thirds(i, 1.5707963267948966, direction); /* joint 0 at (0, R) */
    chain->actuator = TRUEPOSE_PRISMATIC;     /* carriages above: working mode 1 */
    for (int k = 0; k < 3; ++k) chain->base[k] = pins->R * unit * direction[k];
    chain->axis[2] = 1;
    chain->zero[0] = 1;
    chain->rod = 1;
  }
  return truepose_kins_load(kins, &robot, unit);
}

truepose_outcome truepose_kins_rotary_delta(truepose_kins* kins,
                                            const truepose_rotary_delta* pins) {
  static const truepose_real thighs[] = {0.8, 0.5, 1.1, 0.2, 1.4, -0.2}; /* of home, rad */
  truepose_description robot = begun(TRUEPOSE_TRANSLATION, 3);
  const truepose_real unit = 1 / pins->thigh_length;
  const truepose_real shin = pins->shin_length * unit;
  truepose_outcome outcome = {TRUEPOSE_NO_SUCH_VALUE, -1};
  for (int i = 0; i < 3; ++i) {
    truepose_chain* chain = &robot.chain[i];
    thirds(i, -1.5707963267948966, chain->zero);
    chain->actuator = TRUEPOSE_REVOLUTE;
    chain->working_mode = -1;         /* knees outside */
    chain->axis[0] = -chain->zero[1]; /* so that positive angles lower the thighs */
    chain->axis[1] = chain->zero[0];
    chain->arm = 1;
    chain->rod = shin;
    for (int k = 0; k < 2; ++k) {
      chain->base[k] = pins->platform_radius * unit * chain->zero[k];
      chain->anchor[k] = pins->foot_radius * unit * chain->zero[k];
    }
  }
  for (unsigned h = 0; h < sizeof thighs / sizeof *thighs; ++h) {
    const truepose_real out = (pins->platform_radius - pins->foot_radius) * unit + cos(thighs[h]);
    robot.home[2] = -sin(thighs[h]) - sqrt(shin * shin - out * out);
    outcome = truepose_kins_load(kins, &robot, unit);
    if (outcome.status <= TRUEPOSE_OK) break;
  }
  return outcome;
}
