/* HAL component of the redundant sensors' law, between motion and pid. Guide: ../docs/linuxcnc.md;
 * mathematics: tej_core.c. MIT.
 *
 *   loadrt truepose_tej table=FILE [unit=mm|inch|m] [period_us=1000] [keep=FILE]
 *   addf truepose_tej servo-thread      # after motion-controller, before pid */
#define COMPONENT "truepose_tej"
#define PINS(PIN)                                                                        \
  PIN(MOTOR, float, IN, command, "command", 0)                                           \
  PIN(MOTOR, float, IN, offset, "motor-offset", 0)                                       \
  PIN(MOTOR, float, IN, motor_fb, "motor-fb", 0)                                         \
  PIN(MOTOR, float, OUT, pid_fb, "pid-fb", 0)                                            \
  PIN(MOTOR, float, OUT, correction, "correction", 0)                                    \
  PIN(MOTOR, float, OUT, e_q, "e-q", 0)                                                  \
  PIN(MOTOR, float, IN, torque_fb, "torque-fb", 0)                                       \
  PIN(MOTOR, float, OUT, torque, "torque", 0)                                            \
  PIN(MOTOR, bit, OUT, amp_fault, "amp-fault", 0)                                        \
  PIN(MOTOR, bit, IN, homed, "homed", 1)                                                 \
  PIN(MOTOR, bit, OUT, brake, "brake", 1)                                                \
  PIN(MOTOR, float, IN, safe_speed, "safe-speed", 0)                                     \
  PIN(MOTOR, float, IN, safe_error, "safe-error", 5)                                     \
  PIN(POSE, float, OUT, pose, "pose", 0)                                                 \
  PIN(POSE, float, OUT, sigma, "pose-sigma", 0)                                          \
  PIN(SENSOR, float, IN, position, "position", 0)                                        \
  PIN(SENSOR, float, IN, index_angle, "index-angle", 0)                                  \
  PIN(SENSOR, bit, IO, index_enable, "index-enable", 0)                                  \
  PIN(SENSOR, bit, IN, absolute, "absolute", 0)                                          \
  PIN(SENSOR, bit, OUT, referenced, "referenced", 0)                                     \
  PIN(READING, bit, OUT, failed, "failed", 0)                                            \
  PIN(READING, s32, OUT, symptom, "symptom", 0)                                          \
  PIN(ONE, bit, IN, learn, "learn", 0)                                                   \
  PIN(ONE, bit, IN, use_learnt, "use-learnt", 1)                                         \
  PIN(ONE, float, IN, rest, "learn-rest", 0.2)                                           \
  PIN(ONE, u32, OUT, lines, "lines", 0, tej.pupil.lines)                                 \
  PIN(ONE, u32, OUT, left_out, "lines-left-out", 0, tej.pupil.left_out)                  \
  PIN(ONE, s32, OUT, learner_status, "learner-status", 0, tej.pupil.outcome.status)      \
  PIN(ONE, port, IN, geometry, "geometry", 0)                                            \
  PIN(ONE, s32, OUT, geometry_state, "geometry-state", 0, exchange.state)                \
  PIN(ONE, u32, OUT, geometry_used, "geometry-used", 0, exchange.used)                   \
  PIN(READING, float, OUT, reading, "reading", 0)                                        \
  PIN(ONE, bit, OUT, unhealthy, "unhealthy", 1,                                          \
      !in.referenced || tej.fault != TRUEPOSE_TEJ_NO_FAULT || tej.doubted != 0)          \
  PIN(ONE, bit, IN, safety, "safety", 0)                                                 \
  PIN(ONE, bit, IN, frame_known, "frame-known", 0)                                       \
  PIN(ONE, u32, IN, frame, "frame", 0)                                                   \
  PIN(ONE, s32, OUT, safety_state, "safety-state", 0, tej.safe.state)                    \
  PIN(ONE, s32, OUT, safety_cause, "safety-cause", 0, tej.safe.cause)                    \
  PIN(ONE, s32, OUT, safety_motor, "safety-motor", -1,                                   \
      tej.safe.cause != TRUEPOSE_STOP_NONE ? tej.safe.part : -1)                         \
  PIN(ONE, u32, OUT, safety_causes, "safety-causes", 0, tej.safe.causes)                 \
  PIN(ONE, bit, IN, observe, "observe", 0)                                               \
  PIN(ONE, s32, OUT, disturbance, "disturbance", 0, tej.disturbance.kind)                \
  PIN(ONE, s32, OUT, disturbance_motor, "disturbance-motor", -1, tej.disturbance.motor)  \
  PIN(ONE, float, OUT, disturbance_size, "disturbance-size", 0, tej.disturbance.size)    \
  PIN(ONE, float, OUT, disturbance_sigma, "disturbance-sigma", 0, tej.disturbance.sigma) \
  PIN(ONE, float, OUT, disturbance_chi2, "disturbance-chi2", 0, tej.disturbance.chi2)    \
  PIN(ONE, bit, IN, start_test, "start-test", 0)                                         \
  PIN(ONE, s32, IN, start_level, "start-level", 0)                                       \
  PIN(ONE, float, IN, brake_closes, "brake-closes", 0.02)                                \
  PIN(ONE, float, IN, brake_opens, "brake-opens", 0.02)                                  \
  PIN(ONE, float, IN, start_motion, "start-motion", 0.5e-3 / truepose_unit(unit))        \
  PIN(ONE, bit, OUT, start_active, "start-active", 0, starter.pulses)                    \
  PIN(ONE, s32, OUT, start_reached, "start-reached", 0, starter.reached)                 \
  PIN(ONE, s32, OUT, start_state, "start-state", 0, starter.report.state)                \
  PIN(ONE, s32, OUT, start_finding, "start-finding", 0, starter.report.finding)          \
  PIN(ONE, s32, OUT, start_part, "start-part", -1, starter.report.part)                  \
  PIN(ONE, s32, OUT, start_other, "start-other", -1, starter.report.other)               \
  PIN(ONE, u32, OUT, start_candidates, "start-candidates", 0, starter.report.candidates) \
  PIN(ONE, bit, IN, enable, "enable", 0)                                                 \
  PIN(ONE, bit, IN, monitor, "monitor", 0)                                               \
  PIN(ONE, bit, IN, reset, "reset", 0)                                                   \
  PIN(ONE, bit, OUT, fault, "fault", 0, tej.fault != TRUEPOSE_TEJ_NO_FAULT)              \
  PIN(ONE, bit, OUT, lost, "amp-fault", 0, tej.lost != 0)                                \
  PIN(ONE, bit, OUT, stop, "stop", 0, tej.inhibit)                                       \
  PIN(ONE, bit, OUT, all_referenced, "referenced", 0, in.referenced)                     \
  PIN(ONE, s32, IN, law, "law", TRUEPOSE_LAW_JOINT)                                      \
  PIN(ONE, s32, OUT, in_effect, "law-in-effect", 0, tej.law)                             \
  PIN(ONE, s32, OUT, fault_code, "fault-code", 0, tej.fault)                             \
  PIN(ONE, s32, OUT, status, "status", 0,                                                \
      (tej.reason.status != TRUEPOSE_OK ? tej.reason : tej.outcome).status)              \
  PIN(ONE, s32, OUT, part, "part", 0,                                                    \
      (tej.reason.status != TRUEPOSE_OK ? tej.reason : tej.outcome).part)                \
  PIN(ONE, float, IN, band, "band", 0)                                                   \
  PIN(ONE, float, IN, blend, "blend-time", 0.2)                                          \
  PIN(ONE, float, IN, largest, "largest-correction", 5)                                  \
  PIN(ONE, float, OUT, chi2, "chi2", 0, tej.pupil.chi2)                                  \
  PIN(ONE, float, IN, largest_chi2, "largest-chi2", 0)
