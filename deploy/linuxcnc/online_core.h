/* What is learnt of the robot while it works: self-calibration at rest. Each time that the machine
 * has stood still for a while its readings are one more line for truepose_online_calibrator_step(),
 * and from that cycle on there is another robot to believe in. Nothing of LinuxCNC is needed. */
#ifndef TRUEPOSE_LINUXCNC_LEARN_CORE_H
#define TRUEPOSE_LINUXCNC_LEARN_CORE_H

#include "table.h"

enum {
  TRUEPOSE_TEJ_WORK = 16384,   /**< numbers of work space, for whatever is given a knowledge */
  TRUEPOSE_LEARNS = 160 * 1024 /**< numbers of memory of a learner of as many as a table has */
};

typedef struct truepose_pupil {
  /* constant once begun */
  truepose_model drawn; /**< what it begins with, at the finest level */
  truepose_knowledge prior;
  int32_t motors, level; /**< at which laws understand the robot that do not weigh */
  int32_t able;          /**< 1: there are sensors, and something is uncertain */
  /* what is believed by now */
  truepose_model robot, finest; /**< at `level`, and at the finest */
  truepose_knowledge known;     /**< of `finest` */
  /* memory */
  truepose_online_calibrator learner;
  truepose_real memory[TRUEPOSE_LEARNS];
  truepose_model next, next_finest;        /**< while it is made */
  truepose_real stands[TRUEPOSE_FREEDOMS]; /**< where the commands have stood, */
  truepose_real since;                     /**< for so many s */
  truepose_real x[TRUEPOSE_FREEDOMS];      /**< the pose that was asked about last */
  int32_t fresh; /**< 1: how well the pose is known by now is to be asked in the next cycle */
  /* out */
  int64_t lines, left_out;  /**< that counted; that fitted no pose, or not the others */
  truepose_outcome outcome; /**< of the latest line */
  truepose_real sigma[TRUEPOSE_FREEDOMS]; /**< of the pose there, by all readings, m or rad */
} truepose_pupil;

/** Begins anew with what a table says. @return what truepose_load() says, or TOO_SMALL */
truepose_outcome truepose_pupil_begin(truepose_pupil* pupil, const truepose_table* table);

/** One cycle in which lines are welcome.
 *
 * @param q_d     commands: the machine stands while none moves by more than its reading's sigma
 * @param q_e     all of them right, as far as anybody knows
 * @param rest    s that it must have stood before a line, and again before the next
 * @param work    TRUEPOSE_TEJ_WORK numbers
 * @return 1: what is believed is another robot from now on
 */
int truepose_pupil_cycle(truepose_pupil* pupil, truepose_real period, truepose_real rest,
                         const truepose_real* q_d, const truepose_real* q_e, truepose_real* work);
/** A reading was found to lie: what the latest lines said is forgotten. @return as above */
int truepose_pupil_forget(truepose_pupil* pupil);

/** Writes what is believed by now as a table of its own: as truepose_write_table(). */
const char* truepose_pupil_keep(const truepose_pupil* pupil, const truepose_table* table,
                                const char* path);

#endif
