/* Start-up test of a machine that is off. */
#include "start_core.h"

#include <string.h>

/** Prepares a test. The limits of level 2 are the robot's own, at a natural frequency that only
 * sets limits not used here; level 1 has no torques, hence needs none. */
static truepose_outcome begin(truepose_starter* starter, const truepose_starter_input* input,
                              const truepose_corrector* tej, const truepose_corrector_input* in) {
  const truepose_model* robot = &tej->pupil.drawn;
  truepose_safety_limits limits = truepose_corrector_limits(tej, in);
  truepose_start_settings settings;
  truepose_start_defaults(&settings);
  if (starter->level < 2) {
    settings.pairs = 0;
  } else {
    truepose_control_settings control;
    truepose_control_defaults(&control);
    control.period = tej->period;
    truepose_outcome outcome = truepose_place_poles(robot, tej->table.robot.home, 50, 1, &control);
    if (outcome.status <= TRUEPOSE_OK) outcome = truepose_safety_defaults(robot, &control, &limits);
    if (outcome.status > TRUEPOSE_OK) return outcome;
  }
  limits.brake = input->brake;
  settings.brake_opens = input->opens;
  settings.motion = input->motion;
  return truepose_start_test_init(&starter->test, sizeof starter->test, robot, &settings, &limits);
}

/** Zeros of the sensors that have none yet, so that they read what the motors determine. */
static void assume_zeros(truepose_starter* starter, const truepose_corrector* tej, uint32_t known,
                         const truepose_real* q_e) {
  truepose_real x[6], expected[TRUEPOSE_READINGS];
  memset(starter->zero, 0, sizeof starter->zero);
  memcpy(x, tej->table.robot.home, sizeof x);
  if (truepose_fkm(&tej->pupil.drawn, q_e, 30, x).outcome.status > TRUEPOSE_OK ||
      truepose_readings(&tej->pupil.drawn, x, expected).status > TRUEPOSE_OK)
    return;
  for (int k = 0; k < tej->sensors; ++k)
    if (!(known >> k & 1U)) starter->zero[k] = q_e[tej->motors + k] - expected[tej->motors + k];
}

int truepose_starter_cycle(truepose_starter* starter, const truepose_starter_input* input,
                           truepose_corrector* tej, const truepose_corrector_input* in) {
  truepose_start_report* const report = &starter->report;
  const int begins = input->request && !starter->asked && !in->enable && !starter->running;
  truepose_real q_e[TRUEPOSE_READINGS];
  starter->asked = input->request;
  enum { kContradictory = 1 }; /* finding: contradictory limits */
  if (begins && input->level > 0) {
    memset(report, 0, sizeof *report);
    starter->level = input->level;
    starter->reached = 0;
    const truepose_outcome outcome = begin(starter, input, tej, in);
    starter->running = outcome.status <= TRUEPOSE_OK;
    report->part = outcome.part;
    report->brakes = (1U << tej->motors) - 1;
    if (!starter->running) {
      report->state = TRUEPOSE_START_FAILED;
      report->finding = kContradictory;
      return 1;
    }
  }
  if (!starter->running) return 0;
  memcpy(q_e, in->q_e, sizeof q_e);
  for (int i = 0; i < tej->motors; ++i) q_e[i] -= tej->homed_by[i];
  if (begins) assume_zeros(starter, tej, input->known, q_e);
  for (int k = 0; k < tej->sensors; ++k) q_e[tej->motors + k] -= starter->zero[k];
  truepose_start_test_cycle(&tej->pupil.drawn, &starter->test, q_e, input->homed,
                            tej->table.monitored ? &tej->table.known : NULL, tej->work, report);
  starter->pulses = report->state > TRUEPOSE_START_EXPLAIN && starter->level >= 2;
  int loaded = 0;
  for (int i = 0; i < tej->motors; ++i) loaded |= report->torque[i] != 0;
  if (report->state < TRUEPOSE_START_PASSED || loaded) return 0;
  starter->running = starter->pulses = 0;
  starter->reached = report->state == TRUEPOSE_START_PASSED ? starter->level : 0;
  return 1;
}
