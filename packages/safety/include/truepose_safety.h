/**
 * @file
 * Start-up test and momentum observer for machine controllers, in C99.
 *
 * EXPERIMENTAL AND UNCERTIFIED. They are no safety functions: safe torque off, brakes and overspeed
 * are the drives'.
 *
 * What truepose.h says of its functions holds here too. Link truepose_safety before truepose. */
#ifndef TRUEPOSE_SAFETY_H
#define TRUEPOSE_SAFETY_H

#include "truepose/truepose.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ------------------------------------------------------------------------------------------------
 * Start-up test: proves every reading before a law may act. Guide:
 * packages/safety/docs/start-test.md
 */

/** Constant during a test: truepose_start_defaults(), then adapted. */
typedef struct truepose_start_settings {
  uint32_t size; /**< sizeof(truepose_start_settings); see the controller's */
  int32_t pairs; /**< of opposite pulses of each motor, beyond those that find T; 0: only at rest */
  truepose_real motion;      /**< of the platform by two opposite pulses, m; twice that in all */
  truepose_real radius;      /**< at which the platform's turns count as motion, m */
  truepose_real pulse;       /**< wanted time for which a brake is open, s */
  truepose_real settle;      /**< from a closed brake to rest, s */
  truepose_real brake_opens; /**< s; below 0: as it closes (truepose_safety_limits) */
  truepose_real inertia;     /**< factor by which a motor's may be smaller than the model's */
  truepose_real weight;      /**< relative error of the weight that a motor holds */
  truepose_real false_alarm; /**< of the consistency at rest */
  truepose_real friction[TRUEPOSE_MOTORS]; /**< N·m or N (0: the robot's) */
} truepose_start_settings;
TRUEPOSE_API void truepose_start_defaults(truepose_start_settings* settings);

typedef enum truepose_start_state {
  TRUEPOSE_START_REST = 0,    /**< readings are averaged and compared; no torque */
  TRUEPOSE_START_EXPLAIN = 1, /**< they disagree: miswirings are tried; no torque */
  TRUEPOSE_START_LOAD = 2,    /**< the torque of a pulse builds up against the closed brake */
  TRUEPOSE_START_OPEN = 3,    /**< one brake is open */
  TRUEPOSE_START_CLOSE = 4,   /**< it closes; readings are averaged */
  TRUEPOSE_START_JUDGE = 5,   /**< explanations of the motions are tried */
  TRUEPOSE_START_UNLOAD = 6,  /**< the torque goes to zero */
  TRUEPOSE_START_PASSED = 7,  /**< every reading moved consistently; brakes closed, no torque */
  TRUEPOSE_START_FAILED = 8   /**< a finding; brakes closed, no torque */
} truepose_start_state;

/** Name of a finding in English, a constant; 0: none. The guide lists them. */
TRUEPOSE_API const char* truepose_start_finding_text(int32_t finding);

/** Report of a test. Readings and motors as bits: the first 1. */
typedef struct truepose_start_report {
  int32_t state, finding; /**< truepose_start_state; 0: none */
  int32_t part, other;    /**< the finding's reading (of q_e) or motor, from 0, or -1 */
  uint32_t candidates;    /**< readings that may be miswired, where several explanations fit */
  uint32_t exchangeable;  /**< passed: readings whose exchange would not have been seen */
  uint32_t brakes;        /**< motors whose brakes must hold */
  int32_t motor;          /**< that is tested, from 0 */
  truepose_real torque[TRUEPOSE_MOTORS];  /**< to the motors, N·m or N */
  truepose_real scale[TRUEPOSE_READINGS]; /**< of every reading, 1: as the others show, */
  truepose_real sigma[TRUEPOSE_READINGS]; /**< and its standard deviation; infinite where
                                               nothing has shown it */
} truepose_start_report;

/** Settings, limits and state of a test. Opaque. */
typedef union truepose_start_test {
  int64_t align;
  unsigned char bytes[8192];
} truepose_start_test;
TRUEPOSE_API size_t truepose_start_test_size(void);
/** Begins a test. @param settings  may be null @return OTHER_VERSION, TOO_SMALL; NOT_SQUARE: more
 * motors than freedoms, so that brakes hold each; NO_SUCH_VALUE: limits that contradict themselves,
 * `part`: the motor */
TRUEPOSE_API truepose_outcome truepose_start_test_init(truepose_start_test* test, size_t size,
                                                       const truepose_model* model,
                                                       const truepose_start_settings* settings,
                                                       const truepose_safety_limits* limits);
