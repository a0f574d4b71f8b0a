/* Cost of one robot: an H4, or the one of vectors.h that ROBOT names. Prints the self-test, then a
 * table of instructions and stack per call. */
#include <math.h>

#include "agree.h"
#include "board.h"
#include "truepose_safety.h"
#include "vectors.h"

#ifndef ROBOT
#define ROBOT h4
#endif
#define JOINED(robot, name) robot##_##name
#define NAMED(robot, name) JOINED(robot, name)
#define ITS(name) NAMED(ROBOT, name) /* h4_x, … */

enum { CYCLES = 100, WORK = 4000, MEMORY = 16000, COUNTED = 1000000 };

static truepose_model model;
static truepose_controller controller;
static truepose_fault_monitor monitor;
static truepose_online_calibrator calibrator;
static truepose_fault_report report;
static truepose_safety_shell shell;
static truepose_safety_report safe;
static truepose_safety_marks marks;
static truepose_servo_cycle servo_cycle;
static truepose_real work[WORK], memory[MEMORY], out[TRUEPOSE_MOTORS * TRUEPOSE_READINGS];
static truepose_setpoint setpoint;
static truepose_real q[TRUEPOSE_MOTORS], q_e[TRUEPOSE_READINGS], near[TRUEPOSE_FREEDOMS];
static int n, e;
static uint32_t per_tick;

/* A 100 ms cosine move between two of the reference's poses, with readings that disagree like a
 * real robot's. */
static void at_cycle(int cycle) {
  const double w = 3.141592653589793 / CYCLES, s = 0.5 - 0.5 * cos(w * cycle);
  for (int i = 0; i < n; ++i) {
    const double way = ITS(x)[n + i] - ITS(x)[i];
    near[i] = setpoint.x[i];
    setpoint.x[i] = ITS(x)[i] + s * way;
    setpoint.rate[i] = 1000 * 0.5 * w * sin(w * cycle) * way;
    setpoint.acceleration[i] = 1e6 * 0.5 * w * w * cos(w * cycle) * way;
  }
  truepose_readings(&model, setpoint.x, q_e);
  for (int i = 0; i < n; ++i) q[i] = q_e[i];
  for (int c = 0; c < e; ++c) q_e[c] += ITS(q_e)[c] - ITS(readings)[c];
}

static int32_t ikm(void) { return truepose_ikm(&model, setpoint.x, out).status; }
static int32_t fkm(void) { return truepose_fkm(&model, q, 12, near).outcome.status; }
static int32_t fkm_torques(void) {
  const int32_t status = fkm();
  return status > TRUEPOSE_OK
             ? status
             : truepose_joint_torque(&model, near, q, out).status; /* any torques */
}
static int32_t tej(void) { return truepose_tej(&model, setpoint.x, 0, out).status; }
static int32_t servo(void) {
  return truepose_servo(&model, TRUEPOSE_LAW_TEJ, 0, setpoint.x, q_e, 0, 0, &servo_cycle).status;
}
static int32_t estimate(void) {
  return truepose_estimate(&model, &ITS(knowledge), q_e, work, near).outcome.status;
}
static int32_t control(void) {
  return truepose_control(&model, &controller, &setpoint, q_e, &ITS(knowledge), work, out).status;
}
static int32_t fault_tolerant(void) {
  return truepose_control_fault_tolerant(&model, 0, &controller, &monitor, &setpoint, q_e,
                                         &ITS(knowledge), work, out, &report)
      .status;
}
/* A cycle in the shell, in `running` once it has begun. */
static int32_t safely(void) {
  ++marks.counter;
  return truepose_control_safely(&model, 0, &controller, &monitor, &shell, &setpoint, q_e,
                                 &ITS(knowledge), work, &marks, &safe)
      .status;
}
static int32_t calibrate(void) { return truepose_online_calibrator_step(&calibrator, q_e).status; }

typedef struct entry {
  const char* name;
  int32_t (*call)(void);
  int32_t law, feed_forward, gains;
} entry;

static const entry entries[] = {
    {"IKM", ikm, 0, 0, 0},
    {"FKM, from the last cycle's pose", fkm, 0, 0, 0},
    {"and the joints' torques there", fkm_torques, 0, 0, 0},
    {"TEJ", tej, 0, 0, 0},
    {"servo cycle, TEJ", servo, 0, 0, 0},
    {"estimate", estimate, 0, 0, 0},
    {"control, joint", control, TRUEPOSE_LAW_JOINT, 0, 0},
    {"control, TEJ", control, TRUEPOSE_LAW_TEJ, 0, 0},
    {"control, Cartesian", control, TRUEPOSE_LAW_CARTESIAN, 0, 0},
    {"control, weighted", control, TRUEPOSE_LAW_WEIGHTED, 0, 0},
    {"control, estimated", control, TRUEPOSE_LAW_ESTIMATED, 0, 0},
    {"TEJ, full feed-forward", control, TRUEPOSE_LAW_TEJ, 2, 0},
    {"TEJ, and gains shaped by the inertia", control, TRUEPOSE_LAW_TEJ, 2, 1},
    {"the same, with the fault monitor", fault_tolerant, TRUEPOSE_LAW_TEJ, 2, 1},
    {"and in the safety shell", safely, TRUEPOSE_LAW_TEJ, 2, 1},
    {"online calibration", calibrate, 0, 0, 0},
};