#include "cycles.h"

#include "exchange_core.h"
#include "start_core.h"

#include <stdio.h>

MODULE_DESCRIPTION("Motor errors from redundant sensors");

static char* keep = "";
RTAPI_MP_STRING(keep, "file of the identified parameters: read when loaded, written when unloaded");

static truepose_corrector tej;
static truepose_starter starter;
static truepose_exchange exchange;
static truepose_index seen[TRUEPOSE_SENSORS];
static uint32_t told_causes; /* of the safety shell, in the log */
static int32_t told, waits;  /* fault in the log; whether "waiting for an index" is in the log */
static int32_t disturbed;    /* disturbance in the log */
static int32_t unproven;     /* whether "has not passed" is in the log */
static uint32_t told_failed; /* failed readings in the log */

/** Reads the sensors. @return those whose zero is known, as bits */
static uint32_t sensors(truepose_real* read) {
  uint32_t all = 0;
  for (int k = 0; k < tej.sensors; ++k) {
    int asks = *pin->index_enable[k];
    /* A reading must not jump to its index during a start-up test. */
    if (starter.running && !seen[k].known) seen[k].armed = asks = 0;
    const int known = *pin->absolute[k] || truepose_index_cycle(&seen[k], *pin->enable, &asks);
    *pin->index_enable[k] = asks;
    *pin->referenced[k] = known;
    all |= (uint32_t)known << k;
    const truepose_real from = *pin->absolute[k] ? 0 : *pin->index_angle[k];
    read[k] = (*pin->position[k] + from) * scale[motors + k];
  }
  return all;
}

