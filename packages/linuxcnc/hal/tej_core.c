/* Motor error for the drives, from all readings. */
#include "tej_core.h"

#include <math.h>
#include <string.h>

enum {
  kLoop = 50,   /* 1/s, of the drives' position loops, as exported */
  kGeometry = 2 /* `changed`: another robot model */
};
/** Largest change of a correction by another robot model, in counts of the encoder per cycle: below
 * 0.1, as the law answers the motion that the blend makes. */
static const truepose_real kCounts = 0.09;

/** Factor on the sigma of a failed sensor. */
static const truepose_real kDisbelieved = 1e4;

truepose_outcome truepose_corrector_begin(truepose_corrector* tej,
                                          const truepose_description* commanded,
                                          truepose_real period) {
  const truepose_description* robot = &tej->table.robot;
  truepose_outcome outcome = {TRUEPOSE_NO_SUCH_PART, -1};
  if (robot->mobility != commanded->mobility) return outcome;
  outcome = truepose_load(&tej->commanded, sizeof tej->commanded, commanded);
  if (outcome.status <= TRUEPOSE_OK) outcome = truepose_pupil_begin(&tej->pupil, &tej->table);
  if (outcome.status > TRUEPOSE_OK) return outcome;
  tej->model = tej->pupil.robot;
  tej->motors = truepose_motors(&tej->model);
  tej->sensors = truepose_sensors(&tej->model);
  tej->period = period;
  memcpy(tej->x_d, robot->home, sizeof tej->x_d);
  memcpy(tej->pose, robot->home, sizeof tej->pose);
  tej->reason.part = -1;
  tej->questioned = 1;
  return outcome;
}

/** Values that are not finite, as bits. */
static uint32_t not_finite(const truepose_real* values, int count) {
  uint32_t which = 0;
  for (int i = 0; i < count; ++i) which |= (uint32_t)!isfinite(values[i]) << i;
  return which;
}
static int first(uint32_t bits) { return bits != 0 ? __builtin_ctz(bits) : -1; }

static void fails(truepose_corrector* tej, truepose_corrector_fault fault, int32_t status,
                  int32_t part) {
  if (tej->fault != TRUEPOSE_TEJ_NO_FAULT) return;
  tej->fault = fault;
  tej->reason.status = status;
  tej->reason.part = part;
}

/** Changes the robot of the laws from this cycle on. */
static void goes_by(truepose_corrector* tej, int learnt, int anew) {
  if (learnt == tej->learnt && !(learnt && anew)) return;
  tej->learnt = learnt;
  tej->changed |= kGeometry;
}

/** Observes external forces from the drives' torques; off where the robot has no torque limits. */
static void observe(truepose_corrector* tej, const truepose_corrector_input* input) {
  if (!input->observe || !tej->monitoring) {
    tej->observing = 0;
    return;
  }
  if (!tej->observing) {
    truepose_control_settings settings;
    truepose_momentum_settings momentum;
    truepose_control_defaults(&settings);
    settings.period = tej->period;
    tej->observing =
        truepose_place_poles(&tej->model, tej->table.robot.home, kLoop, 1, &settings).status <=
            TRUEPOSE_OK &&
        truepose_momentum_defaults(&tej->model, &settings, &momentum).status <= TRUEPOSE_OK &&
        truepose_fault_monitor_momentum(&tej->monitor, &tej->forces, sizeof tej->forces, &momentum)
                .status <= TRUEPOSE_OK;
    if (!tej->observing) return;
  }
  if (truepose_fault_monitor_observe(&tej->model, &tej->monitor, input->torque).status <=
      TRUEPOSE_OK)
    truepose_fault_monitor_disturbance(&tej->monitor, &tej->disturbance);
}

