/**
 * @file
 * truepose for machine controllers, in C99. Guide: docs/c.md.
 *
 * A robot is a constant table, truepose_description, which may be in flash (`truepose export c`
 * writes it). truepose_load() checks it and makes a truepose_model of it in the caller's memory.
 * All other functions use the model.
 *
 * No function allocates, locks, throws or blocks; each ends after a bounded number of steps and
 * needs only libm. Models are constant once loaded: any number of threads may share one.
 * Controllers, monitors, calibrators and work space belong to one thread each. Pointers must be
 * valid; where one may be null, its description says so.
 *
 * Units are m, rad, kg, s, N and N·m. Frames are the base's unless stated otherwise. Matrices are
 * stored by rows. Arrays have the lengths below for every robot: with n freedoms, m motors and r
 * sensors the first n, m, r or m + r entries are used, and output beyond them is 0. With m > n
 * poses are the least squares of the readings, and torques the smallest that give a force.
 *
 * Every function that can fail returns a truepose_outcome, alone or in its result. Up to
 * TRUEPOSE_OK there is an answer; above there is none, and the outputs are unchanged. */
#ifndef TRUEPOSE_TRUEPOSE_H
#define TRUEPOSE_TRUEPOSE_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(TRUEPOSE_BUILDS_SHARED) && defined(__GNUC__)
#define TRUEPOSE_API __attribute__((visibility("default")))
#else
#define TRUEPOSE_API
#endif

/** Version of the tables and functions below. A library loads only tables of its own version. */
#define TRUEPOSE_ABI 5

/** Type of every number. Single-precision libraries and their callers are compiled with
 * TRUEPOSE_SINGLE; a table of the other precision is TRUEPOSE_OTHER_VERSION. */
#ifdef TRUEPOSE_SINGLE
typedef float truepose_real;
#else
typedef double truepose_real;
#endif

enum {
  TRUEPOSE_FREEDOMS = 6,  /**< at most, of a moving platform */
  TRUEPOSE_MOTORS = 8,    /**< also chains */
  TRUEPOSE_SENSORS = 12,  /**< redundant sensors */
  TRUEPOSE_READINGS = 20, /**< q_e: motors, then sensors */
  TRUEPOSE_BODIES = 8,    /**< rigid bodies of a platform */
  TRUEPOSE_AXES = 3       /**< passive axes that carry a platform */
};

/** Result of a function. Below 0: an answer with a warning. Above 0: no answer. */
typedef enum truepose_status {
  TRUEPOSE_STOPPED = -3,       /**< persistent disagreement: identification has stopped */
  TRUEPOSE_DISAGREE = -2,      /**< readings disagree; `part`: the excluded one */
  TRUEPOSE_NEAR_SINGULAR = -1, /**< damped, as requested: not the exact law's answer */
  TRUEPOSE_OK = 0,
  TRUEPOSE_UNREACHABLE = 1,    /**< no position of the mechanism closes the loops */
  TRUEPOSE_SINGULAR = 2,       /**< the answer is not determined */
  TRUEPOSE_BRANCH_LOST = 3,    /**< in another working or assembly mode than the robot's */
  TRUEPOSE_NOT_FINITE = 4,     /**< an input is NaN or infinite */
  TRUEPOSE_NOT_MEASURED = 5,   /**< sensors or knowledge that the law needs are missing */
  TRUEPOSE_NO_FULL_LEVEL = 6,  /**< its rods cannot be solved for one by one */
  TRUEPOSE_JOINT_LIMIT = 7,    /**< a motor, or a passive axis, would have to pass a stop */
  TRUEPOSE_NOT_CONVERGED = 8,  /**< the search ended: whether there is an answer is unknown */
  TRUEPOSE_NO_SUCH_PART = 9,   /**< a count, an index or an enum is out of range */
  TRUEPOSE_NOT_SQUARE = 10,    /**< fewer motors than freedoms or chains; a start-up test: more */
  TRUEPOSE_UNFINISHED = 11,    /**< model not loaded, controller or monitor not initialised */
  TRUEPOSE_NO_CHAINS = 12,     /**< a mechanism of bodies and closures; C takes chains */
  TRUEPOSE_OTHER_VERSION = 13, /**< the table's TRUEPOSE_ABI or size is another */
  TRUEPOSE_TOO_SMALL = 14,     /**< the memory given, or it is not aligned */
  TRUEPOSE_NO_SUCH_VALUE = 15  /**< an impossible number, or a matrix that is no rotation */
} truepose_status;

/** Status and cause. `part`, from 0: the chain; for TRUEPOSE_DISAGREE the reading; for
 * truepose_load() chain i as i, sensor k as 8 + k, body k as 20 + k, axis j as 28 + j; -1: none in
 * particular, for JOINT_LIMIT a passive axis. */
typedef struct truepose_outcome {
  int32_t status; /**< a truepose_status */
  int32_t part;
} truepose_outcome;

/** Description of a status in English, a constant. */
TRUEPOSE_API const char* truepose_status_text(int32_t status);
/** TRUEPOSE_ABI of the library that is linked. */
TRUEPOSE_API int32_t truepose_abi(void);

/* ------------------------------------------------------------------------------------------------
 * The robot
 */

typedef enum truepose_mobility {
  TRUEPOSE_PLANAR_TRANSLATION = 0, /**< coordinates x, y */
  TRUEPOSE_PLANAR = 1,             /**< x, y, theta */
  TRUEPOSE_TRANSLATION = 2,        /**< x, y, z */
  TRUEPOSE_SCHOENFLIES = 3,        /**< x, y, z, theta about z */
  TRUEPOSE_SPATIAL = 4,            /**< x, y, z, rotation vector */
  TRUEPOSE_ROTATIONAL_1 = 5,       /**< rotational platform on one passive axis: its angle */
  TRUEPOSE_ROTATIONAL_2 = 6,       /**< on two: their angles, the base's first */
  TRUEPOSE_ROTATIONAL_3 = 7        /**< on three */
} truepose_mobility;

