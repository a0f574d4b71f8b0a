/* HAL component of the redundant sensors' law, between motion and pid. Guide: ../docs/linuxcnc.md;
 * mathematics: tej_core.c. MIT.
 *
 *   loadrt truepose_tej table=FILE [unit=mm|inch|m] [period_us=1000] [keep=FILE]
 *   addf truepose_tej servo-thread      # after motion-controller, before pid */
#define COMPONENT "truepose_tej"
#include "component.h"

#include "start_core.h"

#include <stdio.h>

MODULE_DESCRIPTION("Motor errors from redundant sensors");

static int period_us = 1000;
RTAPI_MP_INT(period_us, "of the thread, microseconds");

static char* keep = "";
RTAPI_MP_STRING(keep, "file of the identified parameters: read when loaded, written when unloaded");

static struct tej_pins {
  hal_float_t *command[6], *offset[6], *motor_fb[6], *pid_fb[6], *correction[6], *e_q[6];
  hal_float_t *pose[6], *chi2, *largest_chi2;
  hal_bit_t *homed[6], *amp_fault[6];
  hal_s32_t* symptom[TRUEPOSE_READINGS];
  hal_float_t *position[TRUEPOSE_SENSORS], *index_angle[TRUEPOSE_SENSORS];
  hal_bit_t *index_enable[TRUEPOSE_SENSORS], *absolute[TRUEPOSE_SENSORS];
  hal_bit_t* referenced[TRUEPOSE_SENSORS];
  hal_bit_t *enable, *monitor, *reset, *fault, *stop, *lost, *all_referenced;
  hal_s32_t *law, *in_effect, *fault_code, *status, *part;
  hal_float_t *band, *blend, *largest;
  hal_bit_t *learn, *use_learnt, *failed[TRUEPOSE_READINGS];
  hal_u32_t *lines, *left_out;
  hal_s32_t* learner_status;
  hal_float_t *rest, *sigma[6];
  hal_bit_t *safety, *frame_known, *brake[6];
  hal_u32_t *frame, *safety_causes;
  hal_s32_t *safety_state, *safety_cause, *safety_motor;
  hal_float_t *safe_speed[6], *safe_error[6];
  hal_bit_t *observe, *warm;
  hal_s32_t *disturbance, *disturbance_motor;
  hal_float_t *torque_fb[6], *disturbance_size, *disturbance_sigma, *disturbance_chi2;
  hal_bit_t *start_test, *start_active;
  hal_s32_t *start_level, *start_reached, *start_state, *start_finding, *start_part, *start_other;
  hal_u32_t* start_candidates;
  hal_float_t *brake_closes, *brake_opens, *start_motion, *torque[6];
}* pins;

static truepose_corrector tej;
static truepose_starter starter;
static truepose_index seen[TRUEPOSE_SENSORS];
static truepose_real scale[TRUEPOSE_READINGS], pose_scale[6];
static uint32_t told_causes; /* of the safety shell, in the log */
static int32_t told, waits;  /* fault in the log; whether "waiting for an index" is in the log */
static int32_t disturbed;    /* disturbance in the log */
static int32_t unproven;     /* whether "has not passed" is in the log */
static uint32_t told_failed; /* failed readings in the log */

/** Reads the sensors. @return those whose zero is known, as bits */
static uint32_t sensors(truepose_real* readings) {
  uint32_t all = 0;
  for (int k = 0; k < tej.sensors; ++k) {
    int asks = *pins->index_enable[k];
    /* A reading must not jump to its index during a start-up test. */
    if (starter.running && !seen[k].known) seen[k].armed = asks = 0;
    const int known = *pins->absolute[k] || truepose_index_cycle(&seen[k], *pins->enable, &asks);
    *pins->index_enable[k] = asks;
    *pins->referenced[k] = known;
    all |= (uint32_t)known << k;
    const truepose_real from = *pins->absolute[k] ? 0 : *pins->index_angle[k];
    readings[k] = (*pins->position[k] + from) * scale[tej.motors + k];
  }
  return all;
}

