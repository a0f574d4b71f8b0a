/* Law of the paper's Figure 2 for drives with their own loops: the motor error ê that they are to
 * reduce in each cycle. Functions on blocks of memory, independent of LinuxCNC.
 *
 * Motor commands and readings are those of the robot file: rad or m. The output is the joint law's
 * own error plus a correction, c = ê - (q_d - q). Only the correction is blended: a drive with
 * c = 0 follows its own encoder.
 *
 * Motion reads q - c, never the bare encoders: while the drives are off it therefore keeps its last
 * command. The correction is held during that time and the blend starts from it, so off and on
 * again moves nothing. */
#ifndef TRUEPOSE_LINUXCNC_TEJ_CORE_H
#define TRUEPOSE_LINUXCNC_TEJ_CORE_H

#include "online_core.h"
#include "truepose_safety.h"

/** Reasons why the requested law is not in effect. */
typedef enum truepose_corrector_fault {
  TRUEPOSE_TEJ_NO_FAULT = 0,
  TRUEPOSE_TEJ_READING = 1,    /**< a reading is not a number */
  TRUEPOSE_TEJ_COMMAND = 2,    /**< a command is not a number: the last output is held */
  TRUEPOSE_TEJ_UNSOLVED = 3,   /**< the command is no pose of the robot, or the law has no answer */
  TRUEPOSE_TEJ_CORRECTION = 4, /**< the correction is larger than allowed */
  TRUEPOSE_TEJ_MONITOR = 5,    /**< the fault monitor requests a stop, or every sensor has failed */
  TRUEPOSE_TEJ_HOMING = 6,     /**< the readings are inconsistent after referencing */
  TRUEPOSE_TEJ_SAFETY = 7      /**< a limit of the safety shell is violated: `safe.cause` */
} truepose_corrector_fault;

typedef struct truepose_corrector_input {
  int32_t enable;      /**< the drives are on */
  int32_t law;         /**< a truepose_law */
  int32_t monitor;     /**< enables the fault monitor, if configured in the table */
  int32_t safety;      /**< enables the safety shell */
  int32_t proven;      /**< 1: the shell may start; 0: its start-up test has not passed */
  int32_t frame_known; /**< 1: `frame` counts the frames of readings */
  uint32_t frame;      /**< it may wrap */
  int32_t observe;     /**< 1: external forces are observed, by `torque`; needs `monitor` */
  int32_t reset;       /**< clears faults, acknowledges inconsistency after homing, and the shell */
  int32_t referenced;  /**< every sensor's and motor's zero is known */
  int32_t learn;       /**< identifies at rest, with every reading valid */
  int32_t learnt;      /**< laws use the identified robot, not the table's */
  truepose_real rest;  /**< s at rest before each identification step */
  truepose_real band;  /**< conditioning below which the law is damped */
  truepose_real blend; /**< s over which a change of the law takes effect */
  truepose_real chi2;  /**< largest accepted χ² of the readings once referenced; 0: any */
  truepose_real largest[TRUEPOSE_MOTORS]; /**< largest accepted correction, rad or m */
  truepose_real speed[TRUEPOSE_MOTORS];   /**< shell: largest of a motor, rad/s or m/s; 0: any */
  truepose_real error_limit[TRUEPOSE_MOTORS]; /**< shell: largest motor error, rad or m */
  truepose_real
      zero[TRUEPOSE_MOTORS]; /**< motion's motor offsets; a change means that the motor was homed */
  truepose_real q_d[TRUEPOSE_MOTORS];    /**< commands */
  truepose_real torque[TRUEPOSE_MOTORS]; /**< of the motors, as the drives measure it, N·m or N */
  truepose_real q_e[TRUEPOSE_READINGS];
} truepose_corrector_input;