typedef enum truepose_actuator {
  TRUEPOSE_REVOLUTE = 0,  /**< an arm on the base, q rad */
  TRUEPOSE_PRISMATIC = 1, /**< a carriage on a rail, q m */
  TRUEPOSE_TELESCOPIC = 2 /**< a leg of length q, m */
} truepose_actuator;

typedef enum truepose_sensor_kind {
  TRUEPOSE_PLATFORM_ANGLE = 0,
  TRUEPOSE_PLANE_DISTANCE = 1,
  TRUEPOSE_COORDINATE = 2,
  TRUEPOSE_DISTANCE = 3,
  TRUEPOSE_INCLINOMETER = 4,
  TRUEPOSE_ROTATION = 5,
  TRUEPOSE_ROD_IN_PLANE = 6,
  TRUEPOSE_ROD_LATERAL = 7,
  TRUEPOSE_ROD_LENGTH = 8,
  TRUEPOSE_MOTOR_ENCODER = 9,
  TRUEPOSE_AXIS_ANGLE = 10
} truepose_sensor_kind;

/** One chain: motor, arm, rod. Its loop: | B(q) - (D + R pivot + anchor) | = rod. */
typedef struct truepose_chain {
  int32_t actuator;             /**< a truepose_actuator */
  int32_t working_mode;         /**< -1 or 1: which root of the inverse model */
  int32_t bar;                  /**< that carries the rod (0, 1; -1: the platform itself) */
  int32_t unused;               /**< 0: the library's own */
  truepose_real base[3];        /**< on the motor's axis, m */
  truepose_real axis[3];        /**< of the motor or rail, unit */
  truepose_real zero[3];        /**< direction of the arm at q = 0, unit, normal to the axis */
  truepose_real pivot[3];       /**< turns with the platform, m */
  truepose_real anchor[3];      /**< keeps its orientation, m */
  truepose_real pair_axis[3];   /**< full level: from rod - to rod +, unit */
  truepose_real pair_drawn[3];  /**< the same, nominal: without the axis' errors */
  truepose_real arm, rod;       /**< m */
  truepose_real rod_spacing;    /**< full level: between a parallelogram's two rods, m */
  truepose_real rod_difference; /**< full level: by which the rod at + is longer, m */
  truepose_real encoder_offset; /**< reading = gain q - offset */
  truepose_real encoder_gain;
  truepose_real encoder_buildup;    /**< slides and legs: q is v + buildup v^2, 1/m */
  truepose_real gear;               /**< turns of the encoder shaft per turn of the motor */
  truepose_real eccentricity[4];    /**< of its disc: cos, sin, then of twice the angle, rad */
  truepose_real encoder_step;       /**< one count, rad or m; 0: unquantized */
  truepose_real encoder_noise;      /**< sigma, rad or m */
  truepose_real low, high;          /**< stops without the offset, rad or m; may be infinite */
  truepose_real torque_limit;       /**< N·m or N; 0: none */
  truepose_real drive_inertia;      /**< kg·m² or kg */
  truepose_real arm_mass, rod_mass; /**< kg */
  truepose_real viscous;            /**< N·m·s/rad or N·s/m */
  truepose_real coulomb;            /**< N·m or N */
} truepose_chain;

/** A redundant sensor: reading = gain s - offset. Its vectors: docs/robot-file-keys.md. */
typedef struct truepose_sensor {
  int32_t kind;       /**< a truepose_sensor_kind */
  int32_t chain;      /**< of its rod or motor (from 0; -1: none) */
  int32_t at_nacelle; /**< sensors of a rod's angle: 1 at the platform-side joint */
  int32_t rod;        /**< full level: -1 or 1, which one of the pair */
  int32_t bar;  /**< full level, theta: bar whose hinge it measures (from 0; -1: absolute theta) */
  int32_t axis; /**< axis_angle: its passive axis (from 0); others 0 */
  truepose_real gain, offset;
  truepose_real gear, eccentricity[4]; /**< of its encoder */
  truepose_real step, noise;           /**< one count (0: unquantized), sigma */
  truepose_real weight;                /**< of its row in the TEJ; the paper's is 1 */
  truepose_real origin[3], direction[3], target[3], normal[3];
} truepose_sensor;

/** A rigid body of the platform, its centre of mass at D + R pivot + anchor. */
typedef struct truepose_body {
  int32_t bar; /**< its bar (from 0; -1: the platform itself) */
  int32_t unused;
  truepose_real mass;
  truepose_real pivot[3], anchor[3];
  truepose_real inertia[9]; /**< about its centre, platform frame, kg·m² */
} truepose_body;

/** A passive axis of a rotational platform. At x = 0 all frames are parallel to the base's. */
typedef struct truepose_axis {
  truepose_real origin[3];    /**< a point on it, from that of the axis before (or base), m */
  truepose_real direction[3]; /**< unit, in the frame of the axis before */
  truepose_real low, high;    /**< stops, rad; may be infinite */
} truepose_axis;

/** A robot and its sensors, as a constant. */
typedef struct truepose_description {
  uint32_t abi;           /**< TRUEPOSE_ABI */
  uint32_t size;          /**< sizeof(truepose_description) */
  int32_t mobility;       /**< a truepose_mobility: it has n freedoms */
  int32_t chains, motors; /**< m both, n or more */
  int32_t sensors, bodies;
  int32_t bar_joint; /**< platform with bars: 0 a hinge for each (H4), 1 a four-bar */
  int32_t level;     /**< 0 ideal: one rod per chain; 1 full: every rod by itself */
  int32_t unused;    /**< 0 */
  truepose_real gravity[3];
  truepose_real home[TRUEPOSE_FREEDOMS]; /**< coordinates of a pose well inside the workspace */
  truepose_chain chain[TRUEPOSE_MOTORS];
  truepose_sensor sensor[TRUEPOSE_SENSORS];
  truepose_body body[TRUEPOSE_BODIES];
  truepose_axis axis[TRUEPOSE_AXES]; /**< rotational platforms: as many as freedoms */
} truepose_description;