/** Name of a reading in messages. */
static const char* name_of(int reading, char* name, int size) {
  if (reading < 0) return "";
  if (reading < tej.motors)
    rtapi_snprintf(name, size, ", motor %d", reading);
  else
    rtapi_snprintf(name, size, ", sensor %d", reading - tej.motors);
  return name;
}

/** Logs each fault, each failed reading and a law's wait for an index once. */
static void tell(const truepose_corrector_input* in, int32_t index_known) {
  static const char* const symptoms[] = {"no symptom", "missing", "out of range",
                                         "too fast",   "stuck",   "disagrees with the others",
                                         "noisy"};
  char name[32];
  static const char* const why[] = {
      "no fault",
      "a reading is no number",
      "a command is no number",
      "no answer for this pose",
      "the correction is larger than largest-correction",
      "the fault monitor requests a stop, or every sensor has failed",
      "readings contradict each other: home again, or acknowledge "
      "by the pin reset",
      "the safety shell stops the robot: acknowledge by the pin reset"};
  static const char* const forces[] = {"", "payload (kg)", "friction (N·m or N)", "contact (N)"};
  const int32_t waiting = in->enable && in->law != TRUEPOSE_LAW_JOINT && !index_known;
  const uint32_t fails = tej.left_out & ~told_failed;
  if (waiting && !waits)
    rtapi_print_msg(RTAPI_MSG_ERR,
                    "truepose_tej: the joint law, until a sensor's index is passed\n");
  waits = waiting;
  told_failed = tej.left_out;
  for (int c = 0; c < tej.motors + tej.sensors; ++c)
    if (fails >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: a reading has failed%s: %s\n",
                      name_of(c, name, sizeof name), symptoms[tej.symptom[c]]);
  for (int c = TRUEPOSE_STOP_REQUESTED + 1; c <= TRUEPOSE_STOP_NOT_READY; ++c)
    if ((tej.safe.causes & ~told_causes) >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: safety: %s%s\n", truepose_stop_cause_text(c),
                      name_of(c == tej.safe.cause ? tej.safe.part : -1, name, sizeof name));
  told_causes = tej.safe.causes;
  if (tej.disturbance.kind != disturbed && tej.disturbance.kind != TRUEPOSE_NO_DISTURBANCE)
    rtapi_print_msg(RTAPI_MSG_INFO, "truepose_tej: %s of %.3g%s\n", forces[tej.disturbance.kind],
                    (double)tej.disturbance.size,
                    name_of(tej.disturbance.motor, name, sizeof name));
  disturbed = tej.disturbance.kind;
  if (tej.fault == told) return;
  told = tej.fault;
  if (told != 0)
    rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: fault %d: %s (%s%s)\n", told, why[told],
                    truepose_status_text(tej.reason.status),
                    name_of(tej.reason.part, name, sizeof name));
}

/** Logs the result of a start-up test, and a machine on without one. */
static void tell_start(const truepose_corrector_input* in, int ended) {
  const truepose_start_report* const report = &starter.report;
  char part[32], other[32];
  const int refused = in->enable && in->safety && !in->proven;
  if (refused && !unproven)
    rtapi_print_msg(RTAPI_MSG_ERR,
                    "truepose_tej: brakes stay closed until a start-up test passes: "
                    "machine off, then pin start-test\n");
  unproven = refused;
  if (!ended) return;
  if (starter.reached)
    rtapi_print_msg(RTAPI_MSG_INFO, "truepose_tej: start-up test passed, level %d\n",
                    starter.reached);
  else
    rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: start-up test: %s%s%s\n",
                    truepose_start_finding_text(report->finding),
                    name_of(report->part, part, sizeof part),
                    name_of(report->other, other, sizeof other));
  for (int c = 0; c < tej.motors + tej.sensors; ++c)
    if (report->candidates >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: start-up test: may be miswired%s\n",
                      name_of(c, part, sizeof part));
}

