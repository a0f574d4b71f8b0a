/* Simulated machine. */
#include "plant_core.h"

#include <math.h>
#include <string.h>

/** Reading of an encoder with these counts. */
static truepose_real counted(const truepose_plant* plant, int c, truepose_real reading) {
  const truepose_real step = c < plant->motors ? plant->robot.chain[c].encoder_step
                                               : plant->robot.sensor[c - plant->motors].step;
  return plant->coarse && step > 0 ? step * nearbyint(reading / step) : reading;
}

truepose_outcome truepose_plant_begin(truepose_plant* plant, const truepose_description* robot,
                                      truepose_real period,
                                      const truepose_real q[TRUEPOSE_MOTORS]) {
  memset(plant, 0, sizeof *plant);
  truepose_outcome outcome = truepose_load(&plant->model, sizeof plant->model, robot);
  if (outcome.status > TRUEPOSE_OK) return outcome;
  plant->robot = *robot;
  plant->period = period;
  plant->coarse = 1;
  plant->motors = truepose_motors(&plant->model);
  plant->readings = plant->motors + truepose_sensors(&plant->model);
  memcpy(plant->q, q, sizeof plant->q);
  memcpy(plant->x, robot->home, sizeof plant->x);
  outcome = truepose_fkm(&plant->model, q, TRUEPOSE_STEPS, plant->x).outcome;
  if (outcome.status <= TRUEPOSE_OK)
    outcome = truepose_readings(&plant->model, plant->x, plant->q_e);
  for (int c = 0; c < plant->readings; ++c) plant->zero[c] = counted(plant, c, plant->q_e[c]);
  return outcome;
}

void truepose_plant_cycle(truepose_plant* plant, const truepose_real velocity[TRUEPOSE_MOTORS],
                          const int32_t fault[TRUEPOSE_READINGS],
                          const truepose_real size[TRUEPOSE_READINGS],
                          const truepose_real index[TRUEPOSE_READINGS],
                          int index_enable[TRUEPOSE_READINGS]) {
  truepose_real q[TRUEPOSE_MOTORS] = {0}, x[6], before[TRUEPOSE_READINGS];
  memcpy(x, plant->x, sizeof x);
  memcpy(before, plant->q_e, sizeof before);
  for (int i = 0; i < plant->motors; ++i) q[i] = plant->q[i] + plant->period * velocity[i];
  plant->blocked = truepose_fkm(&plant->model, q, TRUEPOSE_STEPS, x).outcome.status > TRUEPOSE_OK ||
                   truepose_readings(&plant->model, x, plant->q_e).status > TRUEPOSE_OK;
  if (!plant->blocked) {
    memcpy(plant->q, q, sizeof q);
    memcpy(plant->x, x, sizeof x);
  }
  for (int c = 0; c < plant->readings; ++c) {
    const truepose_real now = plant->q_e[c];
    if (index_enable[c] && (before[c] - index[c]) * (now - index[c]) <= 0 && before[c] != now) {
      plant->zero[c] = counted(plant, c, index[c]);
      index_enable[c] = 0;
    }
    const truepose_real good = counted(plant, c, now) - (plant->absolute[c] ? 0 : plant->zero[c]);
    switch (fault[c]) {
      case TRUEPOSE_PLANT_MISSING: plant->read[c] = NAN; break;
      case TRUEPOSE_PLANT_FROZEN: break;
      case TRUEPOSE_PLANT_JUMPED: plant->read[c] = good + size[c]; break;
      default: plant->read[c] = good;
    }
  }
}