/** A checked robot. Opaque; copied as bytes. */
typedef union truepose_model {
  int64_t align;
  unsigned char bytes[12288];
} truepose_model;

/** Bytes used of a model, at most sizeof(truepose_model). */
TRUEPOSE_API size_t truepose_model_size(void);

/** Checks a description and makes a model of it. Checked are version and size, every count, index,
 * enum and number, and that home is a regular pose within the stops.
 * @param model  out; after a refusal every function answers TRUEPOSE_UNFINISHED
 * @param size   of the memory behind `model`, at least truepose_model_size()
 * @return OTHER_VERSION, TOO_SMALL, NO_SUCH_PART, NOT_SQUARE, NOT_FINITE,
 * NO_SUCH_VALUE, NO_FULL_LEVEL, or for the home pose UNREACHABLE, SINGULAR, JOINT_LIMIT */
TRUEPOSE_API truepose_outcome truepose_load(truepose_model* model, size_t size,
                                            const truepose_description* description);

/** Description of a model, as loaded or identified; `level` may be changed to load it again.
 * @return UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_description_of(const truepose_model* model,
                                                      truepose_description* description);

/** Freedoms n, motors m and sensors r; 0 if the model is not loaded. */
TRUEPOSE_API int32_t truepose_freedoms(const truepose_model* model);
TRUEPOSE_API int32_t truepose_motors(const truepose_model* model);
TRUEPOSE_API int32_t truepose_sensors(const truepose_model* model);

/* ------------------------------------------------------------------------------------------------
 * Poses
 */

/** Position D of the platform's reference point, and orientation R, platform to base, by rows. */
typedef struct truepose_pose {
  truepose_real position[3];
  truepose_real rotation[9];
} truepose_pose;

/** The pose of coordinates x. @return NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_pose_of(const truepose_model* model,
                                               const truepose_real x[TRUEPOSE_FREEDOMS],
                                               truepose_pose* pose);
/** The coordinates of a pose.
 * @param x  in: selects the turn of theta, the nearest; out
 * @return NO_SUCH_VALUE where R is no rotation (1e-6), or one that this mechanism cannot make */
TRUEPOSE_API truepose_outcome truepose_coordinates_of(const truepose_model* model,
                                                      const truepose_pose* pose,
                                                      truepose_real x[TRUEPOSE_FREEDOMS]);

/** R = Rz(yaw) Ry(pitch) Rx(roll), angles = {roll, pitch, yaw}, rad. @return NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_from_roll_pitch_yaw(const truepose_real angles[3],
                                                           truepose_real rotation[9]);
/** The angles of R nearest to the given ones, whole turns included. At pitch ±90° only yaw - roll
 * (or their sum) is determined: roll keeps its value.
 * @param angles  in and out
 * @return NO_SUCH_VALUE where R is no rotation */
TRUEPOSE_API truepose_outcome truepose_to_roll_pitch_yaw(const truepose_real rotation[9],
                                                         truepose_real angles[3]);

/* ------------------------------------------------------------------------------------------------
 * Kinematics, at the model's level
 */

/** q = IKM(x) for a command to the motors.
 * @return UNREACHABLE and the chain; BRANCH_LOST where x is in another assembly mode, SINGULAR
 * between two; JOINT_LIMIT and the motor; NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_ikm(const truepose_model* model,
                                           const truepose_real x[TRUEPOSE_FREEDOMS],
                                           truepose_real q[TRUEPOSE_MOTORS]);
/** The same for a pose, with its conditioning.
 * @param conditioning  out, the least of truepose_conditioning()'s numbers; may be null
 * @return also NO_SUCH_VALUE, see truepose_coordinates_of() */
TRUEPOSE_API truepose_outcome truepose_ikm_pose(const truepose_model* model,
                                                const truepose_pose* pose,
                                                truepose_real q[TRUEPOSE_MOTORS],
                                                truepose_real* conditioning);

/** Result of a search for the pose. */
typedef struct truepose_fkm_result {
  truepose_outcome outcome;
  int32_t iterations;
  truepose_real residual; /**< largest error of a loop, m */
} truepose_fkm_result;

/** x = FKM(q), from a guess; if that finds no pose of the robot's own mode, from home.
 * @param cap  iterations at most, at least 1: 4 suffice near the guess, 7 from home over a robot's
 * workspace; 12 leave room for a second search, from home
 * @param x    in: the guess; out: the pose
 * @return UNREACHABLE: no pose closes the loops; NOT_CONVERGED: none was found; SINGULAR;
 * BRANCH_LOST; NOT_FINITE; NO_SUCH_VALUE of the cap */
TRUEPOSE_API truepose_fkm_result truepose_fkm(const truepose_model* model,
                                              const truepose_real q[TRUEPOSE_MOTORS], int32_t cap,
                                              truepose_real x[TRUEPOSE_FREEDOMS]);
/** The same for a pose. */
TRUEPOSE_API truepose_fkm_result truepose_fkm_pose(const truepose_model* model,
                                                   const truepose_real q[TRUEPOSE_MOTORS],
                                                   int32_t cap, truepose_pose* pose);

/** All readings at a pose: q_e = {IKM(x), RKM(x)}. Stops are not checked.
 * @return UNREACHABLE, SINGULAR, NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_readings(const truepose_model* model,
                                                const truepose_real x[TRUEPOSE_FREEDOMS],
                                                truepose_real q_e[TRUEPOSE_READINGS]);

/** J, n by m, dx = J dq: twists of the platform, base frame. @return UNREACHABLE, SINGULAR */
TRUEPOSE_API truepose_outcome
truepose_jacobian(const truepose_model* model, const truepose_real x[TRUEPOSE_FREEDOMS],
                  truepose_real J[TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS]);

