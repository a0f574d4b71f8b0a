/* A machine that is simulated: true geometry, drives that take velocities, encoders with counts,
 * and faults. Nothing of LinuxCNC is needed. */
#ifndef TRUEPOSE_LINUXCNC_PLANT_CORE_H
#define TRUEPOSE_LINUXCNC_PLANT_CORE_H

#include "table.h"

typedef enum truepose_plant_fault {
  TRUEPOSE_PLANT_HEALTHY = 0,
  TRUEPOSE_PLANT_MISSING = 1, /**< reads NaN */
  TRUEPOSE_PLANT_FROZEN = 2,  /**< reads what it read last */
  TRUEPOSE_PLANT_JUMPED = 3   /**< reads so much too much */
} truepose_plant_fault;

typedef struct truepose_plant {
  truepose_model model;
  truepose_description robot; /**< as it is, not as it is believed to be */
  truepose_real period;
  int32_t motors, readings;
  int32_t coarse;                        /**< 1: encoders have counts */
  int32_t absolute[TRUEPOSE_READINGS];   /**< 1: does not count from power-on */
  truepose_real q[6];                    /**< the motors' true readings */
  truepose_real x[6];                    /**< the true pose */
  truepose_real q_e[TRUEPOSE_READINGS];  /**< true readings */
  truepose_real zero[TRUEPOSE_READINGS]; /**< where each counts from */
  truepose_real read[TRUEPOSE_READINGS]; /**< out: what encoders say */
  int32_t blocked; /**< 1: the drives pull it where it cannot go: it stays where it is */
} truepose_plant;

/** @param q  where its motors are at power-on, where its encoders begin to count
 * @return as truepose_load(), truepose_fkm() */
truepose_outcome truepose_plant_begin(truepose_plant* plant, const truepose_description* robot,
                                      truepose_real period, const truepose_real q[6]);
/** One cycle.
 *
 * @param velocity      of the motors, rad/s or m/s
 * @param fault, size   of every reading
 * @param index         readings at which the encoders have their index
 * @param index_enable  in: asked for; out: 0 where it has just been passed, and is the new zero
 */
void truepose_plant_cycle(truepose_plant* plant, const truepose_real velocity[6],
                          const int32_t fault[TRUEPOSE_READINGS],
                          const truepose_real size[TRUEPOSE_READINGS],
                          const truepose_real index[TRUEPOSE_READINGS],
                          int index_enable[TRUEPOSE_READINGS]);

#endif
