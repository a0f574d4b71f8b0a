/* The law of redundant sensors as a component of LinuxCNC's HAL, between motion and pid;
 * docs/linuxcnc.md is its guide, tej_core.c the mathematics. MIT.
 *
 *   loadrt truepose_tej table=FILE [unit=mm|inch|m] [period_us=1000]
 *   addf truepose_tej servo-thread      # after motion-controller, before pid */
#include "rtapi.h"

#include "rtapi_app.h"
#include "rtapi_string.h"

#include "hal.h"

#include "pins.h"
#include "tej_core.h"

MODULE_LICENSE("Dual MIT/GPL");
MODULE_DESCRIPTION("Motor errors from redundant sensors");

static char* table = "";
RTAPI_MP_STRING(table, "file of truepose export linuxcnc");
static char* unit = "mm";
RTAPI_MP_STRING(unit, "machine unit of length: mm, inch, m");
static int period_us = 1000;
RTAPI_MP_INT(period_us, "of the thread, microseconds");

static struct tej_pins {
  hal_float_t *command[6], *offset[6], *motor_fb[6], *pid_fb[6], *correction[6], *e_q[6];
  hal_float_t *position[TRUEPOSE_SENSORS], *index_angle[TRUEPOSE_SENSORS];
  hal_bit_t *index_enable[TRUEPOSE_SENSORS], *absolute[TRUEPOSE_SENSORS];
  hal_bit_t* referenced[TRUEPOSE_SENSORS];
  hal_bit_t *enable, *watch, *reset, *fault, *stop, *lost, *all_referenced;
  hal_s32_t *law, *in_effect, *fault_code, *status, *part;
  hal_float_t *band, *blend, *largest;
}* pins;

static truepose_corrector tej;
static truepose_index seen[TRUEPOSE_SENSORS];
static truepose_real scale[TRUEPOSE_READINGS];
static int id;

/** Sensors' readings, and whether the zero of all is known. */
static int32_t sensors(truepose_real* readings) {
  int32_t all = 1;
  for (int k = 0; k < tej.sensors; ++k) {
    int asks = *pins->index_enable[k];
    const int known = *pins->absolute[k] || truepose_index_cycle(&seen[k], *pins->enable, &asks);
    *pins->index_enable[k] = asks;
    *pins->referenced[k] = known;
    all = all && known;
    const truepose_real from = *pins->absolute[k] ? 0 : *pins->index_angle[k];
    readings[k] = (*pins->position[k] + from) * scale[tej.motors + k];
  }
  return all;
}

static void cycle(void* unused, long period) {
  static truepose_corrector_input in;
  (void)unused;
  (void)period;
  in.enable = *pins->enable;
  in.law = *pins->law;
  in.watch = *pins->watch;
  in.reset = *pins->reset;
  in.band = *pins->band;
  in.blend = *pins->blend;
  in.largest = *pins->largest * scale[0];
  for (int i = 0; i < tej.motors; ++i) {
    in.q_d[i] = (*pins->command[i] - *pins->offset[i]) * scale[i];
    in.q_e[i] = (*pins->motor_fb[i] - *pins->offset[i]) * scale[i];
  }
  in.referenced = sensors(in.q_e + tej.motors);
  truepose_corrector_cycle(&tej, &in);
  for (int i = 0; i < tej.motors; ++i) {
    if (tej.fault != TRUEPOSE_TEJ_COMMAND)
      *pins->pid_fb[i] = *pins->command[i] - tej.error[i] / scale[i];
    *pins->correction[i] = tej.correction[i] / scale[i];
    *pins->e_q[i] = tej.e_q[i] / scale[i];
  }
  *pins->all_referenced = in.referenced;
  *pins->in_effect = tej.law;
  *pins->fault = tej.fault != TRUEPOSE_TEJ_NO_FAULT;
  *pins->fault_code = tej.fault;
  *pins->stop = tej.stop;
  *pins->lost = tej.lost;
  *pins->status = tej.outcome.status;
  *pins->part = tej.outcome.part;
}