/** Name of a reading in messages, which have two at most. */
static const char* name_of(int reading) {
  static char names[2][32];
  static int last;
  char* const name = names[last ^= 1];
  if (reading < 0) return "";
  if (reading < motors)
    rtapi_snprintf(name, sizeof *names, ", motor %d", reading);
  else
    rtapi_snprintf(name, sizeof *names, ", sensor %d", reading - motors);
  return name;
}

/** Logs each fault, each failed reading and a law's wait for an index once. */
static void tell(const truepose_corrector_input* in, int32_t index_known) {
  static const char* const symptoms[] = {"no symptom", "missing", "out of range",
                                         "too fast",   "stuck",   "disagrees with the others"};
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
  for (int c = 0; c < readings; ++c)
    if (fails >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: a reading has failed%s: %s\n", name_of(c),
                      symptoms[tej.symptom[c]]);
  for (int c = TRUEPOSE_STOP_REQUESTED + 1; c <= TRUEPOSE_STOP_NOT_READY; ++c)
    if ((tej.safe.causes & ~told_causes) >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: safety: %s%s\n", truepose_stop_cause_text(c),
                      name_of(c == tej.safe.cause ? tej.safe.part : -1));
  told_causes = tej.safe.causes;
  if (tej.disturbance.kind != disturbed && tej.disturbance.kind != TRUEPOSE_NO_DISTURBANCE)
    rtapi_print_msg(RTAPI_MSG_INFO, "truepose_tej: %s of %.3g%s\n", forces[tej.disturbance.kind],
                    (double)tej.disturbance.size, name_of(tej.disturbance.motor));
  disturbed = tej.disturbance.kind;
  if (tej.fault == told) return;
  told = tej.fault;
  if (told != 0)
    rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: fault %d: %s (%s%s)\n", told, why[told],
                    truepose_status_text(tej.reason.status), name_of(tej.reason.part));
}

/** Logs the result of a start-up test, and a machine on without one. */
static void tell_start(const truepose_corrector_input* in, int ended) {
  const truepose_start_report* const report = &starter.report;
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
                    truepose_start_finding_text(report->finding), name_of(report->part),
                    name_of(report->other));
  for (int c = 0; c < readings; ++c)
    if (report->candidates >> c & 1U)
      rtapi_print_msg(RTAPI_MSG_ERR, "truepose_tej: start-up test: may be miswired%s\n",
                      name_of(c));
}

/** The start-up test's cycle. */
static void start_cycle(const truepose_corrector_input* in, int32_t homed, uint32_t known) {
  const truepose_starter_input wanted = {.request = *pin->start_test,
                                         .level = *pin->start_level,
                                         .brake = *pin->brake_closes,
                                         .opens = *pin->brake_opens,
                                         .motion = *pin->start_motion * truepose_unit(unit),
                                         .homed = homed,
                                         .known = known};
  const int ended = truepose_starter_cycle(&starter, &wanted, &tej, in);
  for (int i = 0; i < motors; ++i) {
    *pin->torque[i] = starter.pulses ? starter.report.torque[i] : 0;
    if (!starter.running) continue;
    *pin->brake[i] = starter.report.brakes >> i & 1U;
    *pin->amp_fault[i] = 1; /* the machine cannot go on */
  }
  tell_start(in, ended);
}