/** The start-up test's cycle. */
static void start_cycle(const truepose_corrector_input* in, int32_t homed, uint32_t known) {
  const truepose_starter_input wanted = {.request = *pins->start_test,
                                         .level = *pins->start_level,
                                         .brake = *pins->brake_closes,
                                         .opens = *pins->brake_opens,
                                         .motion = *pins->start_motion * truepose_unit(unit),
                                         .homed = homed,
                                         .known = known};
  const int ended = truepose_starter_cycle(&starter, &wanted, &tej, in);
  for (int i = 0; i < tej.motors; ++i) {
    *pins->torque[i] = starter.pulses ? starter.report.torque[i] : 0;
    if (!starter.running) continue;
    *pins->brake[i] = starter.report.brakes >> i & 1U;
    *pins->amp_fault[i] = 1; /* the machine cannot go on */
  }
  *pins->start_active = starter.pulses;
  *pins->start_reached = starter.reached;
  *pins->start_state = starter.report.state;
  *pins->start_finding = starter.report.finding;
  *pins->start_part = starter.report.part;
  *pins->start_other = starter.report.other;
  *pins->start_candidates = starter.report.candidates;
  tell_start(in, ended);
}

static void cycle(void* unused, long period) {
  static truepose_corrector_input in;
  int32_t index_known, all_homed = 1;
  uint32_t known;
  (void)unused;
  (void)period;
  in.enable = *pins->enable;
  in.law = *pins->law;
  in.monitor = *pins->monitor;
  in.reset = *pins->reset;
  in.observe = *pins->observe;
  in.safety = *pins->safety;
  in.proven = !starter.running && starter.reached >= *pins->start_level;
  in.frame = *pins->frame;
  in.frame_known = *pins->frame_known;
  in.learn = *pins->learn;
  in.learnt = *pins->use_learnt;
  in.rest = *pins->rest;
  in.band = *pins->band;
  in.blend = *pins->blend;
  in.chi2 = *pins->largest_chi2;
  for (int i = 0; i < tej.motors; ++i) {
    in.torque[i] = *pins->torque_fb[i];
    in.q_d[i] = (*pins->command[i] - *pins->offset[i]) * scale[i];
    in.q_e[i] = (*pins->motor_fb[i] - *pins->offset[i]) * scale[i];
    in.zero[i] = *pins->offset[i] * scale[i];
    in.largest[i] = *pins->largest * scale[i];
    in.speed[i] = *pins->safe_speed[i] * scale[i];
    in.error_limit[i] = *pins->safe_error[i] * scale[i];
    all_homed = all_homed && *pins->homed[i];
  }
  known = sensors(in.q_e + tej.motors);
  index_known = known == (1U << tej.sensors) - 1;
  in.referenced = index_known && all_homed;
  truepose_corrector_cycle(&tej, &in);
  for (int i = 0; i < tej.motors; ++i) {
    if (tej.fault != TRUEPOSE_TEJ_COMMAND)
      *pins->pid_fb[i] = *pins->command[i] - tej.error[i] / scale[i];
    *pins->correction[i] = tej.correction[i] / scale[i];
    *pins->e_q[i] = tej.e_q[i] / scale[i];
    *pins->amp_fault[i] = tej.lost >> i & 1U;
    *pins->brake[i] = tej.brakes >> i & 1U;
    *pins->pose[i] = tej.pose[i] / pose_scale[i];
  }
  *pins->all_referenced = in.referenced;
  *pins->in_effect = tej.law;
  *pins->fault = tej.fault != TRUEPOSE_TEJ_NO_FAULT;
  *pins->fault_code = tej.fault;
  *pins->stop = tej.inhibit;
  *pins->safety_state = tej.safe.state;
  *pins->safety_cause = tej.safe.cause;
  *pins->safety_motor = tej.safe.cause != TRUEPOSE_STOP_NONE ? tej.safe.part : -1;
  *pins->safety_causes = tej.safe.causes;
  *pins->lost = tej.lost != 0;
  *pins->chi2 = tej.chi2;
  *pins->status = (tej.reason.status != TRUEPOSE_OK ? tej.reason : tej.outcome).status;
  *pins->part = (tej.reason.status != TRUEPOSE_OK ? tej.reason : tej.outcome).part;
  for (int c = 0; c < tej.motors + tej.sensors; ++c) {
    *pins->failed[c] = tej.left_out >> c & 1U;
    *pins->symptom[c] = tej.symptom[c];
  }
  *pins->lines = (hal_u32_t)tej.pupil.lines;
  *pins->left_out = (hal_u32_t)tej.pupil.left_out;
  *pins->learner_status = tej.pupil.outcome.status;
  for (int k = 0; k < tej.motors; ++k) *pins->sigma[k] = tej.pupil.sigma[k] / pose_scale[k];
  *pins->warm = tej.warm;
  *pins->disturbance = tej.disturbance.kind;
  *pins->disturbance_motor = tej.disturbance.motor;
  *pins->disturbance_size = tej.disturbance.size;
  *pins->disturbance_sigma = tej.disturbance.sigma;
  *pins->disturbance_chi2 = tej.disturbance.chi2;
  tell(&in, index_known);
  start_cycle(&in, all_homed, known);
}