/** One cycle, until the state is PASSED or FAILED and the torques are 0.
 * @param referenced  1: the motors are referenced
 * @param known, work  tolerances for the consistency at rest; may be null: not tested
 * @return UNFINISHED: something is not initialised, and the report is unchanged */
TRUEPOSE_API truepose_outcome truepose_start_test_cycle(
    const truepose_model* model, truepose_start_test* test,
    const truepose_real q_e[TRUEPOSE_READINGS], int32_t referenced, const truepose_knowledge* known,
    truepose_real* work, truepose_start_report* report);

/* ------------------------------------------------------------------------------------------------
 * Momentum observer: external forces and their causes. Guide: packages/safety/docs/disturbances.md
 */

/** Constant while external forces are observed: truepose_momentum_defaults(), then adapted. */
typedef struct truepose_momentum_settings {
  uint32_t size;           /**< sizeof(truepose_momentum_settings); see the controller's */
  int32_t carry;           /**< 1: an identified payload is fed forward; default 0 */
  truepose_real period;    /**< s, of whole control periods */
  truepose_real bandwidth; /**< rad/s */
  truepose_real alarm;     /**< chi-square of the residual above which there is a disturbance */
  truepose_real share;     /**< sigma of masses and torques, as a share of the torque */
  truepose_real named;     /**< share of the residual that a named cause accounts for, */
  truepose_real kept;      /**< and one that is named already */
  truepose_real window;    /**< time constant with which older samples are forgotten, s */
  truepose_real over;      /**< time below a quarter of `alarm` until a disturbance is over, s */
  truepose_real sigma[TRUEPOSE_MOTORS]; /**< of unknown friction and counts, N·m or N */
  truepose_real give[TRUEPOSE_MOTORS];  /**< error at which a loop balances 1 N·m (N), rad or m */
} truepose_momentum_settings;
/** @param settings  of the loops; kp alone matters
 * @return NO_SUCH_VALUE (`part`: the motor): without torque limit or gain, `momentum` unchanged */
TRUEPOSE_API truepose_outcome truepose_momentum_defaults(const truepose_model* model,
                                                         const truepose_control_settings* settings,
                                                         truepose_momentum_settings* momentum);
/** Settings and state of an observer. Opaque. */
typedef union truepose_momentum_observer {
  int64_t align;
  unsigned char bytes[4096];
} truepose_momentum_observer;
TRUEPOSE_API size_t truepose_momentum_observer_size(void);
/** From now on a monitor observes external forces, anew; after truepose_fault_monitor_init().
 * @param observer  stays in place while the monitor is used, for no other one
 * @param momentum  null: it does not observe, and `observer` may be null
 * @return UNFINISHED, OTHER_VERSION, NOT_FINITE, NO_SUCH_VALUE, TOO_SMALL: the monitor is unchanged
 */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_momentum(
    truepose_fault_monitor* monitor, truepose_momentum_observer* observer, size_t size,
    const truepose_momentum_settings* momentum);
/** Observes forces where the drives close their own loops: after truepose_fault_monitor_step().
 * truepose_control_fault_tolerant() and truepose_control_safely() include it.
 * @param torque  of the motors in the last control period, n, N·m or N @return UNFINISHED */
TRUEPOSE_API truepose_outcome
truepose_fault_monitor_observe(const truepose_model* model, truepose_fault_monitor* monitor,
                               const truepose_real torque[TRUEPOSE_MOTORS]);

typedef enum truepose_disturbance_kind {
  TRUEPOSE_NO_DISTURBANCE = 0,
  TRUEPOSE_PAYLOAD = 1,  /**< a mass at the platform's point D */
  TRUEPOSE_FRICTION = 2, /**< of one motor, beyond the modelled one */
  TRUEPOSE_CONTACT = 3   /**< a force on the platform that is neither */
} truepose_disturbance_kind;
/** An external force. */
typedef struct truepose_disturbance {
  int32_t kind;        /**< a truepose_disturbance_kind */
  int32_t motor;       /**< of friction, from 0; or -1 */
  int32_t refused;     /**< 1: the payload is too heavy for the motors, and not fed forward */
  truepose_real size;  /**< kg; N·m or N of friction; norm of the contact's force */
  truepose_real sigma; /**< of a payload or friction */
  truepose_real chi2;  /**< of the residual */
  truepose_real force[TRUEPOSE_FREEDOMS]; /**< on the platform's coordinates, N and N·m */
} truepose_disturbance;
/** The observed disturbance of the last cycle; none without an observer. @return UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_disturbance(
    const truepose_fault_monitor* monitor, truepose_disturbance* disturbance);

#ifdef __cplusplus
}
#endif

#endif