/** W, 3 by n in rows of 6: omega = W rate is the reading of a gyroscope on the platform, rad/s in
 * the platform's frame. A moving base adds its own angular velocity in that frame. Of a rotational
 * platform the rates are its axes', and so follow from omega. @return NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_gyro(const truepose_model* model,
                                            const truepose_real x[TRUEPOSE_FREEDOMS],
                                            truepose_real W[3 * TRUEPOSE_FREEDOMS]);

/** Motor torques as joint torques of a rotational platform, the inverse of J^T: torque times rate
 * is the same on both sides. For other mobilities: force and moment on the platform, along its free
 * twist.
 * @return UNREACHABLE, SINGULAR, NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_joint_torque(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    const truepose_real torque[TRUEPOSE_MOTORS],
                                                    truepose_real joint[TRUEPOSE_FREEDOMS]);
/** The inverse: torques of the motors from those at the joints, J^T joint. */
TRUEPOSE_API truepose_outcome truepose_motor_torque(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    const truepose_real joint[TRUEPOSE_FREEDOMS],
                                                    truepose_real torque[TRUEPOSE_MOTORS]);

/** Distance of a pose from singular ones, free of size and units, at the ideal level.
 * @param parallel  out, 0 to 1: 0 where the motors do not hold the platform
 * @param serial    out, m of 0 to 1: 0 where arm and rod are in line */
TRUEPOSE_API truepose_outcome truepose_conditioning(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    truepose_real* parallel,
                                                    truepose_real serial[TRUEPOSE_MOTORS]);

/** The extended-to-joint matrix, n rows of n + r, each padded to TRUEPOSE_READINGS; ideal level.
 * @param band  conditioning below which J is damped (0: never, as in the paper) */
TRUEPOSE_API truepose_outcome truepose_tej(const truepose_model* model,
                                           const truepose_real x[TRUEPOSE_FREEDOMS],
                                           truepose_real band,
                                           truepose_real tej[TRUEPOSE_MOTORS * TRUEPOSE_READINGS]);

/* ------------------------------------------------------------------------------------------------
 * Knowledge, and the pose of all readings
 */

/** Knowledge of geometry and readings: a constant that `truepose export c` writes. Functions that
 * weigh by it return TRUEPOSE_NO_SUCH_PART if its count or a column (`part`) is not the robot's. */
typedef struct truepose_knowledge {
  int32_t count;             /**< p, uncertain parameters */
  const int32_t* column;     /**< p columns of H_xi, one per parameter */
  const truepose_real* root; /**< S, p by p, lower triangular: their covariance is S Sᵀ */
  truepose_real sigma[TRUEPOSE_READINGS]; /**< of every reading's own error, > 0 */
} truepose_knowledge;

/** Numbers of work space for functions with a knowledge; 0 if the model is not loaded. */
TRUEPOSE_API size_t truepose_work(const truepose_model* model, int32_t count);

/** Result of a pose estimate. */
typedef struct truepose_estimate_result {
  truepose_outcome outcome;
  int32_t iterations;
  truepose_real chi2; /**< of the readings' disagreement; r on average for a healthy robot */
  truepose_real covariance[TRUEPOSE_FREEDOMS * TRUEPOSE_FREEDOMS]; /**< of the free twist */
} truepose_estimate_result;

/** Pose of all readings together, weighted by the knowledge, at the model's level.
 * @param work  truepose_work(model, known->count) numbers
 * @param x     in: a guess; out: the pose */
TRUEPOSE_API truepose_estimate_result truepose_estimate(const truepose_model* model,
                                                        const truepose_knowledge* known,
                                                        const truepose_real q_e[TRUEPOSE_READINGS],
                                                        truepose_real* work,
                                                        truepose_real x[TRUEPOSE_FREEDOMS]);

/* ------------------------------------------------------------------------------------------------
 * Control
 */

typedef enum truepose_law {
  TRUEPOSE_LAW_JOINT = 0,     /**< the paper's Figure 1: motors alone */
  TRUEPOSE_LAW_TEJ = 1,       /**< Figure 2: all readings by the TEJ */
  TRUEPOSE_LAW_CARTESIAN = 2, /**< the pose of the redundant forward model: theta from its sensor
                                 where that is the only one, else least squares of all readings */
  TRUEPOSE_LAW_WEIGHTED = 3,  /**< as tej, weighted by the knowledge */
  TRUEPOSE_LAW_ESTIMATED = 4  /**< the pose of all readings, weighted by the knowledge */
} truepose_law;

/** Result of truepose_servo(). */
typedef struct truepose_servo_cycle {
  truepose_real q_d[TRUEPOSE_MOTORS];                     /**< desired motor readings */
  truepose_real error[TRUEPOSE_MOTORS];                   /**< motor error ê, rad or m */
  truepose_real J[TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS];   /**< as in truepose_jacobian() */
  truepose_real tej[TRUEPOSE_MOTORS * TRUEPOSE_READINGS]; /**< laws of all readings; else 0 */
  truepose_real x[TRUEPOSE_FREEDOMS]; /**< estimated pose, of laws with an estimate; else x_d */
} truepose_servo_cycle;

/** One servo cycle for drives with their own loops, which reduce the motor error ê of a law to 0:
 * IKM, assembly mode, J, TEJ and ê. J and TEJ are those of the ideal level, by which the laws map
 * errors.
 * @param band   as for truepose_tej()
 * @param known  null for laws that do not weigh; `work` likewise
 * @return as truepose_ikm() of x_d; NOT_MEASURED: no sensor is in use, and the law is not the joint
 * law; NEAR_SINGULAR and an answer */