static int make_pins(void) {
  int bad = 0;
  pins = hal_malloc(sizeof *pins);
  if (pins == NULL) return -1;
  for (int i = 0; i < tej.motors; ++i) {
    bad |= new_float(&pins->command[i], HAL_IN, 0, "truepose_tej.%d.command", i);
    bad |= new_float(&pins->offset[i], HAL_IN, 0, "truepose_tej.%d.motor-offset", i);
    bad |= new_float(&pins->motor_fb[i], HAL_IN, 0, "truepose_tej.%d.motor-fb", i);
    bad |= new_float(&pins->pid_fb[i], HAL_OUT, 0, "truepose_tej.%d.pid-fb", i);
    bad |= new_float(&pins->correction[i], HAL_OUT, 0, "truepose_tej.%d.correction", i);
    bad |= new_float(&pins->e_q[i], HAL_OUT, 0, "truepose_tej.%d.e-q", i);
    bad |= new_float(&pins->torque_fb[i], HAL_IN, 0, "truepose_tej.%d.torque-fb", i);
    bad |= new_float(&pins->torque[i], HAL_OUT, 0, "truepose_tej.%d.torque", i);
  }
  for (int k = 0; k < tej.sensors; ++k) {
    bad |= new_float(&pins->position[k], HAL_IN, 0, "truepose_tej.sensor.%d.position", k);
    bad |= new_float(&pins->index_angle[k], HAL_IN, 0, "truepose_tej.sensor.%d.index-angle", k);
    bad |= new_bit(&pins->index_enable[k], HAL_IO, 0, "truepose_tej.sensor.%d.index-enable", k);
    bad |= new_bit(&pins->absolute[k], HAL_IN, 0, "truepose_tej.sensor.%d.absolute", k);
    bad |= new_bit(&pins->referenced[k], HAL_OUT, 0, "truepose_tej.sensor.%d.referenced", k);
  }
  for (int c = 0; c < tej.motors; ++c) {
    bad |= new_bit(&pins->failed[c], HAL_OUT, 0, "truepose_tej.%d.failed", c);
    bad |= new_s32(&pins->symptom[c], HAL_OUT, 0, "truepose_tej.%d.symptom", c);
    bad |= new_bit(&pins->amp_fault[c], HAL_OUT, 0, "truepose_tej.%d.amp-fault", c);
    bad |= new_bit(&pins->homed[c], HAL_IN, 1, "truepose_tej.%d.homed", c);
    bad |= new_bit(&pins->brake[c], HAL_OUT, 1, "truepose_tej.%d.brake", c);
    bad |= new_float(&pins->safe_speed[c], HAL_IN, 0, "truepose_tej.%d.safe-speed", c);
    bad |= new_float(&pins->safe_error[c], HAL_IN, 5, "truepose_tej.%d.safe-error", c);
    bad |= new_float(&pins->pose[c], HAL_OUT, 0, "truepose_tej.pose.%d", c);
    bad |= new_float(&pins->sigma[c], HAL_OUT, 0, "truepose_tej.pose-sigma.%d", c);
  }
  for (int k = 0; k < tej.sensors; ++k) {
    const int c = tej.motors + k;
    bad |= new_bit(&pins->failed[c], HAL_OUT, 0, "truepose_tej.sensor.%d.failed", k);
    bad |= new_s32(&pins->symptom[c], HAL_OUT, 0, "truepose_tej.sensor.%d.symptom", k);
  }
  bad |= new_bit(&pins->learn, HAL_IN, 0, "truepose_tej.learn");
  bad |= new_bit(&pins->use_learnt, HAL_IN, 1, "truepose_tej.use-learnt");
  bad |= new_float(&pins->rest, HAL_IN, 0.2, "truepose_tej.learn-rest");
  bad |= new_u32(&pins->lines, HAL_OUT, 0, "truepose_tej.lines");
  bad |= new_u32(&pins->left_out, HAL_OUT, 0, "truepose_tej.lines-left-out");
  bad |= new_s32(&pins->learner_status, HAL_OUT, 0, "truepose_tej.learner-status");
  bad |= new_bit(&pins->safety, HAL_IN, 0, "truepose_tej.safety");
  bad |= new_bit(&pins->frame_known, HAL_IN, 0, "truepose_tej.frame-known");
  bad |= new_u32(&pins->frame, HAL_IN, 0, "truepose_tej.frame");
  bad |= new_s32(&pins->safety_state, HAL_OUT, 0, "truepose_tej.safety-state");
  bad |= new_s32(&pins->safety_cause, HAL_OUT, 0, "truepose_tej.safety-cause");
  bad |= new_s32(&pins->safety_motor, HAL_OUT, -1, "truepose_tej.safety-motor");
  bad |= new_u32(&pins->safety_causes, HAL_OUT, 0, "truepose_tej.safety-causes");
  bad |= new_bit(&pins->observe, HAL_IN, 0, "truepose_tej.observe");
  bad |= new_bit(&pins->warm, HAL_OUT, 0, "truepose_tej.warm");
  bad |= new_s32(&pins->disturbance, HAL_OUT, 0, "truepose_tej.disturbance");
  bad |= new_s32(&pins->disturbance_motor, HAL_OUT, -1, "truepose_tej.disturbance-motor");
  bad |= new_float(&pins->disturbance_size, HAL_OUT, 0, "truepose_tej.disturbance-size");
  bad |= new_float(&pins->disturbance_sigma, HAL_OUT, 0, "truepose_tej.disturbance-sigma");
  bad |= new_float(&pins->disturbance_chi2, HAL_OUT, 0, "truepose_tej.disturbance-chi2");
  bad |= new_bit(&pins->start_test, HAL_IN, 0, "truepose_tej.start-test");
  bad |= new_s32(&pins->start_level, HAL_IN, 0, "truepose_tej.start-level");
  bad |= new_float(&pins->brake_closes, HAL_IN, 0.02, "truepose_tej.brake-closes");
  bad |= new_float(&pins->brake_opens, HAL_IN, 0.02, "truepose_tej.brake-opens");
  bad |= new_float(&pins->start_motion, HAL_IN, 0.5e-3 / truepose_unit(unit),
                   "truepose_tej.start-motion");
  bad |= new_bit(&pins->start_active, HAL_OUT, 0, "truepose_tej.start-active");
  bad |= new_s32(&pins->start_reached, HAL_OUT, 0, "truepose_tej.start-reached");
  bad |= new_s32(&pins->start_state, HAL_OUT, 0, "truepose_tej.start-state");
  bad |= new_s32(&pins->start_finding, HAL_OUT, 0, "truepose_tej.start-finding");
  bad |= new_s32(&pins->start_part, HAL_OUT, -1, "truepose_tej.start-part");
  bad |= new_s32(&pins->start_other, HAL_OUT, -1, "truepose_tej.start-other");
  bad |= new_u32(&pins->start_candidates, HAL_OUT, 0, "truepose_tej.start-candidates");
  bad |= new_bit(&pins->enable, HAL_IN, 0, "truepose_tej.enable");
  bad |= new_bit(&pins->monitor, HAL_IN, 0, "truepose_tej.monitor");
  bad |= new_bit(&pins->reset, HAL_IN, 0, "truepose_tej.reset");
  bad |= new_bit(&pins->fault, HAL_OUT, 0, "truepose_tej.fault");
  bad |= new_bit(&pins->lost, HAL_OUT, 0, "truepose_tej.amp-fault");
  bad |= new_bit(&pins->stop, HAL_OUT, 0, "truepose_tej.stop");
  bad |= new_bit(&pins->all_referenced, HAL_OUT, 0, "truepose_tej.referenced");
  bad |= new_s32(&pins->law, HAL_IN, TRUEPOSE_LAW_JOINT, "truepose_tej.law");
  bad |= new_s32(&pins->in_effect, HAL_OUT, 0, "truepose_tej.law-in-effect");
  bad |= new_s32(&pins->fault_code, HAL_OUT, 0, "truepose_tej.fault-code");
  bad |= new_s32(&pins->status, HAL_OUT, 0, "truepose_tej.status");
  bad |= new_s32(&pins->part, HAL_OUT, 0, "truepose_tej.part");
  bad |= new_float(&pins->band, HAL_IN, 0, "truepose_tej.band");
  bad |= new_float(&pins->blend, HAL_IN, 0.2, "truepose_tej.blend-time");
  bad |= new_float(&pins->largest, HAL_IN, 5, "truepose_tej.largest-correction");
  bad |= new_float(&pins->chi2, HAL_OUT, 0, "truepose_tej.chi2");
  bad |= new_float(&pins->largest_chi2, HAL_IN, 0, "truepose_tej.largest-chi2");
  return bad;
}

