/* Simulated machine for LinuxCNC's HAL, the counterpart of truepose_tej. The model is in
 * plant_core.c, the guide in ../docs/linuxcnc.md. MIT.
 *
 *   loadrt truepose_plant table=FILE [unit=mm|inch|m] [period_us=1000]
 *   addf truepose_plant servo-thread    # last
 *
 * When the thread begins, its motors are at `start`, where their encoders count from. */
#define COMPONENT "truepose_plant"
#include "component.h"

#include "plant_core.h"

MODULE_DESCRIPTION("A parallel robot that is simulated, with its encoders and its faults");

static int period_us = 1000;
RTAPI_MP_INT(period_us, "of the thread, microseconds");

static struct plant_pins {
  hal_float_t *start[6], *velocity[6], *pose[6];
  hal_float_t *position[TRUEPOSE_READINGS], *index[TRUEPOSE_READINGS], *size[TRUEPOSE_READINGS];
  hal_bit_t *index_enable[TRUEPOSE_READINGS], *absolute[TRUEPOSE_READINGS];
  hal_s32_t* fault[TRUEPOSE_READINGS];
  hal_bit_t *coarse, *blocked;
  hal_s32_t* status;
}* pins;

static truepose_plant plant;
static truepose_description robot;
static truepose_real scale[TRUEPOSE_READINGS], pose_scale[6];
static int motors, readings, begun;

static void begin_here(void) {
  truepose_real q[6] = {0};
  for (int i = 0; i < motors; ++i) q[i] = *pins->start[i] * scale[i];
  *pins->status = truepose_plant_begin(&plant, &robot, 1e-6 * period_us, q).status;
  begun = 1;
}

static void cycle(void* unused, long period) {
  truepose_real velocity[6] = {0}, index[TRUEPOSE_READINGS], size[TRUEPOSE_READINGS];
  int32_t fault[TRUEPOSE_READINGS];
  int asks[TRUEPOSE_READINGS];
  (void)unused;
  (void)period;
  if (!begun) begin_here();
  if (*pins->status > TRUEPOSE_OK) return;
  plant.coarse = *pins->coarse;
  for (int i = 0; i < motors; ++i) velocity[i] = *pins->velocity[i] * scale[i];
  for (int c = 0; c < readings; ++c) {
    index[c] = *pins->index[c] * scale[c];
    size[c] = *pins->size[c] * scale[c];
    fault[c] = *pins->fault[c];
    asks[c] = *pins->index_enable[c];
    plant.absolute[c] = *pins->absolute[c];
  }
  truepose_plant_cycle(&plant, velocity, fault, size, index, asks);
  for (int c = 0; c < readings; ++c) {
    *pins->position[c] = plant.read[c] / scale[c];
    *pins->index_enable[c] = asks[c];
  }
  for (int k = 0; k < motors; ++k) *pins->pose[k] = plant.x[k] / pose_scale[k];
  *pins->blocked = plant.blocked;
}

static int make_pins(void) {
  int bad = 0;
  pins = hal_malloc(sizeof *pins);
  if (pins == NULL) return -1;
  for (int i = 0; i < motors; ++i) {
    bad |= new_float(&pins->start[i], HAL_IN, 0, "truepose_plant.%d.start", i);
    bad |= new_float(&pins->velocity[i], HAL_IN, 0, "truepose_plant.%d.velocity", i);
    bad |= new_float(&pins->pose[i], HAL_OUT, 0, "truepose_plant.pose.%d", i);
  }
  for (int c = 0; c < readings; ++c) {
    char name[HAL_NAME_LEN + 1];
    if (c < motors)
      rtapi_snprintf(name, sizeof name, "truepose_plant.%d", c);
    else
      rtapi_snprintf(name, sizeof name, "truepose_plant.sensor.%d", c - motors);
    bad |= new_float(&pins->position[c], HAL_OUT, 0, "%s.position", name);
    bad |= new_float(&pins->index[c], HAL_IN, 0, "%s.index-angle", name);
    bad |= new_bit(&pins->index_enable[c], HAL_IO, 0, "%s.index-enable", name);
    bad |= new_bit(&pins->absolute[c], HAL_IN, 0, "%s.absolute", name);
    bad |= new_s32(&pins->fault[c], HAL_IN, 0, "%s.fault", name);
    bad |= new_float(&pins->size[c], HAL_IN, 0, "%s.fault-size", name);
  }
  bad |= new_bit(&pins->coarse, HAL_IN, 1, "truepose_plant.counts");
  bad |= new_bit(&pins->blocked, HAL_OUT, 0, "truepose_plant.blocked");
  bad |= new_s32(&pins->status, HAL_OUT, 0, "truepose_plant.status");
  return bad;
}

static int begin(void) {
  static truepose_table read;
  if (read_parameters(&read) != 0) return -1;
  robot = read.robot;
  if (refused("table", table, truepose_load(&plant.model, sizeof plant.model, &robot)) != 0)
    return -1;
  motors = truepose_freedoms(&plant.model);
  readings = motors + truepose_sensors(&plant.model);
  for (int c = 0; c < readings; ++c)
    scale[c] = truepose_reading_scale(&robot, c, truepose_unit(unit));
  for (int k = 0; k < motors; ++k)
    pose_scale[k] = truepose_freedom_scale(&robot, k, truepose_unit(unit));
  return make_pins() != 0 ? -1 : hal_export_funct("truepose_plant", cycle, NULL, 1, 0, id);
}

void rtapi_app_exit(void) { hal_exit(id); }