TRUEPOSE_API truepose_outcome truepose_servo(const truepose_model* model, int32_t law,
                                             truepose_real band,
                                             const truepose_real x_d[TRUEPOSE_FREEDOMS],
                                             const truepose_real q_e[TRUEPOSE_READINGS],
                                             const truepose_knowledge* known, truepose_real* work,
                                             truepose_servo_cycle* cycle);

/** State of motors, or of the joints of a rotational platform: rad, rad/s, N·m. For other
 * mobilities the joints are the coordinates of the pose. */
typedef struct truepose_axis_state {
  truepose_real position[TRUEPOSE_MOTORS], velocity[TRUEPOSE_MOTORS];
  truepose_real torque[TRUEPOSE_MOTORS];
} truepose_axis_state;
/** A drive's command: torque + kp (position - measured) + kd (velocity - measured). */
typedef struct truepose_axis_command {
  truepose_axis_state state;
  truepose_real kp[TRUEPOSE_MOTORS], kd[TRUEPOSE_MOTORS];
} truepose_axis_command;

/** Joint state from motor state: FKM, J, rates and torques.
 * @param joints  in: position, the guess; out
 * @return as truepose_fkm() */
TRUEPOSE_API truepose_outcome truepose_joint_state(const truepose_model* model,
                                                   const truepose_axis_state* motors, int32_t cap,
                                                   truepose_axis_state* joints);
/** Motor command from joint command. The drives together act on the joints as the joint command
 * says: exactly in the given state, and near it by the diagonal of J^T diag(kp) J.
 * @param motors, joints  the state, as from truepose_joint_state()
 * @return as truepose_ikm() of the commanded position */
TRUEPOSE_API truepose_outcome truepose_motor_command(const truepose_model* model,
                                                     const truepose_axis_state* motors,
                                                     const truepose_axis_state* joints,
                                                     const truepose_axis_command* joint_command,
                                                     truepose_axis_command* motor_command);

/** Constant while a controller runs. Start from truepose_control_defaults(). */
typedef struct truepose_control_settings {
  uint32_t size;        /**< sizeof(truepose_control_settings); smaller: the rest has defaults */
  int32_t law;          /**< a truepose_law */
  int32_t gains;        /**< 0: torques per motor; 1: accelerations, shaped by the joint inertia */
  int32_t feed_forward; /**< 0 none, 1 gravity, 2 full dynamics */
  int32_t sigma_scale;  /**< factor on the readings' own sigma in laws that weigh; 0 is 1 */
  int32_t unused;       /**< 0 */
  truepose_real period; /**< s */
  truepose_real velocity_bandwidth; /**< of the velocity tracking loops, rad/s */
  truepose_real damped_below;       /**< conditioning below which J is damped (0: never) */
  truepose_real lead_out;           /**< s over which a change of law takes effect */
  truepose_real kp[TRUEPOSE_MOTORS], kd[TRUEPOSE_MOTORS], ki[TRUEPOSE_MOTORS];
} truepose_control_settings;

/** 1 kHz, joint law, full feed-forward, gains 0. */
TRUEPOSE_API void truepose_control_defaults(truepose_control_settings* settings);
/** PD gains for this natural frequency (rad/s) and damping ratio of every motor at x. */
TRUEPOSE_API truepose_outcome truepose_place_poles(const truepose_model* model,
                                                   const truepose_real x[TRUEPOSE_FREEDOMS],
                                                   truepose_real frequency, truepose_real damping,
                                                   truepose_control_settings* settings);

/** Setpoint of the platform: coordinates, free twist (m/s, rad/s), its derivative. */
typedef struct truepose_setpoint {
  truepose_real x[TRUEPOSE_FREEDOMS], rate[TRUEPOSE_FREEDOMS], acceleration[TRUEPOSE_FREEDOMS];
} truepose_setpoint;

/** Settings and state of a controller. Opaque. */
typedef union truepose_controller {
  int64_t align;
  unsigned char bytes[8192];
} truepose_controller;
TRUEPOSE_API size_t truepose_controller_size(void);

/** Starts or restarts a controller. @return OTHER_VERSION (size), NO_SUCH_PART of law, gains or
 * feed-forward, NO_SUCH_VALUE (a period or bandwidth that is not positive), NOT_FINITE, TOO_SMALL
 */
TRUEPOSE_API truepose_outcome truepose_controller_init(truepose_controller* controller, size_t size,
                                                       const truepose_control_settings* settings);
/** Changes the law from the next cycle on, without a step of the torque. @return NO_SUCH_PART */
TRUEPOSE_API truepose_outcome truepose_change_law(truepose_controller* controller, int32_t law);

/** One servo cycle with the law, damping and slow sensors of a controller's settings. Laws that
 * weigh cache their weights as in truepose_control(). */
TRUEPOSE_API truepose_outcome truepose_controller_servo(
    const truepose_model* model, truepose_controller* controller,
    const truepose_real x_d[TRUEPOSE_FREEDOMS], const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, truepose_servo_cycle* cycle);

/** One cycle.
 * @param known   null for laws that do not weigh; its work space likewise
 * @param torque  out, N·m or N, within the motors' limits; without an answer the last one */
TRUEPOSE_API truepose_outcome truepose_control(const truepose_model* model,
                                               truepose_controller* controller,
                                               const truepose_setpoint* setpoint,
                                               const truepose_real q_e[TRUEPOSE_READINGS],
                                               const truepose_knowledge* known, truepose_real* work,
                                               truepose_real torque[TRUEPOSE_MOTORS]);

/* ------------------------------------------------------------------------------------------------
 * Delayed and multirate sensors. Guide: docs/delayed-sensors.md
 */