typedef struct truepose_corrector {
  /* constant after initialisation */
  truepose_model commanded; /**< robot of motion's kinematics, for which commands are made */
  truepose_table table;
  truepose_model model; /**< of the table */
  int32_t motors, sensors;
  truepose_real period;
  /* state */
  truepose_pupil pupil;
  int32_t learnt;             /**< model of the laws: 0 the table's robot, 1 the identified one */
  truepose_knowledge weighed; /**< of that, adapted to the valid readings */
  truepose_fault_monitor monitor;
  truepose_momentum_observer forces;
  truepose_controller controller; /**< for the law and the band below */
  int32_t begun;
  truepose_real band;
  truepose_real work[TRUEPOSE_TEJ_WORK];
  int32_t monitoring, enabled, observing;
  truepose_safety_shell shell;
  int32_t guarding, acknowledging;
  truepose_real x_d[6]; /**< pose of the commands */
  truepose_real zero[TRUEPOSE_MOTORS],
      homed_by[TRUEPOSE_MOTORS]; /**< motor offsets, and corrections when homed */
  truepose_real held[TRUEPOSE_MOTORS],
      at[TRUEPOSE_MOTORS];             /**< of the last cycle with the drives on: correction, q */
  int32_t questioned;                  /**< 1: the consistency of the readings is to be tested */
  truepose_real led[TRUEPOSE_MOTORS];  /**< by which the drives' loops have led the motors off their
                                          commands */
  truepose_real from[TRUEPOSE_MOTORS]; /**< difference from the earlier correction, ramped out */
  truepose_real since;                 /**< s since the law changed, */
  int32_t changed;                     /**< or its inputs, in this cycle; 2: the robot model */
  truepose_real longest;               /**< s over which another model takes effect at least */
  int32_t given, exchanged; /**< 1: the identified robot is another (exchange_core.h); was once */
  /* out */
  truepose_real
      error[TRUEPOSE_MOTORS]; /**< output for the drives to reduce: (q_d - q) + correction */
  truepose_real correction[TRUEPOSE_MOTORS];
  truepose_real e_q[TRUEPOSE_MOTORS]; /**< q_d - q: the following error */
  int32_t law;                        /**< in effect */
  int32_t fault;     /**< a truepose_corrector_fault; until reset, or the drives go on */
  uint32_t lost;     /**< motors without reading or command, as bits: disable their amplifiers;
                        all, once the shell stops them by brake */
  int32_t stop;      /**< 1: the machine must stop along its path */
  uint32_t doubted;  /**< readings that are not valid, as bits; among these */
  uint32_t left_out; /**< those that have failed: virtual readings substitute them */
  truepose_outcome outcome;           /**< of this cycle's last call that was not ok */
  truepose_outcome reason;            /**< of the last fault; until reset */
  int32_t symptom[TRUEPOSE_READINGS]; /**< of failed readings; until reset */
  truepose_real pose[6];              /**< estimated by the law in effect; held while off */
  truepose_fault_report report;
  truepose_disturbance disturbance; /**< external force; kind 0 while it is not observed */
  truepose_safety_report safe;      /**< of the shell; zeros without it */
  uint32_t brakes;                  /**< motors whose brakes must hold, as bits */
  int32_t inhibit;                  /**< 1: the path must not move, or must stop */
} truepose_corrector;

/** @param tej        with its table read
 * @param commanded  robot of motion's kinematics: the table's own, or that it was identified from
 * @return as truepose_load(), NO_SUCH_PART for another robot, or TOO_SMALL */
truepose_outcome truepose_corrector_begin(truepose_corrector* tej,
                                          const truepose_description* commanded,
                                          truepose_real period);
/** Runs one cycle. Outputs are finite for any input. */
void truepose_corrector_cycle(truepose_corrector* tej, const truepose_corrector_input* input);

/** Limits of the safety shell. Drives follow a velocity: there is no torque, and their position
 * loops are assumed as exported. Motion has the soft limits. */
truepose_safety_limits truepose_corrector_limits(const truepose_corrector* tej,
                                                 const truepose_corrector_input* input);

/** Referencing of a sensor that counts from power-on, by its encoder's index at a known reading. */
typedef struct truepose_index {
  int32_t armed, known;
} truepose_index;
/** Runs one cycle. @param index_enable  HAL's: set to request the index; cleared by the encoder
 * at the index, where it then counts from 0 @return 1: readings are the index's plus the count */
int truepose_index_cycle(truepose_index* index, int enable, int* index_enable);

#endif