/** Substitutes readings that are not valid. */
static void monitored(truepose_corrector* tej, const truepose_corrector_input* input,
                      truepose_real* q_e) {
  truepose_real believed[TRUEPOSE_READINGS];
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  if (!tej->monitoring) {
    outcome = truepose_fault_monitor_init(&tej->monitor, sizeof tej->monitor, &tej->table.monitor);
    tej->monitoring = outcome.status <= TRUEPOSE_OK;
    tej->observing = 0;
  }
  if (tej->monitoring) {
    truepose_fault_monitor_led(&tej->monitor, tej->led);
    outcome = truepose_fault_monitor_step(&tej->pupil.drawn, &tej->monitor, input->q_d, q_e,
                                          &tej->table.known, tej->work, believed, &tej->report);
  }
  if (outcome.status != TRUEPOSE_OK) tej->outcome = outcome;
  observe(tej, input);
  if (outcome.status > TRUEPOSE_OK) return; /* no result: use the readings as they are */
  if (!not_finite(believed, tej->motors + tej->sensors)) memcpy(q_e, believed, sizeof believed);
  tej->stop = tej->report.stops;
  uint32_t failed = 0, doubted = 0;
  for (int c = 0; c < tej->motors + tej->sensors; ++c) {
    failed |= (uint32_t)(tej->report.health[c] == TRUEPOSE_FAILED) << c;
    doubted |= (uint32_t)(tej->report.health[c] != TRUEPOSE_VALID) << c;
    if (tej->report.health[c] == TRUEPOSE_FAILED) tej->symptom[c] = tej->report.symptom[c];
  }
  /* Their substitution changes from this cycle on. */
  tej->changed |= doubted != tej->doubted || failed != tej->left_out;
  tej->doubted = doubted;
  if ((failed & ~tej->left_out) != 0 && truepose_pupil_forget(&tej->pupil))
    goes_by(tej, tej->learnt, 1);
  tej->left_out = failed;
  if (tej->stop || failed >> tej->motors == (1U << tej->sensors) - 1)
    fails(tej, TRUEPOSE_TEJ_MONITOR, TRUEPOSE_DISAGREE, first(failed != 0 ? failed : doubted));
}

/** Knowledge for weighted laws: a failed sensor has almost no weight. */
static const truepose_knowledge* known(truepose_corrector* tej) {
  tej->weighed = tej->learnt ? tej->pupil.known : tej->table.known;
  for (int c = 0; c < tej->motors + tej->sensors; ++c)
    if (tej->left_out >> c & 1U) tej->weighed.sigma[c] *= kDisbelieved;
  return &tej->weighed;
}

/** Error of a law; a new law or band restarts the controller's state. */
static truepose_outcome error_of(truepose_corrector* tej, const truepose_corrector_input* input,
                                 const truepose_real* q_e, truepose_servo_cycle* cycle) {
  const int heavy = input->law == TRUEPOSE_LAW_WEIGHTED || input->law == TRUEPOSE_LAW_ESTIMATED;
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  if (tej->begun != input->law + 1 || tej->band != input->band) {
    truepose_control_settings settings;
    truepose_control_defaults(&settings);
    settings.law = input->law;
    settings.damped_below = input->band;
    settings.period = tej->period;
    outcome = truepose_controller_init(&tej->controller, sizeof tej->controller, &settings);
    tej->begun = outcome.status <= TRUEPOSE_OK ? input->law + 1 : 0;
    tej->band = input->band;
  }
  if (outcome.status > TRUEPOSE_OK) return outcome;
  const truepose_model* robot = tej->learnt ? &tej->pupil.robot : &tej->model;
  if (heavy) robot = tej->learnt ? &tej->pupil.finest : &tej->pupil.drawn;
  return truepose_controller_servo(robot, &tej->controller, tej->x_d, q_e,
                                   heavy ? known(tej) : NULL, heavy ? tej->work : NULL, cycle);
}

/** Identifies the robot from readings at rest, if there is no fault. */
static void learn(truepose_corrector* tej, const truepose_corrector_input* input,
                  const truepose_real* q_e) {
  int anew = tej->given;
  tej->given = 0;
  if (input->learn && !tej->exchanged && input->enable && input->referenced &&
      tej->fault == TRUEPOSE_TEJ_NO_FAULT && !tej->doubted)
    anew |= truepose_pupil_cycle(&tej->pupil, tej->period, input->rest, input->q_d, q_e, tej->work);
  goes_by(tej, input->learnt && tej->pupil.able, anew);
}

/** Computes the correction for the requested law. @return 0: none */
static int asked_for(truepose_corrector* tej, const truepose_corrector_input* input,
                     const truepose_real* q_e, truepose_real* correction) {
  truepose_servo_cycle cycle;
  const truepose_fkm_result pose =
      truepose_fkm(&tej->commanded, input->q_d, TRUEPOSE_STEPS, tej->x_d);
  truepose_outcome outcome = pose.outcome;
  if (outcome.status <= TRUEPOSE_OK) outcome = error_of(tej, input, q_e, &cycle);
  if (outcome.status != TRUEPOSE_OK) tej->outcome = outcome;
  if (outcome.status > TRUEPOSE_OK)
    return fails(tej, TRUEPOSE_TEJ_UNSOLVED, outcome.status, outcome.part), 0;
  for (int i = 0; i < tej->motors; ++i) {
    correction[i] = cycle.error[i] - tej->e_q[i];
    if (!(fabs(correction[i]) <= input->largest[i]))
      return fails(tej, TRUEPOSE_TEJ_CORRECTION, TRUEPOSE_DISAGREE, i), 0;
  }
  return 1;
}

