/* Wake-up latency and duration of a control cycle on this machine. A fault-tolerant
 * TEJ cycle of the H4 every millisecond, as a controller would run it: memory locked, first
 * in first out, on one core. docs/small-machines.md has the command; seconds and priority are
 * arguments.
 */
#define _GNU_SOURCE
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "h4.h"

enum { PERIOD = 1000000, MOST = 3600000 }; /* ns; cycles */

static truepose_model model, finest;
static truepose_controller controller;
static truepose_fault_monitor monitor;
static truepose_real work[8000], q_e[TRUEPOSE_READINGS], torque[TRUEPOSE_MOTORS];
static truepose_setpoint setpoint;
static truepose_fault_report report;
static int32_t late[MOST], took[MOST];

static int64_t since(const struct timespec* from) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return (now.tv_sec - from->tv_sec) * INT64_C(1000000000) + now.tv_nsec - from->tv_nsec;
}

static int by_size(const void* a, const void* b) {
  const int32_t one = *(const int32_t*)a, other = *(const int32_t*)b;
  return (one > other) - (one < other);
}

static void say(const char* what, int32_t* values, int count) {
  qsort(values, (size_t)count, sizeof *values, by_size);
  printf("| %s | %.1f | %.1f | %.1f | %.1f |\n", what, 1e-3 * values[count / 2],
         1e-3 * values[(int)(0.99 * count)], 1e-3 * values[(int)(0.9999 * count)],
         1e-3 * values[count - 1]);
}

int main(int arguments, char** argument) {
  const int cycles = (arguments > 1 ? atoi(argument[1]) : 10) * 1000;
  const struct sched_param priority = {arguments > 2 ? atoi(argument[2]) : 80};
  struct timespec next;
  if (cycles < 1000 || cycles > MOST) return fputs("seconds: 1 to 3600\n", stderr), 2;
  if (mlockall(MCL_CURRENT | MCL_FUTURE)) puts("memory is not locked: no right to");
  if (sched_setscheduler(0, SCHED_FIFO, &priority)) puts("not first in, first out: no right to");
  memcpy(setpoint.x, h4.home, sizeof setpoint.x);
  if (truepose_load(&model, sizeof model, &h4).status ||
      truepose_load(&finest, sizeof finest, &h4_finest).status ||
      truepose_readings(&finest, h4.home, q_e).status ||
      truepose_controller_init(&controller, sizeof controller, &h4_control).status ||
      truepose_fault_monitor_init(&monitor, sizeof monitor, &h4_fault_monitor).status ||
      truepose_work(&finest, h4_knowledge.count) > sizeof work / sizeof *work)
    return 1;
  clock_gettime(CLOCK_MONOTONIC, &next);
  for (int k = 0; k < cycles; ++k) {
    struct timespec woken;
    next.tv_nsec = (next.tv_nsec + PERIOD) % 1000000000;
    next.tv_sec += next.tv_nsec < PERIOD;
    clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    late[k] = (int32_t)since(&next);
    clock_gettime(CLOCK_MONOTONIC, &woken);
    if (truepose_control_fault_tolerant(&model, &finest, &controller, &monitor, &setpoint, q_e,
                                        &h4_knowledge, work, torque, &report)
            .status)
      return 1;
    took[k] = (int32_t)since(&woken);
  }
  puts("| us | median | 99 % | 99.99 % | largest |\n|---|---|---|---|---|");
  say("woken late by", late, cycles);
  say("cycle took", took, cycles);
  return 0;
}