/** Replaces the table by what an earlier session identified from this same table. */
static int remember(void) {
  const uint64_t from = tej.table.from;
  FILE* const there = fopen(keep, "rb");
  const char* why = NULL;
  if (there == NULL) return 0; /* nothing was identified yet */
  fclose(there);
  why = truepose_read_table(keep, &tej.table);
  if (why == NULL && tej.table.from == from) return 0;
  wrong("keep", keep, why != NULL ? why : "was learnt of another table: begins with the table");
  return read_parameters(&tej.table);
}

static int begin(void) {
  static truepose_description commanded;
  if (read_parameters(&tej.table) != 0) return -1;
  commanded = tej.table.robot;
  if (*keep != '\0' && remember() != 0) return -1;
  if (refused("table", table, truepose_corrector_begin(&tej, &commanded, 1e-6 * period_us)) != 0)
    return -1;
  for (int c = 0; c < tej.motors + tej.sensors; ++c)
    scale[c] = truepose_reading_scale(&commanded, c, truepose_unit(unit));
  for (int k = 0; k < tej.motors; ++k)
    pose_scale[k] = truepose_freedom_scale(&commanded, k, truepose_unit(unit));
  return make_pins() != 0 ? -1 : hal_export_funct("truepose_tej", cycle, NULL, 1, 0, id);
}

void rtapi_app_exit(void) {
  const char* why = NULL;
  hal_exit(id);
  if (*keep != '\0' && tej.pupil.lines + tej.pupil.left_out > 0)
    why = truepose_pupil_keep(&tej.pupil, &tej.table, keep);
  if (why != NULL) wrong("keep", keep, why);
}