/** Constant during a run. Sets of sensors are bits, the first one's 1. */
typedef struct truepose_multirate_settings {
  uint32_t size;                   /**< sizeof(truepose_multirate_settings) */
  uint32_t stamped;                /**< sensors whose samples have timestamps */
  int32_t every[TRUEPOSE_SENSORS]; /**< sample period, control periods; 0 as 1 */
  int32_t age[TRUEPOSE_SENSORS];   /**< usual latency on arrival, control periods, 0 to 255 */
  truepose_real period;            /**< of control, s */
  /** Change of a reading's geometry error along each freedom, sigma; docs/delayed-sensors.md */
  truepose_real sensitivity[TRUEPOSE_SENSORS][TRUEPOSE_FREEDOMS];
} truepose_multirate_settings;

/** Settings and state of these sensors. Opaque. */
typedef union truepose_multirate {
  int64_t align;
  unsigned char bytes[43008];
} truepose_multirate;
TRUEPOSE_API size_t truepose_multirate_size(void);

/** Starts or restarts these sensors. The first cycle takes all their readings as samples: NaN where
 * there is none yet. @return OTHER_VERSION, TOO_SMALL, NO_SUCH_PART: a number is out of range,
 * `part`: the sensor */
TRUEPOSE_API truepose_outcome truepose_multirate_init(truepose_multirate* sensors, size_t size,
                                                      const truepose_multirate_settings* settings);
/** From the next cycle on a controller has these sensors, whatever function runs it.
 * @param sensors  stays in place while the controller is used; null: none is slow or delayed */
TRUEPOSE_API truepose_outcome truepose_controller_sensors(truepose_controller* controller,
                                                          truepose_multirate* sensors);
/** Before a cycle: samples that have arrived; their values are in the cycle's q_e.
 * @param arrived  sensors with a new sample
 * @param time     of the stamped sensors' samples, ns; null: none has arrived
 * @param now      of the cycle's motor readings, by the same clock; both may wrap
 * @param stale    out, may be null: sensors whose sample counts as not arrived. It is repeated,
 * older than the one before or than 255 periods, or from the future */
TRUEPOSE_API truepose_outcome truepose_multirate_arrive(truepose_multirate* sensors,
                                                        uint32_t arrived,
                                                        const uint64_t time[TRUEPOSE_SENSORS],
                                                        uint64_t now, uint32_t* stale);

/* ------------------------------------------------------------------------------------------------
 * Fault monitor: detection, isolation and substitution of faulty readings
 */

/** Constant while a monitor runs: `truepose export c` writes it for a robot and its gains. */
typedef struct truepose_fault_monitor_settings {
  uint32_t size;             /**< sizeof(truepose_fault_monitor_settings); see the controller's */
  int32_t refresh;           /**< cycles at most between updates of the geometry's covariance */
  int32_t coast;             /**< cycles of extrapolation before a reading has failed */
  int32_t decide;            /**< cycles of undecided disagreement before the robot stops */
  int32_t spikes, within;    /**< so many extrapolated faults (1 to 8) in so many cycles: failed */
  truepose_real period;      /**< s */
  truepose_real false_alarm; /**< probability per cycle, 0 to 0.1 */
  truepose_real replaceable; /**< largest sigma of a motor's virtual reading, rad or m */
  truepose_real correlation; /**< travel, m or rad, that changes a geometry's error by its size */
  truepose_real stop;        /**< duration of a stop along the path, s */
  truepose_real stop_lost;   /**< the same with a lost motor: twice the closing time of a brake */
  truepose_real held;        /**< longest time for which the last valid torque is held, s */
  truepose_real fastest[TRUEPOSE_READINGS]; /**< largest second derivatives (0: not tested) */
  truepose_real moved[TRUEPOSE_READINGS];   /**< motion beside unchanged counts (0: not tested) */
  truepose_real kp[TRUEPOSE_MOTORS], kd[TRUEPOSE_MOTORS]; /**< 1/s², 1/s: the motors' loops */
  truepose_real rests[TRUEPOSE_MOTORS];  /**< error at which a healthy motor may rest */
  truepose_real shaken[TRUEPOSE_MOTORS]; /**< virtual readings' noise sigma per cycle (0: any) */
  truepose_real low[TRUEPOSE_READINGS], high[TRUEPOSE_READINGS]; /**< range (equal: any) */
} truepose_fault_monitor_settings;

typedef enum truepose_health {
  TRUEPOSE_VALID = 0,
  TRUEPOSE_SUSPECT = 1,
  TRUEPOSE_FAILED = 2 /**< until truepose_fault_monitor_acknowledge() */
} truepose_health;

typedef enum truepose_symptom {
  TRUEPOSE_NO_SYMPTOM = 0,
  TRUEPOSE_MISSING = 1,
  TRUEPOSE_OUT_OF_RANGE = 2,
  TRUEPOSE_TOO_FAST = 3,
  TRUEPOSE_STUCK = 4,
  TRUEPOSE_DISAGREES = 5
} truepose_symptom;

/** Report of a monitor. Sets of readings or motors are bits, the first one's 1. */
typedef struct truepose_fault_report {
  int32_t health[TRUEPOSE_READINGS];  /**< truepose_health */
  int32_t symptom[TRUEPOSE_READINGS]; /**< truepose_symptom, the latest */
  uint32_t doubted;   /**< candidates: one of these readings is faulty, which one is undecided */
  uint32_t lost;      /**< motors whose reading has failed without a substitute */
  uint32_t brakes;    /**< motors whose brakes must hold; until acknowledged */
  int32_t stops;      /**< 1: the caller must stop along the path and stay, */
  truepose_real stop; /**< in this time, s, for truepose_advance(); 0: continue */
  int32_t stop_cause; /**< 3, 4, 5: clock backwards, dropped, stale frame; 14: overspeed; 0: no */
  int32_t unused;
} truepose_fault_report;

/** Settings and state of a monitor. Opaque. */
typedef union truepose_fault_monitor {
  int64_t align;
  unsigned char bytes[16384];
} truepose_fault_monitor;
TRUEPOSE_API size_t truepose_fault_monitor_size(void);

