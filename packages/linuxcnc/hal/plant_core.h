/* Simulated machine: true geometry, velocity drives, encoders with counts, and faults. */
#ifndef TRUEPOSE_LINUXCNC_PLANT_CORE_H
#define TRUEPOSE_LINUXCNC_PLANT_CORE_H

#include "table.h"

typedef enum truepose_plant_fault {
  TRUEPOSE_PLANT_HEALTHY = 0,
  TRUEPOSE_PLANT_MISSING = 1, /**< reads NaN */
  TRUEPOSE_PLANT_FROZEN = 2,  /**< repeats its last reading */
  TRUEPOSE_PLANT_JUMPED = 3   /**< reads too much by `size` */
} truepose_plant_fault;

typedef struct truepose_plant {
  truepose_model model;
  truepose_description robot; /**< the true robot, not its model */
  truepose_real period;
  int32_t motors, readings;
  int32_t coarse;                        /**< 1: readings are quantized */
  int32_t absolute[TRUEPOSE_READINGS];   /**< 1: absolute encoder, does not count from power-on */
  truepose_real q[TRUEPOSE_MOTORS];      /**< the motors' true readings */
  truepose_real x[6];                    /**< the true pose */
  truepose_real q_e[TRUEPOSE_READINGS];  /**< true readings */
  truepose_real zero[TRUEPOSE_READINGS]; /**< reading that each counts from */
  truepose_real read[TRUEPOSE_READINGS]; /**< out: the encoders' readings */
  int32_t blocked; /**< 1: the drives push it out of its workspace: it stays */
} truepose_plant;

/** @param q  motor positions at power-on, where the encoders count from
 * @return as truepose_load(), truepose_fkm() */
truepose_outcome truepose_plant_begin(truepose_plant* plant, const truepose_description* robot,
                                      truepose_real period, const truepose_real q[TRUEPOSE_MOTORS]);
/** Runs one cycle.
 * @param velocity      of the motors, rad/s or m/s
 * @param fault, size   of every reading
 * @param index         readings at the encoders' index
 * @param index_enable  in: requested; out: 0 where the index was just passed and is the new zero */
void truepose_plant_cycle(truepose_plant* plant, const truepose_real velocity[TRUEPOSE_MOTORS],
                          const int32_t fault[TRUEPOSE_READINGS],
                          const truepose_real size[TRUEPOSE_READINGS],
                          const truepose_real index[TRUEPOSE_READINGS],
                          int index_enable[TRUEPOSE_READINGS]);

#endif