/** Handles homing. The motor was homed to motion's reading q - c; from then on its reading is that
 * q - c and c is 0. */
static void homed(truepose_corrector* tej, const truepose_corrector_input* input,
                  truepose_real* q_e) {
  for (int i = 0; i < tej->motors; ++i) {
    if (input->zero[i] != tej->zero[i]) {
      tej->homed_by[i] += tej->correction[i];
      tej->correction[i] = q_e[i] - tej->homed_by[i] - input->q_d[i]; /* so that no drive steps */
      if (!isfinite(tej->correction[i])) tej->correction[i] = 0;
      tej->held[i] = tej->correction[i];
      tej->at[i] = q_e[i] - tej->homed_by[i];
      tej->zero[i] = input->zero[i];
      tej->questioned = tej->changed = 1;
    }
    q_e[i] -= tej->homed_by[i];
  }
}

/** Tests once after referencing whether the readings are consistent within the tolerances. */
static void question(truepose_corrector* tej, const truepose_corrector_input* input,
                     const truepose_real* q_e) {
  if (!tej->questioned || !input->enable || !input->referenced || tej->fault) return;
  tej->questioned = 0;
  if (!(input->chi2 > 0) || !tej->table.monitored || !tej->pupil.able) return;
  memcpy(tej->pupil.x, tej->x_d, sizeof tej->pupil.x);
  const truepose_outcome outcome = truepose_pupil_accuracy(
      &tej->pupil, &tej->pupil.drawn, &tej->table.known, q_e, input->chi2, tej->work);
  if (outcome.status == TRUEPOSE_OK || outcome.status == TRUEPOSE_NEAR_SINGULAR) return;
  tej->questioned = 1;
  fails(tej, TRUEPOSE_TEJ_HOMING, outcome.status, outcome.part);
}

static truepose_real clamped(truepose_real value, truepose_real most) {
  return fmax(-most, fmin(value, most));
}

/** Handles drives going off. Holds the correction, and the part of the drives' own error within
 * counts and noise, so that motion reads its last command. */
static void hold(truepose_corrector* tej) {
  truepose_real T[TRUEPOSE_MOTORS * TRUEPOSE_READINGS];
  const truepose_description* robot = &tej->table.robot;
  memcpy(tej->held, tej->correction, sizeof tej->held);
  if (truepose_tej(&tej->model, tej->x_d, 0, T).status > TRUEPOSE_OK) return;
  for (int i = 0; i < tej->motors; ++i) {
    truepose_real dither = 0;
    for (int c = 0; c < tej->motors + tej->sensors; ++c) {
      const truepose_sensor* sensor = &robot->sensor[c < tej->motors ? 0 : c - tej->motors];
      const truepose_real one = c < tej->motors
                                    ? robot->chain[c].encoder_step + robot->chain[c].encoder_noise
                                    : sensor->step + sensor->noise;
      dither += 2 * fabs(T[i * TRUEPOSE_READINGS + c]) * one;
    }
    tej->held[i] -= clamped(tej->error[i], dither);
  }
}

/** Correction while the drives are off: motion within counts and noise, at a count's edge, is
 * ignored. */
static void held(truepose_corrector* tej, const truepose_real* q_e) {
  for (int i = 0; i < tej->motors; ++i) {
    const truepose_chain* chain = &tej->table.robot.chain[i];
    const truepose_real still = 2 * (chain->encoder_step + chain->encoder_noise);
    tej->correction[i] = tej->held[i] + clamped(q_e[i] - tej->at[i], still);
  }
  tej->law = TRUEPOSE_LAW_JOINT;
}

/** Blends from the applied correction to the requested one: the difference `from` is ramped out
 * without a step of its rate. */
static void blend(truepose_corrector* tej, const truepose_corrector_input* input, int32_t law,
                  const truepose_real* asked) {
  if (law != tej->law || tej->changed) {
    tej->law = law;
    tej->since = 0;
    tej->longest = 0;
    for (int i = 0; i < tej->motors; ++i) {
      const truepose_real most = kCounts * tej->table.robot.chain[i].encoder_step / tej->period;
      tej->from[i] = tej->correction[i] - asked[i];
      if (tej->changed >= kGeometry && most > 0) /* 1.875: the quintic's steepest part */
        tej->longest = fmax(tej->longest, 1.875 * fabs(tej->from[i]) / most);
    }
  } else {
    tej->since += tej->period;
  }
  const truepose_real span = fmax(input->blend, tej->longest);
  const truepose_real u = span > 0 ? fmin(tej->since / span, 1) : 1;
  const truepose_real left = 1 - u * u * u * (10 + u * (6 * u - 15));
  for (int i = 0; i < tej->motors; ++i) tej->correction[i] = asked[i] + left * tej->from[i];
}

