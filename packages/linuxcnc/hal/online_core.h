/* Online calibration at rest. Each time the machine has been at rest for a while, its readings are
 * one more row for truepose_online_calibrator_step(), which updates the robot from that cycle on.
 * Independent of LinuxCNC. */
#ifndef TRUEPOSE_LINUXCNC_LEARN_CORE_H
#define TRUEPOSE_LINUXCNC_LEARN_CORE_H

#include "table.h"

enum {
  TRUEPOSE_TEJ_WORK = 16384,   /**< numbers of work space for functions with a knowledge */
  TRUEPOSE_LEARNS = 160 * 1024 /**< numbers of memory of a calibrator of the largest table */
};

typedef struct truepose_pupil {
  /* constant after initialisation */
  truepose_model drawn; /**< initial robot, at its highest level */
  truepose_knowledge prior;
  int32_t motors, level; /**< level of unweighted laws */
  int32_t able;          /**< 1: there are sensors, and something is uncertain */
  /* current robot */
  truepose_model robot, finest; /**< at `level`, and at the highest */
  truepose_knowledge known;     /**< of `finest` */
  /* state */
  truepose_online_calibrator learner;
  truepose_real memory[TRUEPOSE_LEARNS];
  truepose_model next, next_finest;      /**< under construction */
  truepose_real stands[TRUEPOSE_MOTORS]; /**< where the commands have been constant, */
  truepose_real since;                   /**< for this time, s */
  truepose_real x[TRUEPOSE_FREEDOMS];    /**< pose of the last accuracy estimate */
  int32_t fresh; /**< 1: the next cycle is to estimate the pose's accuracy */
  /* out */
  int64_t lines, left_out;  /**< used rows; rows that fit no pose or contradict the others */
  truepose_outcome outcome; /**< of the last row */
  truepose_real
      sigma[TRUEPOSE_FREEDOMS]; /**< of the pose at the last accuracy estimate, m or rad */
  truepose_real chi2;           /**< of the readings there */
} truepose_pupil;

/** Initialises from a table. @return as truepose_load(), or TOO_SMALL */
truepose_outcome truepose_pupil_begin(truepose_pupil* pupil, const truepose_table* table);

/** Runs one cycle in which rows may be used.
 * @param q_d   commands: at rest while none moves by more than its reading's sigma
 * @param q_e   readings without known faults
 * @param rest  s at rest before a row, and again before the next
 * @param work  TRUEPOSE_TEJ_WORK numbers
 * @return 1: the robot changes from now on */
int truepose_pupil_cycle(truepose_pupil* pupil, truepose_real period, truepose_real rest,
                         const truepose_real* q_d, const truepose_real* q_e, truepose_real* work);
/** Rolls back the last rows after a fault of a reading. @return as above */
int truepose_pupil_forget(truepose_pupil* pupil);

/** Makes `next` of `next_finest`. @return as truepose_load() */
truepose_outcome truepose_pupil_load(truepose_pupil* pupil);
/** Makes `next` and `next_finest` the current robot. */
void truepose_pupil_adopt(truepose_pupil* pupil);
/** Computes the accuracy of the pose where the machine is, and χ², from all readings.
 * @param chi2  largest accepted χ² of the readings; 0: any
 * @return as truepose_fkm() and truepose_estimate(); DISAGREE: χ² is larger */
truepose_outcome truepose_pupil_accuracy(truepose_pupil* pupil, const truepose_model* finest,
                                         const truepose_knowledge* known, const truepose_real* q_e,
                                         truepose_real chi2, truepose_real* work);

/** Makes the current robot the table's, and writes that: as truepose_write_table(). */
const char* truepose_pupil_keep(const truepose_pupil* pupil, truepose_table* table,
                                const char* path);

#endif
