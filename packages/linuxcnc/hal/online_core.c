/* Online calibration from readings at rest. */
#include "online_core.h"

#include <math.h>
#include <string.h>

truepose_outcome truepose_pupil_load(truepose_pupil* pupil) {
  truepose_description of;
  truepose_outcome outcome = truepose_description_of(&pupil->next_finest, &of);
  of.level = pupil->level;
  if (outcome.status <= TRUEPOSE_OK) outcome = truepose_load(&pupil->next, sizeof pupil->next, &of);
  return outcome;
}

void truepose_pupil_adopt(truepose_pupil* pupil) {
  pupil->robot = pupil->next;
  pupil->finest = pupil->next_finest;
}

/** Adopts the identified robot, at both levels. If it cannot be loaded (its home beyond a stop),
 * the previous one stays. */
static int believe(truepose_pupil* pupil) {
  truepose_online_calibrator_model(&pupil->learner, &pupil->next_finest, sizeof pupil->next_finest);
  if (truepose_pupil_load(pupil).status > TRUEPOSE_OK) return 0;
  truepose_pupil_adopt(pupil);
  truepose_online_calibrator_knowledge(&pupil->learner, &pupil->known);
  return 1;
}

truepose_outcome truepose_pupil_begin(truepose_pupil* pupil, const truepose_table* table) {
  memset(pupil, 0, sizeof *pupil);
  truepose_outcome outcome = truepose_load(&pupil->robot, sizeof pupil->robot, &table->robot);
  if (outcome.status <= TRUEPOSE_OK)
    outcome = truepose_load(&pupil->drawn, sizeof pupil->drawn, &table->finest);
  if (outcome.status > TRUEPOSE_OK) return outcome;
  pupil->finest = pupil->drawn;
  pupil->prior = pupil->known = table->known;
  pupil->level = table->robot.level;
  pupil->motors = table->robot.motors;
  memcpy(pupil->x, table->robot.home, sizeof pupil->x);
  pupil->able = table->robot.sensors > 0 && table->known.count > 0;
  if (truepose_work(&pupil->drawn, table->known.count) > TRUEPOSE_TEJ_WORK)
    outcome.status = TRUEPOSE_TOO_SMALL;
  else if (pupil->able)
    outcome = truepose_online_calibrator_init(&pupil->learner, sizeof pupil->learner, &pupil->drawn,
                                              &pupil->prior, pupil->memory,
                                              sizeof pupil->memory / sizeof *pupil->memory);
  return outcome;
}

/** Whether the commands have been constant for `rest`; then restarts the time for the next row. */
static int stood(truepose_pupil* pupil, truepose_real period, truepose_real rest,
                 const truepose_real* q_d) {
  int moved = 0;
  for (int i = 0; i < pupil->motors; ++i)
    moved |= !(fabs(q_d[i] - pupil->stands[i]) <= pupil->prior.sigma[i]);
  if (moved) memcpy(pupil->stands, q_d, sizeof pupil->stands);
  pupil->since = moved ? 0 : pupil->since + period;
  if (!(pupil->since >= rest)) return 0;
  pupil->since = 0;
  return 1;
}

truepose_outcome truepose_pupil_accuracy(truepose_pupil* pupil, const truepose_model* finest,
                                         const truepose_knowledge* known, const truepose_real* q_e,
                                         truepose_real chi2, truepose_real* work) {
  truepose_outcome outcome = truepose_fkm(finest, q_e, TRUEPOSE_STEPS, pupil->x).outcome;
  if (outcome.status > TRUEPOSE_OK) return outcome;
  const truepose_estimate_result found = truepose_estimate(finest, known, q_e, work, pupil->x);
  outcome = found.outcome;
  if (outcome.status > TRUEPOSE_OK) return outcome;
  pupil->chi2 = found.chi2;
  if (!(found.chi2 <= (chi2 > 0 ? chi2 : HUGE_VAL))) outcome.status = TRUEPOSE_DISAGREE;
  for (int i = 0; i < pupil->motors && outcome.status != TRUEPOSE_DISAGREE; ++i)
    pupil->sigma[i] = sqrt(found.covariance[i * (TRUEPOSE_FREEDOMS + 1)]);
  return outcome;
}

int truepose_pupil_cycle(truepose_pupil* pupil, truepose_real period, truepose_real rest,
                         const truepose_real* q_d, const truepose_real* q_e, truepose_real* work) {
  const int64_t before = pupil->lines + pupil->left_out;
  const int fresh = pupil->fresh;
  pupil->fresh = 0;
  if (!pupil->able) return 0;
  if (fresh) truepose_pupil_accuracy(pupil, &pupil->finest, &pupil->known, q_e, 0, work);
  if (!stood(pupil, period, rest, q_d)) return 0;
  pupil->outcome = truepose_online_calibrator_step(&pupil->learner, q_e);
  truepose_online_calibrator_samples(&pupil->learner, &pupil->lines, &pupil->left_out);
  /* A row with one excluded reading still contributes. */
  if (pupil->lines + pupil->left_out == before) return 0;
  return pupil->fresh = believe(pupil);
}

int truepose_pupil_forget(truepose_pupil* pupil) {
  if (!pupil->able || pupil->lines == 0) return 0;
  return truepose_online_calibrator_roll_back(&pupil->learner).status <= TRUEPOSE_OK &&
         believe(pupil);
}

const char* truepose_pupil_keep(const truepose_pupil* pupil, truepose_table* table,
                                const char* path) {
  const size_t p = (size_t)pupil->known.count;
  truepose_description_of(&pupil->robot, &table->robot);
  truepose_description_of(&pupil->finest, &table->finest);
  memcpy(table->known.sigma, pupil->known.sigma, sizeof table->known.sigma);
  memmove(table->column, pupil->known.column, p * sizeof *table->column);
  memmove(table->root, pupil->known.root, p * p * sizeof *table->root);
  table->known.count = pupil->known.count;
  return truepose_write_table(path, table);
}