/** Starts or restarts a monitor. @return OTHER_VERSION, NO_SUCH_VALUE, NOT_FINITE, TOO_SMALL */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_init(
    truepose_fault_monitor* monitor, size_t size, const truepose_fault_monitor_settings* settings);

/** truepose_control() with the readings monitored: faulty ones are substituted. A motor whose brake
 * is requested gets its feed-forward alone; once all brakes are requested, all torques are those of
 * gravity at rest. Both last until truepose_fault_monitor_acknowledge().
 * @param finest  model for the monitor; null: `model`
 * @param known   of that model; the controller's law weighs by it too
 * @param work    truepose_work(finest, known->count) numbers
 * @return DISAGREE and a reading: it is not valid, and the robot continues without it */
TRUEPOSE_API truepose_outcome truepose_control_fault_tolerant(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, const truepose_setpoint* setpoint,
    const truepose_real q_e[TRUEPOSE_READINGS], const truepose_knowledge* known,
    truepose_real* work, truepose_real torque[TRUEPOSE_MOTORS], truepose_fault_report* report);

/** The monitor alone, for drives that close their own loops.
 * @param desired   motor setpoints, n
 * @param believed  out: the readings, or substitutes for the excluded ones */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_step(
    const truepose_model* finest, truepose_fault_monitor* monitor,
    const truepose_real desired[TRUEPOSE_MOTORS], const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, truepose_real believed[TRUEPOSE_READINGS],
    truepose_fault_report* report);

/** Marks a repaired reading as valid; the robot may move again.
 * @return NO_SUCH_PART (`part`: the reading), UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_acknowledge(truepose_fault_monitor* monitor,
                                                                 int32_t reading);

/** For drives that close their own loops, before each step: by how much they have led each motor
 * off its setpoint, up to a constant; the sum of their commanded motion less the setpoint's. 0 at
 * first. Without it a motor that a law turns back against its setpoint may seem stuck. */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_led(truepose_fault_monitor* monitor,
                                                         const truepose_real led[TRUEPOSE_MOTORS]);

/** Time along a path. Start with {0, 1, 0, 0}. */
typedef struct truepose_path_clock {
  truepose_real time; /**< s along the path */
  truepose_real rate; /**< 1: real time */
  truepose_real slowing, since;
} truepose_path_clock;
/** Advances one period. @param stop  truepose_fault_report's duration, s; 0: continue */
TRUEPOSE_API void truepose_advance(truepose_path_clock* clock, truepose_real period,
                                   truepose_real stop);
/** Converts the path's setpoint at clock->time to the robot's, by the clock's rate. */
TRUEPOSE_API void truepose_pace(const truepose_path_clock* clock, truepose_setpoint* setpoint);

/* ------------------------------------------------------------------------------------------------
 * Limits of a control cycle, for the safety shell and the start-up test of the package safety,
 * whose header is truepose_safety.h. Guide: packages/safety/docs/commissioning.md
 */

/** Constant during a run: truepose_safety_defaults(), then adapted. */
typedef struct truepose_safety_limits {
  uint32_t size;            /**< sizeof(truepose_safety_limits); see the controller's */
  int32_t window;           /**< cycles over which a motor's speed is measured, 1 to 8 */
  int32_t age;              /**< periods by which a frame may be older than the freshest one */
  int32_t counter_bits;     /**< of the frame counter, 2 to 64: it wraps */
  truepose_real period;     /**< s */
  truepose_real saturation; /**< longest time at the torque limit, s */
  truepose_real clipped;    /**< longest time at the slew limit, s */
  truepose_real missing;    /**< longest time without a motor's reading, s */
  truepose_real held;       /**< longest time without an answer of the law, s */
  truepose_real stop;       /**< duration of a stop along the path, s */
  truepose_real brake;      /**< closing and opening time of a brake, s */
  truepose_real standstill; /**< longest time from closed brakes to rest, s */
  truepose_real torque[TRUEPOSE_MOTORS];    /**< largest, N·m or N */
  truepose_real slew[TRUEPOSE_MOTORS];      /**< largest change of the torque, per s */
  truepose_real tracking[TRUEPOSE_MOTORS];  /**< largest motor error of the law, rad or m */
  truepose_real deviation[TRUEPOSE_MOTORS]; /**< largest distance from the setpoint */
  truepose_real speed[TRUEPOSE_MOTORS];     /**< largest, rad/s or m/s */
  truepose_real count[TRUEPOSE_MOTORS];     /**< largest error of a difference of readings */
  truepose_real still[TRUEPOSE_MOTORS];     /**< motion that a frozen frame does not show */
  truepose_real kp[TRUEPOSE_MOTORS], kd[TRUEPOSE_MOTORS];    /**< 1/s², 1/s: the motors' loops */
  truepose_real rests[TRUEPOSE_MOTORS];                      /**< error at which a motor may rest */
  truepose_real low[TRUEPOSE_MOTORS], high[TRUEPOSE_MOTORS]; /**< range (equal: any) */
  truepose_real box_low[TRUEPOSE_FREEDOMS], box_high[TRUEPOSE_FREEDOMS]; /**< of x, likewise */
} truepose_safety_limits;

/** Limits of a robot under a controller. @return NO_SUCH_VALUE: a motor without torque limit or
 * gain, `part` */
TRUEPOSE_API truepose_outcome truepose_safety_defaults(const truepose_model* model,
                                                       const truepose_control_settings* settings,
                                                       truepose_safety_limits* limits);
/** Limits for truepose_control_fault_tolerant() without a safety shell, of frames, speeds and
 * stuck motors: after a violation no motor can be trusted, and all brakes are requested. They stay
 * until truepose_fault_monitor_init(), also after a call that is refused.
 * @return OTHER_VERSION, NOT_FINITE, NO_SUCH_VALUE (the period) */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_limit(truepose_fault_monitor* monitor,
                                                           const truepose_safety_limits* limits);
