/**
 * @file
 * Start-up test, safety shell and momentum observer for machine controllers, in C99.
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
 * packages/safety/docs/commissioning.md
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
 * Safety shell: limits around any law, defined stops, causes that last. Guide:
 * packages/safety/docs/commissioning.md
 */

typedef enum truepose_safety_state {
  TRUEPOSE_SAFETY_READY = 0,    /**< acknowledged and healthy; brakes closed, waits for a start */
  TRUEPOSE_SAFETY_RUNNING = 1,  /**< brakes open; the law acts once they have opened */
  TRUEPOSE_SAFETY_STOPPING = 2, /**< along the path or by brake */
  TRUEPOSE_SAFETY_STOPPED = 3,  /**< after a requested stop, and when switched on */
  TRUEPOSE_SAFETY_FAULT = 4     /**< after a violation */
} truepose_safety_state;

typedef enum truepose_stop_cause {
  TRUEPOSE_STOP_NONE = 0,
  TRUEPOSE_STOP_REQUESTED = 1,
  TRUEPOSE_STOP_CONTRADICTORY_LIMITS = 2,
  TRUEPOSE_STOP_CLOCK_BACKWARDS = 3,
  TRUEPOSE_STOP_DROPPED_FRAMES = 4,
  TRUEPOSE_STOP_STALE_FRAME = 5,
  TRUEPOSE_STOP_MISSING_READING = 6,
  TRUEPOSE_STOP_UNKNOWN_POSE = 7,
  TRUEPOSE_STOP_SUSPECTED_MOTOR = 8,
  TRUEPOSE_STOP_READINGS_DISAGREE = 9,
  TRUEPOSE_STOP_NO_ANSWER = 10,
  TRUEPOSE_STOP_WORKSPACE = 11,
  TRUEPOSE_STOP_SETPOINT_SPEED = 12,
  TRUEPOSE_STOP_MOTOR_RANGE = 13,
  TRUEPOSE_STOP_OVERSPEED = 14,
  TRUEPOSE_STOP_TRACKING_ERROR = 15,
  TRUEPOSE_STOP_TORQUE_RATE = 16,
  TRUEPOSE_STOP_SATURATION = 17,
  TRUEPOSE_STOP_NOT_READY = 18 /**< refusal of a request: not in this state */
} truepose_stop_cause;
/** Name of a cause in English, a constant. */
TRUEPOSE_API const char* truepose_stop_cause_text(int32_t cause);

/** What a cycle's frame and the operator say. Requests act when they begin. */
typedef struct truepose_safety_marks {
  uint64_t counter, time;            /**< of the frame; the time in ns */
  int32_t counter_given, time_given; /**< 1: the frame has it */
  int32_t known;                     /**< 1: the motors are referenced */
  int32_t start, stop, acknowledge;  /**< 1: requested */
} truepose_safety_marks;

/** Report of a shell. Motors and causes as bits: the first motor 1, cause c 1 << c. */
typedef struct truepose_safety_report {
  int32_t state;           /**< truepose_safety_state */
  int32_t cause, part;     /**< truepose_stop_cause since the acknowledgement, its motor or -1 */
  int32_t refused;         /**< why a request of this cycle has no effect */
  uint32_t causes;         /**< all since the acknowledgement */
  uint32_t brakes;         /**< motors whose brakes must hold */
  int32_t follows;         /**< 1: the law acts, and the path moves */
  int32_t unused;          /**< 0 */
  truepose_real path_stop; /**< duration of a stop along the path, s, for truepose_advance() */
  truepose_real torque[TRUEPOSE_MOTORS]; /**< to the motors, N·m or N */
} truepose_safety_report;

/** Limits and state of a shell. Opaque. */
typedef union truepose_safety_shell {
  int64_t align;
  unsigned char bytes[4096];
} truepose_safety_shell;
TRUEPOSE_API size_t truepose_safety_shell_size(void);

/** Switches a shell on: stopped, with closed brakes. @return OTHER_VERSION, TOO_SMALL;
 * NO_SUCH_VALUE: limits that contradict themselves, `part`: the motor */
TRUEPOSE_API truepose_outcome truepose_safety_shell_init(truepose_safety_shell* shell, size_t size,
                                                         const truepose_model* model,
                                                         const truepose_safety_limits* limits);

/** One cycle inside the shell: truepose_control(), or truepose_control_fault_tolerant() where there
 * is a monitor. Torques and brakes are the report's, whatever the outcome.
 * @param finest, monitor  may be null: then no reading is monitored
 * @return of the law; UNFINISHED: something is not initialised, and the report is unchanged */
TRUEPOSE_API truepose_outcome truepose_control_safely(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, truepose_safety_shell* shell,
    const truepose_setpoint* setpoint, const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, const truepose_safety_marks* marks,
    truepose_safety_report* report);

/** One cycle of a controller that is not truepose's. Motors as bits: the first one's 1. */
typedef struct truepose_safety_cycle {
  int32_t status;                        /**< truepose_status of the controller's answer */
  int32_t disagree;                      /**< 1: readings disagree, none is isolated */
  uint32_t suspected;                    /**< motors that may be faulty, */
  uint32_t lost;                         /**< and those without a substitute */
  truepose_real x[TRUEPOSE_FREEDOMS];    /**< pose of the setpoint */
  truepose_real q_d[TRUEPOSE_MOTORS];    /**< motor setpoints, */
  truepose_real q[TRUEPOSE_MOTORS];      /**< readings, */
  truepose_real error[TRUEPOSE_MOTORS];  /**< motor errors that the loop reduces, */
  truepose_real torque[TRUEPOSE_MOTORS]; /**< the controller's torques, N·m or N, */
  truepose_real load[TRUEPOSE_MOTORS];   /**< and the last part of them that is not the loop's */
} truepose_safety_cycle;

/** The shell alone, after the controller's cycle. Restart the controller in each cycle in which the
 * report before has `follows` 0. @return UNFINISHED, and the report is unchanged */
TRUEPOSE_API truepose_outcome truepose_guard(const truepose_model* model,
                                             truepose_safety_shell* shell,
                                             const truepose_safety_cycle* cycle,
                                             const truepose_safety_marks* marks,
                                             truepose_safety_report* report);

/* ------------------------------------------------------------------------------------------------
 * Momentum observer: external forces and their causes. Guide: docs/fault-methods.md
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