static void correct(truepose_corrector* tej, const truepose_corrector_input* input) {
  truepose_real q_e[TRUEPOSE_READINGS], asked[TRUEPOSE_MOTORS] = {0}, seen[TRUEPOSE_MOTORS] = {0};
  const int readings = tej->motors + tej->sensors;
  const int starts = input->enable && !tej->enabled, ends = !input->enable && tej->enabled;
  int32_t law = TRUEPOSE_LAW_JOINT;
  const uint32_t untold = not_finite(input->q_d, tej->motors);
  tej->outcome.status = TRUEPOSE_OK;
  tej->outcome.part = -1;
  tej->changed = 0;
  memset(&tej->disturbance, 0, sizeof tej->disturbance);
  tej->disturbance.motor = -1;
  tej->enabled = input->enable;
  tej->lost = untold | not_finite(input->q_e, tej->motors);
  if (ends) hold(tej);
  memcpy(q_e, input->q_e, sizeof q_e);
  homed(tej, input, q_e);
  if (input->reset) {
    if (tej->fault == TRUEPOSE_TEJ_HOMING) tej->questioned = 0;
    tej->reason = tej->outcome;
    memset(tej->symptom, 0, sizeof tej->symptom);
  }
  if (!input->referenced) tej->questioned = 1;
  if (starts || input->reset) {
    tej->fault = TRUEPOSE_TEJ_NO_FAULT;
    tej->stop = 0;
  }
  if (starts || input->reset || !input->monitor || tej->questioned) {
    tej->monitoring = 0;
    tej->changed |= tej->doubted != 0;
    tej->doubted = tej->left_out = 0;
    memset(&tej->report, 0, sizeof tej->report);
  }
  if (untold != 0) {
    fails(tej, TRUEPOSE_TEJ_COMMAND, TRUEPOSE_NOT_FINITE, first(untold));
    return;
  }
  if (!not_finite(q_e, readings)) question(tej, input, q_e);
  if (input->enable && input->monitor && tej->table.monitored && input->referenced &&
      tej->fault != TRUEPOSE_TEJ_HOMING)
    monitored(tej, input, q_e);
  const uint32_t unheard = not_finite(q_e, readings);
  if (unheard != 0) fails(tej, TRUEPOSE_TEJ_READING, TRUEPOSE_NOT_FINITE, first(unheard));
  if (not_finite(q_e, tej->motors)) { /* the drive must hold still */
    memset(tej->error, 0, sizeof tej->error);
    return;
  }
  for (int i = 0; i < tej->motors; ++i) {
    tej->e_q[i] = input->q_d[i] - q_e[i];
    if (starts) tej->correction[i] = -tej->e_q[i]; /* as held: motion read the command */
  }
  tej->changed |= starts;
  learn(tej, input, q_e);
  const int wanted = input->enable && input->referenced && input->law != TRUEPOSE_LAW_JOINT;
  if (wanted && tej->fault == TRUEPOSE_TEJ_NO_FAULT && asked_for(tej, input, q_e, asked))
    law = input->law;
  else
    memset(asked, 0, sizeof asked);
  if (input->enable) {
    blend(tej, input, law, asked);
    memcpy(tej->at, q_e, sizeof tej->at);
  } else {
    held(tej, q_e);
  }
  for (int i = 0; i < tej->motors; ++i) {
    tej->error[i] = tej->e_q[i] + tej->correction[i];
    if (input->enable) tej->led[i] += kLoop * tej->period * tej->error[i];
    seen[i] = q_e[i] - (input->enable ? asked[i] : tej->correction[i]);
  }
  truepose_fkm(&tej->commanded, seen, TRUEPOSE_STEPS, tej->pose);
}

