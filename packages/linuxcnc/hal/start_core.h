/* Start-up test of a machine that is off (packages/safety/docs/commissioning.md). Independent of
 * LinuxCNC.
 *
 * Level 1 compares the readings at rest: brakes closed, no torque, for any drive. Level 2 then
 * pulses each motor by a torque, for drives that take torques while the test runs. A sensor that
 * still has to pass its index takes part from where the motors see it: it must stand still and move
 * consistently. The corrector tests its value once the index is passed. */
#ifndef TRUEPOSE_LINUXCNC_START_CORE_H
#define TRUEPOSE_LINUXCNC_START_CORE_H

#include "tej_core.h"

typedef struct truepose_starter_input {
  int32_t request;      /**< its rising edge begins a test */
  int32_t level;        /**< 0 no test, 1 at rest, 2 with pulses */
  truepose_real brake;  /**< s in which a brake closes, */
  truepose_real opens;  /**< and opens */
  truepose_real motion; /**< of the platform by two opposite pulses, m; at most twice that in all */
  int32_t homed;        /**< every motor's zero is known */
  uint32_t known; /**< sensors whose zero is known, as bits. Of others only motion is tested */
} truepose_starter_input;

typedef struct truepose_starter {
  truepose_start_test test;
  int32_t asked, level;                 /**< last request; level of this test */
  truepose_real zero[TRUEPOSE_SENSORS]; /**< assumed where it is not known: by the motors */
  /* out */
  truepose_start_report report; /**< its torques are for the drives while `pulses` */
  int32_t running, pulses;      /**< 1: brakes are the report's; and so are torques */
  int32_t reached;              /**< level of the last test, if it passed; otherwise 0 */
} truepose_starter;

/** Runs one cycle, after the corrector's.
 * @return 1: a test has just ended */
int truepose_starter_cycle(truepose_starter* starter, const truepose_starter_input* input,
                           truepose_corrector* tej, const truepose_corrector_input* in);

#endif
