/* A controller in plain C for drives that close their own loops. At 1 kHz, on a
 * machine that is simulated, one rod 3 mm longer than h4.h (truepose export c h4) has it. */
#define _POSIX_C_SOURCE 200809L
#include <math.h>
#include <stdio.h>
#include <time.h>

#include "h4.h"

static truepose_model model, machine; /* no heap: all memory is the program's own */

static int fails(const char* what, truepose_outcome outcome) {
  if (outcome.status > TRUEPOSE_OK)
    printf("%s: %s, part %d\n", what, truepose_status_text(outcome.status), (int)outcome.part);
  return outcome.status > TRUEPOSE_OK;
}

/* A pose on the paper's way, 0.2 s, by its quintic time law. */
static void pose_at(int cycle, truepose_real x[6]) {
  static const truepose_real from[6] = {-0.05, 0, -0.42, 0.2}, to[6] = {0.05, 0.05, -0.40, -0.2};
  const double u = fmin(cycle / 200.0, 1), s = u * u * u * (10 + u * (6 * u - 15));
  for (int i = 0; i < 6; ++i) x[i] = from[i] + s * (to[i] - from[i]);
}

static int run(int32_t law, const char* name) {
  truepose_real x[6], x_d[6], q[TRUEPOSE_MOTORS], q_d[TRUEPOSE_MOTORS], q_next[TRUEPOSE_MOTORS];
  truepose_real q_e[TRUEPOSE_READINGS];
  truepose_servo_cycle servo;
  struct timespec next;
  clock_gettime(CLOCK_MONOTONIC, &next);
  pose_at(0, x_d);
  pose_at(0, x);
  if (fails("start", truepose_ikm(&model, x_d, q_d))) return 0;
  for (int i = 0; i < 4; ++i) q[i] = q_d[i];
  for (int cycle = 0; cycle < 500; ++cycle) {
    next.tv_nsec = (next.tv_nsec + 1000000) % 1000000000;
    next.tv_sec += next.tv_nsec < 1000000;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    if (fails("machine", truepose_fkm(&machine, q, 12, x).outcome) || /* what its encoders read */
        fails("machine", truepose_readings(&machine, x, q_e)) ||
        fails("error", truepose_servo(&model, law, 0, x_d, q_e, NULL, NULL, &servo)))
      return 0;
    pose_at(cycle + 1, x_d);
    if (fails("setpoint", truepose_ikm(&model, x_d, q_next))) return 0;
    for (int i = 0; i < 4; ++i) { /* drives that take velocities */
      q[i] += q_next[i] - q_d[i] + 0.05 * servo.error[i];
      q_d[i] = q_next[i];
    }
  }
  printf("%s law: theta off by %.3f deg\n", name, 57.29577951308232 * (x[3] - x_d[3]));
  return 1;
}

int main(void) {
  static truepose_description built;
  built = h4;
  built.chain[2].rod += 0.003;
  if (fails("h4", truepose_load(&model, sizeof model, &h4))) return 1;
  if (fails("machine", truepose_load(&machine, sizeof machine, &built))) return 1;
  return run(TRUEPOSE_LAW_JOINT, "joint") && run(TRUEPOSE_LAW_TEJ, "tej") ? 0 : 1;
}
