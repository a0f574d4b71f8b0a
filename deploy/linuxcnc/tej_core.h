/* The paper's Figure 2 in front of drives that close their own loops: each cycle, which motor error
 * ê should they reduce? Functions of blocks of memory; nothing of LinuxCNC is needed.
 *
 * Motors' commands and readings are those of the robot's file: rad or m. What is applied is the
 * joint law's own error plus a correction, c = ê - (q_d - q). Only the correction is ever blended:
 * a drive that follows c = 0 follows its own encoder.
 *
 * Motion reads q - c, never the bare encoders: what it takes for its command while the drives are
 * off is then the command it had. The correction is held while they are off, and the blend starts
 * from it; off and on again moves nothing. */
#ifndef TRUEPOSE_LINUXCNC_TEJ_CORE_H
#define TRUEPOSE_LINUXCNC_TEJ_CORE_H

#include "online_core.h"

/** Why the law is not the one asked for. */
typedef enum truepose_corrector_fault {
  TRUEPOSE_TEJ_NO_FAULT = 0,
  TRUEPOSE_TEJ_READING = 1,    /**< a reading is not a number */
  TRUEPOSE_TEJ_COMMAND = 2,    /**< a command is not a number: what was given last is held */
  TRUEPOSE_TEJ_UNSOLVED = 3,   /**< the command is no pose of the robot, or the law has no answer */
  TRUEPOSE_TEJ_CORRECTION = 4, /**< larger than allowed */
  TRUEPOSE_TEJ_WATCH = 5,      /**< the watch asks for a stop, or every sensor has failed */
  TRUEPOSE_TEJ_HOMING = 6      /**< once referenced, readings contradict each other */
} truepose_corrector_fault;

typedef struct truepose_corrector_input {
  int32_t enable;           /**< the drives are on */
  int32_t law;              /**< a truepose_law */
  int32_t watch;            /**< readings are watched, where the table says how */
  int32_t reset;            /**< faults are forgotten, contradictions after homing acknowledged */
  int32_t referenced;       /**< every sensor's zero is known, and every motor's */
  int32_t learn;            /**< at rest, with every reading valid */
  int32_t learnt;           /**< laws believe in what was learnt, not in the table's robot */
  truepose_real rest;       /**< s that the machine must have stood before it learns, and again */
  truepose_real band;       /**< conditioning below which the law is damped */
  truepose_real blend;      /**< s over which a change of the law takes effect */
  truepose_real chi2;       /**< of the readings once referenced, that is accepted; 0: any */
  truepose_real largest[6]; /**< correction that is accepted, rad or m */
  truepose_real zero[6];    /**< motion's motor offsets: another one, and the motor was homed */
  truepose_real q_d[6];     /**< commands */
  truepose_real q_e[TRUEPOSE_READINGS];
} truepose_corrector_input;

typedef struct truepose_corrector {
  /* constant once begun */
  truepose_model commanded; /**< the robot that commands are made for: of motion's kinematics */
  truepose_table table;
  truepose_model model; /**< of the table */
  int32_t motors, sensors;
  truepose_real period;
  /* memory */
  truepose_pupil pupil;
  int32_t learnt;             /**< what laws believe in: 0 the table's robot, 1 what was learnt */
  truepose_knowledge weighed; /**< of that, and of the readings that are believed */
  truepose_fault_monitor guard;
  truepose_controller controller; /**< of the law and the band below */
  int32_t begun;
  truepose_real band;
  truepose_real work[TRUEPOSE_TEJ_WORK];
  int32_t guarding, enabled;
  truepose_real x_d[6];               /**< pose of the commands */
  truepose_real zero[6], homed_by[6]; /**< motors' offsets, and corrections they were homed under */
  truepose_real held[6], at[6];       /**< of the latest cycle with the drives on: correction, q */
  int32_t questioned;                 /**< 1: whether the readings fit each other is to be tested */
  truepose_real from[6];              /**< what of an earlier correction is left to be ramped out */
  truepose_real since;                /**< s since the law changed, */
  int32_t changed;                    /**< or what it goes by, in this cycle */
  /* out */
  truepose_real error[6]; /**< what the drives are to reduce: (q_d - q) + correction */
  truepose_real correction[6];
  truepose_real e_q[6]; /**< q_d - q: what a following error is */
  int32_t law;          /**< in effect */
  int32_t fault;        /**< a truepose_corrector_fault; stays until reset, or the drives go on */
  uint32_t lost;        /**< motors not heard, or not told, as bits: amplifiers are to go off */
  int32_t stop;         /**< 1: the machine is to come to rest along its path */
  uint32_t doubted;     /**< readings that the watch does not believe, as bits, and of these */
  uint32_t left_out;    /**< those that have failed: what others say stands for them */
  truepose_outcome outcome;           /**< of this cycle's latest call that had something to say */
  truepose_outcome reason;            /**< of the latest fault; stays until reset */
  int32_t symptom[TRUEPOSE_READINGS]; /**< of readings that failed; stays until reset */
  truepose_real chi2;                 /**< of the readings when they were tested last */
  truepose_real pose[6];              /**< estimated by the law in effect; while off, as held */
  truepose_fault_report report;
} truepose_corrector;

/** @param tej        its table read
 * @param commanded  of motion's kinematics: the table's own robot, or the one it was learnt from
 * @return what truepose_load() says, NO_SUCH_PART of another robot, or TOO_SMALL */
truepose_outcome truepose_corrector_begin(truepose_corrector* tej,
                                          const truepose_description* commanded,
                                          truepose_real period);
/** One cycle. Whatever the input, what goes out is finite. */
void truepose_corrector_cycle(truepose_corrector* tej, const truepose_corrector_input* input);

/** How the zero of a sensor that counts from power-on becomes known: its encoder's index, which
 * is at a known reading. */
typedef struct truepose_index {
  int32_t armed, known;
} truepose_index;
/** One cycle. @param index_enable  HAL's: set to ask for the index, cleared by the encoder when it
 * has passed, and counts from 0 there @return 1: readings are the index's plus what is counted */
int truepose_index_cycle(truepose_index* index, int enable, int* index_enable);

#endif
