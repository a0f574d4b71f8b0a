/* Difference of this build's answers from Python's. No library but libm. */
#include "agree.h"

#include <math.h>

#include "vectors.h"

enum { CAP = 12, WORK = 4000 };

const char* const agree_names[AGREE_QUESTIONS] = {"ikm", "fkm",   "readings", "jacobian",
                                                  "tej", "error", "estimate"};

static truepose_model model;
static truepose_real work[WORK];

/* Rows of `width` numbers against rows that lie `stride` apart. The size is the largest number, or
 * `least`: what enters a difference. */
static void compare(const truepose_real* expected, int rows, int width, const truepose_real* found,
                    int stride, truepose_real least, truepose_real* worst) {
  truepose_real size = least;
  for (int k = 0; k < rows * width; ++k) size = (truepose_real)fmax(size, fabs(expected[k]));
  for (int i = 0; i < rows; ++i)
    for (int j = 0; j < width; ++j) {
      const truepose_real off = found[i * stride + j] - expected[i * width + j];
      if (!(fabs(off) <= *worst * size)) *worst = (truepose_real)fabs(off) / size;
    }
}

static int failed(truepose_outcome outcome) { return outcome.status > TRUEPOSE_OK; }

/* One pose of a robot. @return 0: no answer to something */
static int ask(const vectors* v, int k, int n, int e, truepose_real worst[AGREE_QUESTIONS]) {
  truepose_real x[TRUEPOSE_FREEDOMS] = {0}, found[TRUEPOSE_MOTORS * TRUEPOSE_READINGS];
  truepose_real q[TRUEPOSE_MOTORS] = {0}, q_e[TRUEPOSE_READINGS] = {0}, pose[TRUEPOSE_FREEDOMS];
  truepose_servo_cycle servo;
  const truepose_real* home = v->robot->home;
  truepose_estimate_result estimate;
  for (int i = 0; i < n; ++i) x[i] = v->x[k * n + i];
  for (int i = 0; i < n; ++i) q[i] = v->ikm[k * n + i];
  for (int i = 0; i < e; ++i) q_e[i] = v->q_e[k * e + i];

  if (failed(truepose_ikm(&model, x, found))) return 0;
  compare(v->ikm + k * n, 1, n, found, n, 0, worst + AGREE_IKM);
  for (int i = 0; i < 6; ++i) pose[i] = home[i];
  if (failed(truepose_fkm(&model, q, CAP, pose).outcome)) return 0;
  compare(v->fkm + k * n, 1, n, pose, n, 0, worst + AGREE_FKM);
  if (failed(truepose_readings(&model, x, found))) return 0;
  compare(v->readings + k * e, 1, e, found, e, 0, worst + AGREE_READINGS);
  if (failed(truepose_jacobian(&model, x, found))) return 0;
  compare(v->jacobian + k * n * n, n, n, found, TRUEPOSE_MOTORS, 0, worst + AGREE_JACOBIAN);
  if (failed(truepose_tej(&model, x, 0, found))) return 0;
  compare(v->tej + k * n * e, n, e, found, TRUEPOSE_READINGS, 0, worst + AGREE_TEJ);
  const int32_t law = e > n ? TRUEPOSE_LAW_TEJ : TRUEPOSE_LAW_JOINT;
  if (failed(truepose_servo(&model, law, 0, x, q_e, 0, 0, &servo))) return 0;
  compare(v->error + k * n, 1, n, servo.error, n, 1,
          worst + AGREE_ERROR); /* of readings of about 1 */
  if (!v->known) return 1;
  for (int i = 0; i < 6; ++i) pose[i] = home[i];
  estimate = truepose_estimate(&model, v->known, q_e, work, pose);
  if (failed(estimate.outcome)) return 0;
  compare(v->estimate + k * n, 1, n, pose, n, 0, worst + AGREE_ESTIMATE);
  return 1;
}

int32_t agree(truepose_real worst[AGREE_QUESTIONS]) {
  const int robots = (int)(sizeof vectors_of / sizeof *vectors_of);
  int32_t asked = 0;
  for (int question = 0; question < AGREE_QUESTIONS; ++question) worst[question] = 0;
  for (int robot = 0; robot < robots; ++robot) {
    const vectors* v = vectors_of + robot;
    const truepose_outcome loaded = truepose_load(&model, sizeof model, v->robot);
    if (failed(loaded) || (v->known && truepose_work(&model, v->known->count) > WORK))
      return -1 - robot;
    const int n = truepose_freedoms(&model), e = n + truepose_sensors(&model);
    for (int k = 0; k < VECTOR_POSES; ++k)
      if (!ask(v, k, n, e, worst)) return -1 - robot;
    ++asked;
  }
  return asked;
}

truepose_real agree_within(int question) {
  /* An ankle's cranks are a tenth of its rods: what its single precision loses is ten times
   * others'. */
  if (sizeof(truepose_real) == sizeof(float))
    return (truepose_real)(question == AGREE_FKM ? 2e-5 : question == AGREE_JACOBIAN ? 2e-6 : 1e-5);
  return (truepose_real)(question == AGREE_ESTIMATE ? 1e-10 : 1e-13);
}
