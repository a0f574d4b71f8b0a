/* Stack used by each entry of the C interface. Painted: bytes of a thread's own stack
 * that are no longer what they were. docs/c.md has the command. */
#define _XOPEN_SOURCE 700
#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "h4.h"

enum { STACK = 1 << 20, PAINT = 0xa5 };
static _Alignas(4096) unsigned char stack[STACK];
static truepose_model model, finest;
static truepose_controller controller;
static truepose_fault_monitor monitor;
static truepose_online_calibrator learner;
static truepose_real work[8000], memory[40000], x[6], q[6], q_e[16], e[6], J[36], tej_rows[96],
    serial[6];
static truepose_setpoint setpoint;
static truepose_fault_report report;
static truepose_outcome last;

static void nothing(void) {}
static void load(void) { last = truepose_load(&finest, sizeof finest, &h4_finest); }
static void ikm(void) { last = truepose_ikm(&model, x, q); }
static void ikm_full(void) { last = truepose_ikm(&finest, x, q); }
static void fkm(void) { last = truepose_fkm(&model, q, 12, x).outcome; }
static void fkm_full(void) { last = truepose_fkm(&finest, q, 12, x).outcome; }
static void readings(void) { last = truepose_readings(&model, x, q_e); }
static void jacobian(void) { last = truepose_jacobian(&model, x, J); }
static void conditioning(void) { last = truepose_conditioning(&model, x, J, serial); }
static void motor_tej(void) { last = truepose_tej(&model, x, 0, tej_rows); }
static void tej(void) {
  last = truepose_motor_error(&model, TRUEPOSE_LAW_TEJ, 0, x, q_e, NULL, NULL, e);
}
static void estimate(void) {
  last = truepose_estimate(&finest, &h4_knowledge, q_e, work, x).outcome;
}
static void control(void) {
  last = truepose_control(&model, &controller, &setpoint, q_e, NULL, NULL, e);
}
static void estimated(void) {
  last = truepose_change_law(&controller, TRUEPOSE_LAW_ESTIMATED);
  if (last.status == 0)
    last = truepose_control(&finest, &controller, &setpoint, q_e, &h4_knowledge, work, e);
}
static void fault_tolerant(void) {
  last = truepose_control_fault_tolerant(&finest, NULL, &controller, &monitor, &setpoint, q_e,
                                         &h4_knowledge, work, e, &report);
}
static void learn(void) { last = truepose_online_calibrator_step(&learner, q_e); }

static const struct {
  const char* name;
  void (*call)(void);
} entries[] = {{"load", load},
               {"ikm", ikm},
               {"ikm, every rod", ikm_full},
               {"fkm", fkm},
               {"fkm, every rod", fkm_full},
               {"readings", readings},
               {"jacobian", jacobian},
               {"conditioning", conditioning},
               {"tej", motor_tej},
               {"motor_error, TEJ law", tej},
               {"estimate, every rod", estimate},
               {"control, TEJ law", control},
               {"control, estimated law, every rod", estimated},
               {"fault-tolerant, estimated law, every rod", fault_tolerant},
               {"learn, every rod", learn}};

static void* run(void* call) {
  (*(void (**)(void))call)();
  return NULL;
}

static size_t used(void (*call)(void)) {
  pthread_t thread;
  pthread_attr_t own;
  size_t free = 0;
  memset(stack, PAINT, sizeof stack);
  pthread_attr_init(&own);
  pthread_attr_setstack(&own, stack, sizeof stack);
  if (pthread_create(&thread, &own, run, &call)) return 0;
  pthread_join(thread, NULL);
  while (free < sizeof stack && stack[free] == PAINT) ++free;
  return sizeof stack - free;
}

int main(void) {
  const size_t thread = used(nothing);
  size_t k;
  memcpy(x, h4.home, sizeof x);
  memcpy(setpoint.x, h4.home, sizeof x);
  if (truepose_load(&model, sizeof model, &h4).status || (load(), last.status) ||
      truepose_controller_init(&controller, sizeof controller, &h4_control).status ||
      truepose_fault_monitor_init(&monitor, sizeof monitor, &h4_fault_monitor).status ||
      truepose_work(&finest, h4_knowledge.count) > sizeof work / sizeof *work ||
      truepose_online_calibrator_init(&learner, sizeof learner, &finest, &h4_knowledge, memory,
                                      sizeof memory / sizeof *memory)
          .status)
    return 1;
  puts("| entry | stack, kB |\n|---|---|");
  for (k = 0; k < sizeof entries / sizeof *entries; ++k) {
    const size_t bytes = used(entries[k].call) - thread;
    printf("| %s | %.1f |\n", entries[k].name, 1e-3 * (double)bytes);
    if (last.status > TRUEPOSE_OK) return 1;
  }
  return 0;
}
