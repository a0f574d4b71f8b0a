/* Simulated machine for LinuxCNC's HAL, the counterpart of truepose_tej. The model is in
 * plant_core.c, the guide in ../docs/linuxcnc.md. MIT.
 *
 *   loadrt truepose_plant table=FILE [unit=mm|inch|m] [period_us=1000]
 *   addf truepose_plant servo-thread    # last
 *
 * When the thread begins, its motors are at `start`, where their encoders count from. */
#define COMPONENT "truepose_plant"
#define PINS(PIN)                                        \
  PIN(MOTOR, float, IN, start, "start", 0)               \
  PIN(MOTOR, float, IN, velocity, "velocity", 0)         \
  PIN(POSE, float, OUT, pose, "pose", 0)                 \
  PIN(READING, float, OUT, position, "position", 0)      \
  PIN(READING, float, IN, index, "index-angle", 0)       \
  PIN(READING, bit, IO, index_enable, "index-enable", 0) \
  PIN(READING, bit, IN, absolute, "absolute", 0)         \
  PIN(READING, s32, IN, fault, "fault", 0)               \
  PIN(READING, float, IN, size, "fault-size", 0)         \
  PIN(ONE, bit, IN, coarse, "counts", 1)                 \
  PIN(ONE, bit, OUT, blocked, "blocked", 0)              \
  PIN(ONE, s32, OUT, status, "status", 0)
#include "cycles.h"

#include "plant_core.h"

MODULE_DESCRIPTION("A parallel robot that is simulated, with its encoders and its faults");

static truepose_plant plant;
static truepose_description robot;
static int begun;

static void begin_here(void) {
  truepose_real q[TRUEPOSE_MOTORS] = {0};
  for (int i = 0; i < motors; ++i) q[i] = *pin->start[i] * scale[i];
  *pin->status = truepose_plant_begin(&plant, &robot, 1e-6 * period_us, q).status;
  begun = 1;
}

static void cycle(void* unused, long period) {
  truepose_real velocity[TRUEPOSE_MOTORS] = {0}, index[TRUEPOSE_READINGS], size[TRUEPOSE_READINGS];
  int32_t fault[TRUEPOSE_READINGS];
  int asks[TRUEPOSE_READINGS];
  if (!begun) begin_here();
  if (*pin->status > TRUEPOSE_OK) return;
  plant.coarse = *pin->coarse;
  for (int i = 0; i < motors; ++i) velocity[i] = *pin->velocity[i] * scale[i];
  for (int c = 0; c < readings; ++c) {
    index[c] = *pin->index[c] * scale[c];
    size[c] = *pin->size[c] * scale[c];
    fault[c] = *pin->fault[c];
    asks[c] = *pin->index_enable[c];
    plant.absolute[c] = *pin->absolute[c];
  }
  truepose_plant_cycle(&plant, velocity, fault, size, index, asks);
  for (int c = 0; c < readings; ++c) {
    *pin->position[c] = plant.read[c] / scale[c];
    *pin->index_enable[c] = asks[c];
  }
  for (int k = 0; k < motors; ++k) *pin->pose[k] = plant.x[k] / pose_scale[k];
  *pin->blocked = plant.blocked;
}

static int begin(void) {
  static truepose_table read;
  if (read_parameters(&read) != 0) return -1;
  robot = read.robot;
  if (refused("table", table, truepose_load(&plant.model, sizeof plant.model, &robot)) != 0)
    return -1;
  return begin_cycles(&robot, cycle);
}

void rtapi_app_exit(void) { hal_exit(id); }