/** Takes bytes of a robot from the pin `geometry`. */
static void receive(const truepose_corrector_input* in) {
  unsigned char bytes[1024];
  const uint32_t used = exchange.used, refused = exchange.refused;
  const hal_port_t port = *pin->geometry;
  size_t count = port != 0 ? hal_port_readable(port) : 0;
  if (count > sizeof bytes) count = sizeof bytes;
  if (count > 0 && !hal_port_read(port, (char*)bytes, count)) count = 0;
  truepose_exchange_cycle(&exchange, bytes, count, &tej, in);
  if (exchange.used != used)
    rtapi_print_msg(RTAPI_MSG_INFO, "truepose_tej: geometry %u is in use\n", exchange.used);
  if (exchange.refused != refused)
    rtapi_print_msg(RTAPI_MSG_ERR,
                    "truepose_tej: geometry refused: %s. The last good one stays in use\n",
                    exchange.why);
}

#define TAKE(member) in.member = *pin->member

static void cycle(void* unused, long period) {
  static truepose_corrector_input in;
  int32_t index_known, all_homed = 1;
  uint32_t known;
  TAKE(enable);
  TAKE(law);
  TAKE(monitor);
  TAKE(reset);
  TAKE(observe);
  TAKE(safety);
  TAKE(frame);
  TAKE(frame_known);
  TAKE(learn);
  TAKE(rest);
  TAKE(band);
  TAKE(blend);
  in.proven = !starter.running && starter.reached >= *pin->start_level;
  in.learnt = *pin->use_learnt;
  in.chi2 = *pin->largest_chi2;
  for (int i = 0; i < motors; ++i) {
    in.torque[i] = *pin->torque_fb[i];
    in.q_d[i] = (*pin->command[i] - *pin->offset[i]) * scale[i];
    in.q_e[i] = (*pin->motor_fb[i] - *pin->offset[i]) * scale[i];
    in.zero[i] = *pin->offset[i] * scale[i];
    in.largest[i] = *pin->largest * scale[i];
    in.speed[i] = *pin->safe_speed[i] * scale[i];
    in.error_limit[i] = *pin->safe_error[i] * scale[i];
    all_homed = all_homed && *pin->homed[i];
  }
  known = sensors(in.q_e + motors);
  index_known = known == (1U << tej.sensors) - 1;
  in.referenced = index_known && all_homed;
  truepose_corrector_cycle(&tej, &in);
  for (int i = 0; i < motors; ++i) {
    if (tej.fault != TRUEPOSE_TEJ_COMMAND)
      *pin->pid_fb[i] = *pin->command[i] - tej.error[i] / scale[i];
    *pin->correction[i] = tej.correction[i] / scale[i];
    *pin->e_q[i] = tej.e_q[i] / scale[i];
    *pin->amp_fault[i] = tej.lost >> i & 1U;
    *pin->brake[i] = tej.brakes >> i & 1U;
    *pin->pose[i] = tej.pose[i] / pose_scale[i];
  }
  receive(&in);
  for (int c = 0; c < readings; ++c) {
    *pin->reading[c] = in.q_e[c] - (c < motors ? tej.homed_by[c] : 0);
    *pin->failed[c] = tej.left_out >> c & 1U;
    *pin->symptom[c] = tej.symptom[c];
  }
  for (int k = 0; k < motors; ++k) *pin->sigma[k] = tej.pupil.sigma[k] / pose_scale[k];
  tell(&in, index_known);
  start_cycle(&in, all_homed, known);
  PINS(TRUEPOSE_SHOW)
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
  truepose_exchange_begin(&exchange);
  commanded = tej.table.robot;
  if (*keep != '\0' && remember() != 0) return -1;
  if (refused("table", table, truepose_corrector_begin(&tej, &commanded, 1e-6 * period_us)) != 0)
    return -1;
  return begin_cycles(&commanded, cycle);
}

void rtapi_app_exit(void) {
  const char* why = NULL;
  hal_exit(id);
  if (*keep != '\0' && tej.pupil.lines + tej.pupil.left_out > 0)
    why = truepose_pupil_keep(&tej.pupil, &tej.table, keep);
  if (why != NULL) wrong("keep", keep, why);
}