static int make_pins(void) {
  int bad = 0;
  pins = hal_malloc(sizeof *pins);
  if (pins == NULL) return -1;
  for (int i = 0; i < tej.motors; ++i) {
    bad |= new_float(id, &pins->command[i], HAL_IN, 0, "truepose_tej.%d.command", i);
    bad |= new_float(id, &pins->offset[i], HAL_IN, 0, "truepose_tej.%d.motor-offset", i);
    bad |= new_float(id, &pins->motor_fb[i], HAL_IN, 0, "truepose_tej.%d.motor-fb", i);
    bad |= new_float(id, &pins->pid_fb[i], HAL_OUT, 0, "truepose_tej.%d.pid-fb", i);
    bad |= new_float(id, &pins->correction[i], HAL_OUT, 0, "truepose_tej.%d.correction", i);
    bad |= new_float(id, &pins->e_q[i], HAL_OUT, 0, "truepose_tej.%d.e-q", i);
  }
  for (int k = 0; k < tej.sensors; ++k) {
    bad |= new_float(id, &pins->position[k], HAL_IN, 0, "truepose_tej.sensor.%d.position", k);
    bad |= new_float(id, &pins->index_angle[k], HAL_IN, 0, "truepose_tej.sensor.%d.index-angle", k);
    bad |= new_bit(id, &pins->index_enable[k], HAL_IO, 0, "truepose_tej.sensor.%d.index-enable", k);
    bad |= new_bit(id, &pins->absolute[k], HAL_IN, 0, "truepose_tej.sensor.%d.absolute", k);
    bad |= new_bit(id, &pins->referenced[k], HAL_OUT, 0, "truepose_tej.sensor.%d.referenced", k);
  }
  bad |= new_bit(id, &pins->enable, HAL_IN, 0, "truepose_tej.enable");
  bad |= new_bit(id, &pins->watch, HAL_IN, 0, "truepose_tej.watch");
  bad |= new_bit(id, &pins->reset, HAL_IN, 0, "truepose_tej.reset");
  bad |= new_bit(id, &pins->fault, HAL_OUT, 0, "truepose_tej.fault");
  bad |= new_bit(id, &pins->lost, HAL_OUT, 0, "truepose_tej.amp-fault");
  bad |= new_bit(id, &pins->stop, HAL_OUT, 0, "truepose_tej.stop");
  bad |= new_bit(id, &pins->all_referenced, HAL_OUT, 0, "truepose_tej.referenced");
  bad |= new_s32(id, &pins->law, HAL_IN, TRUEPOSE_LAW_JOINT, "truepose_tej.law");
  bad |= new_s32(id, &pins->in_effect, HAL_OUT, 0, "truepose_tej.law-in-effect");
  bad |= new_s32(id, &pins->fault_code, HAL_OUT, 0, "truepose_tej.fault-code");
  bad |= new_s32(id, &pins->status, HAL_OUT, 0, "truepose_tej.status");
  bad |= new_s32(id, &pins->part, HAL_OUT, 0, "truepose_tej.part");
  bad |= new_float(id, &pins->band, HAL_IN, 0, "truepose_tej.band");
  bad |= new_float(id, &pins->blend, HAL_IN, 0.2, "truepose_tej.blend-time");
  bad |= new_float(id, &pins->largest, HAL_IN, 5, "truepose_tej.largest-correction");
  return bad;
}

static int begin(void) {
  const char* const why = truepose_read_table(table, &tej.table);
  truepose_outcome outcome;
  if (why != NULL) return wrong("truepose_tej", "table", table, why);
  if (truepose_unit(unit) == 0) return wrong("truepose_tej", "unit", unit, "choose mm, inch or m");
  outcome = truepose_corrector_begin(&tej, 1e-6 * period_us);
  if (outcome.status > TRUEPOSE_OK)
    return wrong("truepose_tej", "table", table, truepose_describe(outcome.status));
  for (int c = 0; c < tej.motors + tej.sensors; ++c)
    scale[c] = truepose_reading_scale(&tej.table.robot, c, truepose_unit(unit));
  return make_pins() != 0 ? -1 : hal_export_funct("truepose_tej", cycle, NULL, 1, 0, id);
}

int rtapi_app_main(void) {
  id = hal_init("truepose_tej");
  if (id < 0) return id;
  if (begin() != 0) {
    hal_exit(id);
    return -22;
  }
  hal_ready(id);
  return 0;
}
void rtapi_app_exit(void) { hal_exit(id); }