truepose_safety_limits truepose_corrector_limits(const truepose_corrector* tej,
                                                 const truepose_corrector_input* input) {
  truepose_safety_limits limits = {.size = sizeof limits,
                                   .window = 8,
                                   .age = tej->period <= 0.005 ? 2 : 1,
                                   .counter_bits = 32,
                                   .period = tej->period,
                                   .saturation = 1,
                                   .clipped = 0.01,
                                   .missing = 0.005,
                                   .held = 0.005,
                                   .stop = 0.15,
                                   .brake = 0.02,
                                   .standstill = 0.05};
  for (int i = 0; i < tej->motors; ++i) {
    const truepose_chain* chain = &tej->table.robot.chain[i];
    limits.torque[i] = 1;
    limits.slew[i] = 200;
    limits.tracking[i] = input->error_limit[i];
    limits.deviation[i] = input->error_limit[i] + input->largest[i];
    limits.speed[i] = input->speed[i] > 0 ? input->speed[i] : 1e6;
    limits.count[i] = chain->encoder_step + 12 * chain->encoder_noise + 1e-9;
    limits.still[i] = 2 * limits.count[i];
    limits.kd[i] = kLoop;
    limits.rests[i] = limits.count[i];
  }
  return limits;
}

/** The safety shell after a cycle. Machine on is a start, off a stop; after a violation only reset
 * leads back. Readings are the drives' own, which no homing changes. */
static void guard(truepose_corrector* tej, const truepose_corrector_input* input, int starts) {
  const uint32_t all = (1U << tej->motors) - 1, requested = 1U << TRUEPOSE_STOP_REQUESTED;
  truepose_safety_report* const safe = &tej->safe;
  tej->brakes = input->enable ? 0 : all;
  tej->inhibit = tej->stop;
  if (!input->safety) {
    tej->guarding = 0;
    memset(safe, 0, sizeof *safe);
    return;
  }
  const int fault = safe->state == TRUEPOSE_SAFETY_FAULT;
  if (tej->guarding ? starts && !fault : !fault || input->reset) {
    const truepose_safety_limits limits = truepose_corrector_limits(tej, input);
    const truepose_outcome outcome =
        truepose_safety_shell_init(&tej->shell, sizeof tej->shell, &tej->model, &limits);
    tej->guarding = outcome.status <= TRUEPOSE_OK;
    memset(safe, 0, sizeof *safe);
    safe->state = tej->guarding ? TRUEPOSE_SAFETY_STOPPED : TRUEPOSE_SAFETY_FAULT;
    safe->cause = tej->guarding ? TRUEPOSE_STOP_NONE : TRUEPOSE_STOP_CONTRADICTORY_LIMITS;
    safe->part = outcome.part;
    safe->causes = tej->guarding ? 0 : 1U << safe->cause;
    safe->brakes = all;
  }
  if (tej->guarding) {
    const int stands = safe->state == TRUEPOSE_SAFETY_STOPPED;
    truepose_safety_cycle now = {.status = tej->lost ? TRUEPOSE_NOT_FINITE : TRUEPOSE_OK,
                                 .disagree = tej->report.stops && !tej->report.lost,
                                 .suspected = tej->doubted & all,
                                 .lost = tej->report.lost};
    truepose_safety_marks marks = {.counter = input->frame,
                                   .counter_given = input->frame_known,
                                   .known = 1,
                                   .start = input->enable && !stands && input->proven,
                                   .stop = !input->enable && safe->follows};
    tej->acknowledging = input->reset || (input->enable && stands && !tej->acknowledging);
    marks.acknowledge = tej->acknowledging;
    memcpy(now.x, tej->x_d, sizeof now.x);
    for (int i = 0; i < tej->motors; ++i) {
      now.q_d[i] = input->q_d[i] + input->zero[i];
      now.q[i] = input->q_e[i] + input->zero[i];
      now.error[i] = tej->error[i];
    }
    truepose_guard(&tej->model, &tej->shell, &now, &marks, safe);
  }
  tej->brakes |= safe->brakes;
  tej->inhibit |= input->enable && (!safe->follows || safe->path_stop > 0);
  if (!(safe->causes & ~requested)) return;
  fails(tej, TRUEPOSE_TEJ_SAFETY, TRUEPOSE_OK, safe->part);
  if (safe->path_stop == 0 && safe->state != TRUEPOSE_SAFETY_STOPPED) tej->lost = all;
}

void truepose_corrector_cycle(truepose_corrector* tej, const truepose_corrector_input* input) {
  const int starts = input->enable && !tej->enabled;
  correct(tej, input);
  guard(tej, input, starts);
}

int truepose_index_cycle(truepose_index* index, int enable, int* index_enable) {
  if (index->known) return 1;
  if (!index->armed && enable) {
    index->armed = *index_enable = 1;
  } else if (index->armed && !*index_enable) {
    index->known = 1;
  }
  return index->known;
}