static uint32_t ticks_of(int32_t (*call)(void), int32_t* status) {
  const uint32_t before = ticks();
  *status = call();
  return (before - ticks()) & 0xFFFFFF;
}

/* Instructions per tick, from half a million passes of a loop of two instructions. */
static int32_t count(void) {
  uint32_t left = COUNTED / 2;
  __asm__ volatile("1: subs %0, #1\n bne 1b" : "+r"(left) : : "cc");
  return TRUEPOSE_OK;
}

/* Switches the shell on, acknowledges, starts, and waits for the brakes. @return 0: it refuses */
static int begin_safely(const truepose_control_settings* settings) {
  truepose_safety_limits limits;
  if (truepose_safety_defaults(&model, settings, &limits).status != TRUEPOSE_OK ||
      truepose_safety_shell_init(&shell, sizeof shell, &model, &limits).status != TRUEPOSE_OK)
    return 0;
  marks.counter_given = marks.known = 1;
  for (int cycle = 0; cycle < 80; ++cycle) {
    marks.acknowledge = cycle >= 20;
    marks.start = cycle >= 40;
    safely();
  }
  return safe.follows;
}

static int start(const entry* asked) {
  truepose_control_settings settings = ITS(control);
  settings.law = asked->law;
  settings.feed_forward = asked->feed_forward;
  settings.gains = asked->gains;
  at_cycle(0);
  at_cycle(0);
  return truepose_controller_init(&controller, sizeof controller, &settings).status == 0 &&
         truepose_fault_monitor_init(&monitor, sizeof monitor, &ITS(fault_monitor)).status == 0 &&
         truepose_online_calibrator_init(&calibrator, sizeof calibrator, &model, &ITS(knowledge),
                                         memory, MEMORY)
                 .status == 0 &&
         (asked->call != safely || begin_safely(&settings));
}

/* Prints one row, unless the call needs sensors that the robot lacks.
 * @return 0: no answer */
static int measure(const entry* asked) {
  uint32_t sum = 0, worst = 0, stack = 0;
  int32_t status;
  if (!start(asked)) return 0;
  for (int cycle = 0; cycle < CYCLES; ++cycle) {
    at_cycle(cycle);
    const uint32_t took = ticks_of(asked->call, &status);
    if (status == TRUEPOSE_NOT_MEASURED) return 1;
    if (status > TRUEPOSE_OK || (asked->call == safely && !safe.follows)) return 0;
    sum += took;
    if (took > worst) worst = took;
  }
  start(asked);
  for (int cycle = 0; cycle < CYCLES; cycle += 9) { /* includes the searches of the first cycles */
    at_cycle(cycle);
    paint();
    asked->call();
    if (used() > stack) stack = used();
  }
  say("| ");
  say(asked->name);
  say(" | ");
  say_number(sum * per_tick / CYCLES, 0);
  say(" | ");
  say_number(worst * per_tick, 0);
  say(" | ");
  say_number(stack, 0);
  say(" |\n");
  return 1;
}

int main(void) {
  truepose_real worst[AGREE_QUESTIONS];
  int32_t status;
  const int32_t asked = agree(worst);
  int far = asked <= 0;
  const int single = sizeof(truepose_real) == sizeof(float);
  say(single ? "differences from the reference, of 1e-9 of the size:"
             : "differences from the reference, of 1e-16 of the size:");
  for (int k = 0; k < AGREE_QUESTIONS; ++k) {
    far |= !(worst[k] <= agree_within(k));
    say(" ");
    say(agree_names[k]);
    say_number((uint32_t)(single ? fmin(worst[k], 1) * 1e9 : fmin(worst[k], 1e-7) * 1e16), 2);
  }
  say(far ? "\nFAILED\n\n" : "\n\n");
  per_tick = (COUNTED + ticks_of(count, &status) / 2) / ticks_of(count, &status);
  if (truepose_load(&model, sizeof model, &ROBOT).status != TRUEPOSE_OK) return 1;
  n = truepose_freedoms(&model);
  e = n + truepose_sensors(&model);
  say("| entry | instructions | at most | stack, bytes |\n|---|---|---|---|\n");
  for (unsigned k = 0; k < sizeof entries / sizeof *entries; ++k)
    if (!measure(entries + k)) {
      say(entries[k].name);
      say(": no answer\n");
      return 1;
    }
  return far;
}