/** Before each cycle: the counter of the readings' frame. Without one, frozen readings are found by
 * what the motors should have moved. */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_frame(truepose_fault_monitor* monitor,
                                                           uint64_t counter);
/** Distance, m, from the last fresh frame before a common fault of all readings to standstill, at
 * home and at a speed, m/s. @param marked  1: frames have a counter or a timestamp */
TRUEPOSE_API truepose_outcome truepose_stopping_distance(const truepose_model* model,
                                                         const truepose_safety_limits* limits,
                                                         int32_t marked, truepose_real speed,
                                                         truepose_real* distance);

/* ------------------------------------------------------------------------------------------------
 * Online calibration
 */

/** State of a calibrator. Opaque; holds pointers to the model it started from and to its memory,
 * and with `follow` to itself: then do not move or copy it. */
typedef union truepose_online_calibrator {
  int64_t align;
  unsigned char bytes[20480];
} truepose_online_calibrator;
TRUEPOSE_API size_t truepose_online_calibrator_size(void);

/** Numbers of memory for a calibrator of `count` parameters; 0 if the model is not loaded. */
TRUEPOSE_API size_t truepose_online_calibrator_memory(const truepose_model* drawn, int32_t count);

/** Starts a calibrator from the model's own values and their knowledge.
 * @param drawn   nominal model, which must stay in place while the calibrator is used
 * @param prior   at least one parameter, with at least one sensor; `column` must stay in place, too
 * @param memory  truepose_online_calibrator_memory(drawn, prior->count) numbers, the calibrator's
 * @return TOO_SMALL, UNFINISHED, NO_SUCH_PART (a column), NOT_MEASURED (no sensor) */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_init(
    truepose_online_calibrator* calibrator, size_t size, const truepose_model* drawn,
    const truepose_knowledge* prior, truepose_real* memory, size_t count);

/** Adds one row of readings; a row without new information costs next to nothing.
 * @return DISAGREE: the row, or the reading named, was not used; STOPPED: no row is used any more;
 * with `follow`, until the rows agree again or a change explains them */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_step(
    truepose_online_calibrator* calibrator, const truepose_real q_e[TRUEPOSE_READINGS]);
/** Numbers of rows used, and of rows excluded or with an excluded reading. @return UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_samples(
    const truepose_online_calibrator* calibrator, int64_t* learnt, int64_t* left_out);
/** Rolls back to before the latest rows: one of their readings was found faulty. */
TRUEPOSE_API truepose_outcome
truepose_online_calibrator_roll_back(truepose_online_calibrator* calibrator);

/** Changes of a machine at work, from a prior: a constant that `truepose export c` writes. */
typedef struct truepose_changes {
  int32_t steps;                             /**< number of steps of the geometry */
  int32_t count;                             /**< of changes: the steps that happen together */
  int32_t drifts;                            /**< of random walks */
  int32_t load;                              /**< step that is a payload, or -1 */
  const truepose_real* step;                 /**< steps by p: 1 σ of each */
  const int32_t* end;                        /**< index after the last step of each change */
  const truepose_real* log_odds;             /**< of each change in 100 rows */
  const truepose_real* drift;                /**< drifts by p: 1 σ of each in a row */
  truepose_real force[TRUEPOSE_FREEDOMS];    /**< of the payload, 1 σ */
  truepose_real compliance[TRUEPOSE_MOTORS]; /**< of the motors' readings under their torque */
} truepose_changes;

enum { TRUEPOSE_RECOGNISED = 8 /**< recognised changes that are kept */ };
typedef enum truepose_change_kind {
  TRUEPOSE_CHANGED_PART, /**< `which` change: the geometry follows */
  TRUEPOSE_FAULT,        /**< of the reading `which`: its rows are not used */
  TRUEPOSE_NOISE,        /**< of the reading `which`: it counts less, or more */
  TRUEPOSE_UNEXPLAINED   /**< rows that nothing explains are not used; `which` is -1 */
} truepose_change_kind;
/** A change that was recognised. */
typedef struct truepose_recognised {
  int64_t row; /**< rows before it was recognised */
  int32_t kind, which;
  truepose_real log_odds; /**< over no change */
} truepose_recognised;

/** Numbers of memory to follow changes; 0 if the calibrator has not been started, or for
 * NO_SUCH_VALUE. */
TRUEPOSE_API size_t truepose_online_calibrator_follow_memory(
    const truepose_online_calibrator* calibrator, const truepose_changes* changes);
/** Recognises changes from now on, and follows them. Then the model approaches what is identified:
 * no setpoint changes by more than a tenth of a count a cycle. One step processes at most three
 * rows. From then on the calibrator points into itself: do not move or copy it.
 * @param changes  of the calibrator's prior; it and the arrays must stay in place
 * @return TOO_SMALL, UNFINISHED, NO_SUCH_VALUE (`end` must increase up to `steps`; `load` must be a
 * step or -1) */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_follow(
    truepose_online_calibrator* calibrator, const truepose_changes* changes, truepose_real* memory,
    size_t count);
/** Number recognised so far. `latest` is a ring: change k is `latest[k % 8]`.
 * @return UNFINISHED */
TRUEPOSE_API truepose_outcome
truepose_online_calibrator_changes(const truepose_online_calibrator* calibrator, int64_t* count,
                                   truepose_recognised latest[TRUEPOSE_RECOGNISED]);

/** The robot as identified so far. @param model  out */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_model(
    const truepose_online_calibrator* calibrator, truepose_model* model, size_t size);
/** Its uncertainty. @param known  out; points into the calibrator's memory */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_knowledge(
    const truepose_online_calibrator* calibrator, truepose_knowledge* known);

#ifdef __cplusplus
}
#endif

#endif
