/**
 * @file
 * truepose for machine controllers, in C99. docs/c.md is its guide.
 *
 * A robot is a constant table, truepose_description, that may lie in flash (`truepose export c`
 * writes it). truepose_load() checks it and makes of it a truepose_model in memory of yours;
 * everything else is asked of the model.
 *
 * No function allocates, locks, throws or blocks; each ends after a bounded number of steps, and
 * needs nothing but libm. Models are constant once loaded: any number of threads may share one.
 * Controllers, guards, learners and work space belong to one thread each. Pointers must point to
 * what they are said to; where one may be null, it says so.
 *
 * Units are m, rad, kg, s, N and N·m. Frames are the base's unless said otherwise. Matrices are
 * stored by rows. Arrays have the lengths below whatever the robot is: of n motors and r sensors
 * the first n, r, or n + r entries are used, and what is written beyond them is 0.
 *
 * Every function answers with a truepose_outcome. Up to TRUEPOSE_OK there is an answer; above there
 * is none, and what would have been written is as it was.
 */
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

/** Of the tables and functions below. A library loads only tables of its own version. */
#define TRUEPOSE_ABI 3

/** Of every number. Libraries in single precision are built with TRUEPOSE_SINGLE, and so is what
 * calls them; a table of the other precision is TRUEPOSE_OTHER_VERSION. */
#ifdef TRUEPOSE_SINGLE
typedef float truepose_real;
#else
typedef double truepose_real;
#endif

enum {
  TRUEPOSE_FREEDOMS = 6,  /**< at most, of a nacelle, and so motors and chains */
  TRUEPOSE_SENSORS = 12,  /**< redundant ones */
  TRUEPOSE_READINGS = 16, /**< q_e: motors first, then sensors */
  TRUEPOSE_BODIES = 8,    /**< rigid ones of a nacelle */
  TRUEPOSE_AXES = 3       /**< passive ones that carry a pivot's nacelle */
};

/** How it went. Below 0: an answer with a warning. Above 0: no answer. */
typedef enum truepose_status {
  TRUEPOSE_STOPPED = -3,       /**< readings kept disagreeing: nothing is learnt any more */
  TRUEPOSE_DISAGREE = -2,      /**< readings disagree; `part`: the one that is not believed */
  TRUEPOSE_NEAR_SINGULAR = -1, /**< damped, as asked for: not the exact law's answer */
  TRUEPOSE_OK = 0,
  TRUEPOSE_UNREACHABLE = 1,    /**< no position of the mechanism closes the loops */
  TRUEPOSE_SINGULAR = 2,       /**< the answer is not determined */
  TRUEPOSE_BRANCH_LOST = 3,    /**< in another working or assembly mode than the robot's */
  TRUEPOSE_NOT_FINITE = 4,     /**< an input is NaN or infinite */
  TRUEPOSE_NOT_MEASURED = 5,   /**< the sensors, or what is known, are not what the law needs */
  TRUEPOSE_NO_FULL_LEVEL = 6,  /**< its rods cannot be solved for one by one */
  TRUEPOSE_JOINT_LIMIT = 7,    /**< a motor, or a passive axis, would have to pass a stop */
  TRUEPOSE_NOT_CONVERGED = 8,  /**< the search ended: whether there is an answer is not known */
  TRUEPOSE_NO_SUCH_PART = 9,   /**< a count, an index or an enum names what is not there */
  TRUEPOSE_NOT_SQUARE = 10,    /**< more or fewer chains or motors than freedoms */
  TRUEPOSE_UNFINISHED = 11,    /**< the model was not loaded, a controller or monitor not begun */
  TRUEPOSE_NOT_COMPILED = 12,  /**< this mobility, or the full level: left out of the library */
  TRUEPOSE_OTHER_VERSION = 13, /**< of the table: not TRUEPOSE_ABI, or not its size */
  TRUEPOSE_TOO_SMALL = 14,     /**< the memory given, or it is not aligned */
  TRUEPOSE_NO_SUCH_VALUE = 15  /**< a number no such quantity can have, a matrix that is no turn */
} truepose_status;

/** `part`: the chain, for TRUEPOSE_DISAGREE the reading; of truepose_load() chain i as i, sensor k
 * as 6 + k, body k as 18 + k, axis j as 26 + j. -1: none in particular, of JOINT_LIMIT a passive
 * axis. All from 0. */
typedef struct truepose_outcome {
  int32_t status; /**< a truepose_status */
  int32_t part;
} truepose_outcome;

/** In English, a constant. */
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
  TRUEPOSE_PIVOT_1 = 5,            /**< the angle of the passive axis that carries the nacelle */
  TRUEPOSE_PIVOT_2 = 6,            /**< of two, the base's first */
  TRUEPOSE_PIVOT_3 = 7             /**< of three */
} truepose_mobility;

typedef enum truepose_actuator {
  TRUEPOSE_REVOLUTE = 0,  /**< an arm of a base, q rad */
  TRUEPOSE_PRISMATIC = 1, /**< a carriage on a rail, q m */
  TRUEPOSE_TELESCOPIC = 2 /**< a leg whose length is q, m */
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

/** One chain: motor, arm, rod. The loop it closes: | B(q) - (D + R pivot + anchor) | = rod. */
typedef struct truepose_chain {
  int32_t actuator;      /**< a truepose_actuator */
  int32_t working_mode;  /**< -1 or 1: which root of the inverse model */
  int32_t bar;           /**< of the nacelle, that carries the rod (0, 1; -1: the nacelle itself) */
  int32_t unused;        /**< 0 */
  truepose_real base[3]; /**< on the motor's axis, m */
  truepose_real axis[3]; /**< of the motor or rail, unit */
  truepose_real zero[3]; /**< direction of the arm at q = 0, unit, normal to the axis */
  truepose_real pivot[3];       /**< turns with the nacelle, m */
  truepose_real anchor[3];      /**< keeps its orientation, m */
  truepose_real pair_axis[3];   /**< full level: from rod - to rod +, unit */
  truepose_real pair_drawn[3];  /**< the same without the axis' errors */
  truepose_real arm, rod;       /**< m */
  truepose_real rod_spacing;    /**< full level: between a parallelogram's two rods, m */
  truepose_real rod_difference; /**< full level: by which the one at + is longer, m */
  truepose_real encoder_offset; /**< reading = gain q - offset */
  truepose_real encoder_gain;
  truepose_real encoder_buildup;    /**< slides and legs: q is v + buildup v^2, 1/m */
  truepose_real gear;               /**< turns of the encoder's shaft per turn of the motor */
  truepose_real eccentricity[4];    /**< of its disc: cos, sin, and of twice the angle, rad */
  truepose_real encoder_step;       /**< one count, rad or m; 0: unquantized */
  truepose_real encoder_noise;      /**< sigma, rad or m */
  truepose_real low, high;          /**< stops, rad or m, without the offset; may be infinite */
  truepose_real torque_limit;       /**< N·m or N; 0: none */
  truepose_real drive_inertia;      /**< kg·m² or kg */
  truepose_real arm_mass, rod_mass; /**< kg */
  truepose_real viscous;            /**< N·m·s/rad or N·s/m */
  truepose_real coulomb;            /**< N·m or N */
} truepose_chain;

/** A redundant sensor: reading = gain s - offset. What its vectors mean: docs/robot-file.md. */
typedef struct truepose_sensor {
  int32_t kind;       /**< a truepose_sensor_kind */
  int32_t chain;      /**< whose rod or motor (from 0; -1: none) */
  int32_t at_nacelle; /**< rods' directions: 1 at the nacelle's joint */
  int32_t rod;        /**< full level: -1 or 1, which of the pair */
  int32_t bar;        /**< full level, theta: a bar's pivot (from 0; -1: the absolute theta) */
  int32_t axis;       /**< axis_angle: which passive axis (from 0); others 0 */
  truepose_real gain, offset;
  truepose_real gear, eccentricity[4]; /**< of its encoder */
  truepose_real step, noise;           /**< one count (0: unquantized), sigma */
  truepose_real weight;                /**< of its row in the TEJ; the paper's is 1 */
  truepose_real origin[3], direction[3], target[3], normal[3];
} truepose_sensor;

/** A rigid body of the nacelle, its centre of mass at D + R pivot + anchor. */
typedef struct truepose_body {
  int32_t bar; /**< that it is (from 0; -1: the nacelle itself) */
  int32_t unused;
  truepose_real mass;
  truepose_real pivot[3], anchor[3];
  truepose_real inertia[9]; /**< about its centre, nacelle's frame, kg·m² */
} truepose_body;

/** A passive axis of a pivot. At x = 0 all frames are parallel to the base's. */
typedef struct truepose_axis {
  truepose_real origin[3];    /**< a point of it, seen from that of the axis before (or base), m */
  truepose_real direction[3]; /**< unit, in the frame of the axis before */
  truepose_real low, high;    /**< stops, rad; may be infinite */
} truepose_axis;

/** A robot and its sensors, as a constant. */
typedef struct truepose_description {
  uint32_t abi;           /**< TRUEPOSE_ABI */
  uint32_t size;          /**< sizeof(truepose_description) */
  int32_t mobility;       /**< a truepose_mobility: it has n freedoms */
  int32_t chains, motors; /**< n both */
  int32_t sensors, bodies;
  int32_t bar_joint; /**< of a nacelle with bars: 0 each on a pivot of its own (H4), 1 a four-bar */
  int32_t level;     /**< 0 ideal: one rod a chain; 1 full: each rod of a pair by itself */
  int32_t unused;    /**< 0 */
  truepose_real gravity[3];
  truepose_real home[TRUEPOSE_FREEDOMS]; /**< coordinates of a pose well inside the workspace */
  truepose_chain chain[TRUEPOSE_FREEDOMS];
  truepose_sensor sensor[TRUEPOSE_SENSORS];
  truepose_body body[TRUEPOSE_BODIES];
  truepose_axis axis[TRUEPOSE_AXES]; /**< of a pivot: as many as freedoms */
} truepose_description;

/** A robot that was checked. Opaque; copied as bytes. */
typedef union truepose_model {
  int64_t align;
  unsigned char bytes[12288];
} truepose_model;

/** Bytes of a model that are used, at most sizeof(truepose_model). */
TRUEPOSE_API size_t truepose_model_size(void);

/** Checks a description and makes a model of it: version and size, every count, index, enum and
 * number, and that home is a regular pose within the stops.
 *
 * @param model  out; unless all is well it answers TRUEPOSE_UNFINISHED to everything
 * @param size   of the memory behind `model`, at least truepose_model_size()
 * @return OTHER_VERSION, TOO_SMALL, NO_SUCH_PART, NOT_SQUARE, NOT_COMPILED, NOT_FINITE,
 * NO_SUCH_VALUE, NO_FULL_LEVEL, or what home is: UNREACHABLE, SINGULAR, JOINT_LIMIT
 */
TRUEPOSE_API truepose_outcome truepose_load(truepose_model* model, size_t size,
                                            const truepose_description* description);

/** What a model was made of, or what was learnt: with another `level`, loaded again, it is the same
 * robot understood so. @return UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_description_of(const truepose_model* model,
                                                      truepose_description* description);

/** Freedoms n and sensors r; 0 of a model that was not loaded. */
TRUEPOSE_API int32_t truepose_freedoms(const truepose_model* model);
TRUEPOSE_API int32_t truepose_sensors(const truepose_model* model);

/* ------------------------------------------------------------------------------------------------
 * Poses
 */

/** Position D of the nacelle's reference point, and orientation R, nacelle to base, by rows. */
typedef struct truepose_pose {
  truepose_real position[3];
  truepose_real rotation[9];
} truepose_pose;

/** The pose of coordinates x. @return NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_pose_of(const truepose_model* model,
                                               const truepose_real x[TRUEPOSE_FREEDOMS],
                                               truepose_pose* pose);
/** The coordinates of a pose.
 *
 * @param x  in: near which turn theta is meant; out
 * @return NO_SUCH_VALUE where R is no rotation (1e-6), or turns as this mechanism cannot
 */
TRUEPOSE_API truepose_outcome truepose_coordinates_of(const truepose_model* model,
                                                      const truepose_pose* pose,
                                                      truepose_real x[TRUEPOSE_FREEDOMS]);

/** R = Rz(yaw) Ry(pitch) Rx(roll), angles = {roll, pitch, yaw}, rad. @return NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_from_roll_pitch_yaw(const truepose_real angles[3],
                                                           truepose_real rotation[9]);
/** The angles of R next to the given ones, turns and all. Where pitch is ±90° only yaw - roll (or
 * their sum) is determined: roll then stays what it was.
 *
 * @param angles  in and out
 * @return NO_SUCH_VALUE where R is no rotation
 */
TRUEPOSE_API truepose_outcome truepose_to_roll_pitch_yaw(const truepose_real rotation[9],
                                                         truepose_real angles[3]);

/* ------------------------------------------------------------------------------------------------
 * Kinematics, at the model's level
 */

/** q = IKM(x), for motors that will go there.
 *
 * @return UNREACHABLE and the chain; BRANCH_LOST where x is in another assembly mode, SINGULAR
 * between two; JOINT_LIMIT and the motor; NOT_FINITE
 */
TRUEPOSE_API truepose_outcome truepose_ikm(const truepose_model* model,
                                           const truepose_real x[TRUEPOSE_FREEDOMS],
                                           truepose_real q[TRUEPOSE_FREEDOMS]);
/** The same of a pose, in one call with its conditioning.
 *
 * @param conditioning  out, the least of truepose_conditioning()'s numbers; may be null
 * @return as well NO_SUCH_VALUE, see truepose_coordinates_of()
 */
TRUEPOSE_API truepose_outcome truepose_ikm_pose(const truepose_model* model,
                                                const truepose_pose* pose,
                                                truepose_real q[TRUEPOSE_FREEDOMS],
                                                truepose_real* conditioning);

/** How a search for the pose ended. */
typedef struct truepose_fkm_result {
  truepose_outcome outcome;
  int32_t iterations;
  int32_t unused;
  truepose_real residual; /**< largest error of a loop, m */
} truepose_fkm_result;

/** x = FKM(q), from a guess; where that finds no pose of the robot's own mode, from home.
 *
 * @param cap  steps at most, at least 1: 4 do near the guess, 7 from home over a robot's
 *             workspace; 12 leave room for a second search, from home
 * @param x    in: the guess; out: the pose
 * @return UNREACHABLE: no pose closes the loops; NOT_CONVERGED: none was found; SINGULAR;
 * BRANCH_LOST; NOT_FINITE; NO_SUCH_VALUE of the cap
 */
TRUEPOSE_API truepose_fkm_result truepose_fkm(const truepose_model* model,
                                              const truepose_real q[TRUEPOSE_FREEDOMS], int32_t cap,
                                              truepose_real x[TRUEPOSE_FREEDOMS]);
/** The same of a pose. */
TRUEPOSE_API truepose_fkm_result truepose_fkm_pose(const truepose_model* model,
                                                   const truepose_real q[TRUEPOSE_FREEDOMS],
                                                   int32_t cap, truepose_pose* pose);

/** All readings at a pose: q_e = {IKM(x), RKM(x)}. No stops are asked for.
 * @return UNREACHABLE, SINGULAR, NOT_FINITE */
TRUEPOSE_API truepose_outcome truepose_readings(const truepose_model* model,
                                                const truepose_real x[TRUEPOSE_FREEDOMS],
                                                truepose_real q_e[TRUEPOSE_READINGS]);

/** J, n by n, dx = J dq: twists of the nacelle, base frame. @return UNREACHABLE, SINGULAR */
TRUEPOSE_API truepose_outcome
truepose_jacobian(const truepose_model* model, const truepose_real x[TRUEPOSE_FREEDOMS],
                  truepose_real J[TRUEPOSE_FREEDOMS * TRUEPOSE_FREEDOMS]);

/** W, 3 by n in rows of 6: what a gyroscope on the nacelle reads of its rates, omega = W rate,
 * rad/s in the nacelle's frame. Of a pivot the rates are its axes', and so follow from omega. A
 * base that turns itself adds its own angular velocity, seen from the nacelle. @return NOT_FINITE
 */
TRUEPOSE_API truepose_outcome truepose_gyro(const truepose_model* model,
                                            const truepose_real x[TRUEPOSE_FREEDOMS],
                                            truepose_real W[3 * TRUEPOSE_FREEDOMS]);

/** The motors' torques as the joints of a pivot feel them, J^-T torque, by which torque times rate
 * is the same on both sides; of another mobility the force and moment on the nacelle, along its
 * free twist. @return UNREACHABLE, SINGULAR, NOT_FINITE; NOT_COMPILED where pivots are left out */
TRUEPOSE_API truepose_outcome truepose_joint_torque(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    const truepose_real torque[TRUEPOSE_FREEDOMS],
                                                    truepose_real joint[TRUEPOSE_FREEDOMS]);
/** The inverse: torques of the motors that are these at the joints, J^T joint. */
TRUEPOSE_API truepose_outcome truepose_motor_torque(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    const truepose_real joint[TRUEPOSE_FREEDOMS],
                                                    truepose_real torque[TRUEPOSE_FREEDOMS]);

/** How far a pose is from singular, free of size and units; of the ideal level.
 *
 * @param parallel  out, 0 to 1: 0 where the motors do not hold the nacelle
 * @param serial    out, n of 0 to 1: 0 where arm and rod are in one line
 */
TRUEPOSE_API truepose_outcome truepose_conditioning(const truepose_model* model,
                                                    const truepose_real x[TRUEPOSE_FREEDOMS],
                                                    truepose_real* parallel,
                                                    truepose_real serial[TRUEPOSE_FREEDOMS]);

/** The extended-to-joint matrix, n rows of n + r, each padded to TRUEPOSE_READINGS; ideal level.
 *
 * @param band  conditioning below which J is damped (0: nowhere, as in the paper)
 */
TRUEPOSE_API truepose_outcome
truepose_tej(const truepose_model* model, const truepose_real x[TRUEPOSE_FREEDOMS],
             truepose_real band, truepose_real tej[TRUEPOSE_FREEDOMS * TRUEPOSE_READINGS]);

/* ------------------------------------------------------------------------------------------------
 * What is known, and what all readings say together
 */

/** What is known of the geometry and of the readings: a constant that `truepose export c` writes.
 * Whatever weighs by one answers TRUEPOSE_NO_SUCH_PART where its count or a column is not the
 * robot's; `part`: which column.
 */
typedef struct truepose_knowledge {
  int32_t count;             /**< p, uncertain parameters */
  int32_t unused;            /**< 0 */
  const int32_t* column;     /**< p, each one's column of H_xi */
  const truepose_real* root; /**< S, p by p, lower triangular: their covariance is S Sᵀ */
  truepose_real sigma[TRUEPOSE_READINGS]; /**< of every reading's own error, > 0 */
} truepose_knowledge;

/** Numbers of work space of a function that takes a knowledge; 0 of a model that was not loaded. */
TRUEPOSE_API size_t truepose_work(const truepose_model* model, int32_t count);

/** How an estimate of the pose ended, and how well it is known. */
typedef struct truepose_estimate_result {
  truepose_outcome outcome;
  int32_t iterations;
  int32_t unused;
  truepose_real chi2; /**< of the readings' disagreement; r on average in a healthy robot */
  truepose_real covariance[TRUEPOSE_FREEDOMS * TRUEPOSE_FREEDOMS]; /**< of the free twist */
} truepose_estimate_result;

/** The pose that all readings together say, weighed by what is known; at the model's level.
 *
 * @param work  truepose_work(model, known->count) numbers
 * @param x     in: a guess; out: the pose
 */
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
  TRUEPOSE_LAW_WEIGHTED = 3,  /**< as tej, weighed by what is known */
  TRUEPOSE_LAW_ESTIMATED = 4  /**< the pose that all readings say, weighed */
} truepose_law;

/** Motor error ê of a law, for drives that close their own loops: what they are to reduce to 0.
 *
 * @param band   as of truepose_tej()
 * @param known  null for laws that do not weigh; its work space likewise
 * @param e      out, rad or m, of the motors' readings
 * @return as truepose_ikm() of x_d; NOT_MEASURED: a law other than the joint one, and no sensor
 * is in use; NEAR_SINGULAR and an answer
 */
TRUEPOSE_API truepose_outcome truepose_motor_error(
    const truepose_model* model, int32_t law, truepose_real band,
    const truepose_real x_d[TRUEPOSE_FREEDOMS], const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, truepose_real e[TRUEPOSE_FREEDOMS]);

/** What truepose_servo() computes. */
typedef struct truepose_servo_cycle {
  truepose_real q_d[TRUEPOSE_FREEDOMS];                     /**< desired motor readings */
  truepose_real error[TRUEPOSE_FREEDOMS];                   /**< as of truepose_motor_error() */
  truepose_real J[TRUEPOSE_FREEDOMS * TRUEPOSE_FREEDOMS];   /**< as of truepose_jacobian() */
  truepose_real tej[TRUEPOSE_FREEDOMS * TRUEPOSE_READINGS]; /**< laws of all readings; else 0 */
  truepose_real x[TRUEPOSE_FREEDOMS]; /**< estimated pose, of laws that estimate one; else x_d */
} truepose_servo_cycle;

/** One servo cycle in one call: IKM, assembly mode, J, TEJ and motor error.
 * Parameters and result as of truepose_motor_error(). J and TEJ are those of the ideal level, by
 * which the laws map errors. */
TRUEPOSE_API truepose_outcome truepose_servo(const truepose_model* model, int32_t law,
                                             truepose_real band,
                                             const truepose_real x_d[TRUEPOSE_FREEDOMS],
                                             const truepose_real q_e[TRUEPOSE_READINGS],
                                             const truepose_knowledge* known, truepose_real* work,
                                             truepose_servo_cycle* cycle);

/** State of motors, or of the joints of a platform on passive axes: rad, rad/s, N·m. Of another
 * mobility the joints are the coordinates of the pose. */
typedef struct truepose_axis_state {
  truepose_real position[TRUEPOSE_FREEDOMS], velocity[TRUEPOSE_FREEDOMS];
  truepose_real torque[TRUEPOSE_FREEDOMS];
} truepose_axis_state;
/** A drive's command: torque + kp (position - measured) + kd (velocity - measured). */
typedef struct truepose_axis_command {
  truepose_axis_state state;
  truepose_real kp[TRUEPOSE_FREEDOMS], kd[TRUEPOSE_FREEDOMS];
} truepose_axis_command;

/** Joint state from motor state, in one call: FKM, J, rates and torques.
 *
 * @param joints  in: position, the guess; out
 * @return as truepose_fkm(); NOT_COMPILED where pivots are left out, as of the next function
 */
TRUEPOSE_API truepose_outcome truepose_joint_state(const truepose_model* model,
                                                   const truepose_axis_state* motors, int32_t cap,
                                                   truepose_axis_state* joints);
/** Motor command from joint command, in one call. The drives together act on the joints as the
 * joint command says: exactly in the state given, and near it by the diagonal of J^T diag(kp) J.
 *
 * @param motors, joints  the state, as of truepose_joint_state()
 * @return as truepose_ikm() of the position commanded
 */
TRUEPOSE_API truepose_outcome truepose_motor_command(const truepose_model* model,
                                                     const truepose_axis_state* motors,
                                                     const truepose_axis_state* joints,
                                                     const truepose_axis_command* joint_command,
                                                     truepose_axis_command* motor_command);

/** Constant while a controller runs. Start from truepose_control_defaults(). */
typedef struct truepose_control_settings {
  int32_t law;          /**< a truepose_law */
  int32_t gains;        /**< 0: torques per motor; 1: accelerations, shaped by the joint inertia */
  int32_t feed_forward; /**< 0 none, 1 gravity, 2 full dynamics */
  int32_t sigma_scale;  /**< times the readings' own sigma, for laws that weigh; 0 is 1 */
  truepose_real period; /**< s */
  truepose_real velocity_bandwidth; /**< of the velocity tracking loops, rad/s */
  truepose_real damped_below;       /**< conditioning from which on J is damped (0: never) */
  truepose_real lead_out;           /**< s over which a change of law takes effect */
  truepose_real kp[TRUEPOSE_FREEDOMS], kd[TRUEPOSE_FREEDOMS], ki[TRUEPOSE_FREEDOMS];
} truepose_control_settings;

/** 1 kHz, joint law, full feed-forward, gains 0. */
TRUEPOSE_API void truepose_control_defaults(truepose_control_settings* settings);
/** PD gains that give every motor this natural frequency (rad/s) and damping ratio at x. */
TRUEPOSE_API truepose_outcome truepose_place_poles(const truepose_model* model,
                                                   const truepose_real x[TRUEPOSE_FREEDOMS],
                                                   truepose_real frequency, truepose_real damping,
                                                   truepose_control_settings* settings);

/** What is asked of the nacelle: coordinates, free twist (m/s, rad/s), its derivative. */
typedef struct truepose_setpoint {
  truepose_real x[TRUEPOSE_FREEDOMS], rate[TRUEPOSE_FREEDOMS], acceleration[TRUEPOSE_FREEDOMS];
} truepose_setpoint;

/** Settings, and what a controller remembers. Opaque. */
typedef union truepose_controller {
  int64_t align;
  unsigned char bytes[8192];
} truepose_controller;
TRUEPOSE_API size_t truepose_controller_size(void);

/** Switches a controller on, or on again. @return NO_SUCH_PART of law, gains or feed-forward,
 * NO_SUCH_VALUE (a period or bandwidth that is not positive), NOT_FINITE, TOO_SMALL */
TRUEPOSE_API truepose_outcome truepose_controller_init(truepose_controller* controller, size_t size,
                                                       const truepose_control_settings* settings);
/** Another law from the next cycle on; no step of the torque follows. @return NO_SUCH_PART */
TRUEPOSE_API truepose_outcome truepose_change_law(truepose_controller* controller, int32_t law);

/** One cycle of a controller whose drives close their own loops: as truepose_motor_error(), by the
 * law and the damping of its settings. What laws that weigh know of a pose is kept from cycle to
 * cycle, as truepose_control() keeps it. */
TRUEPOSE_API truepose_outcome truepose_controller_error(
    const truepose_model* model, truepose_controller* controller,
    const truepose_real x_d[TRUEPOSE_FREEDOMS], const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, truepose_real e[TRUEPOSE_FREEDOMS]);

/** One cycle.
 *
 * @param known   null for laws that do not weigh; its work space likewise
 * @param torque  out, N·m or N, within the motors' limits; without an answer the last one
 */
TRUEPOSE_API truepose_outcome truepose_control(const truepose_model* model,
                                               truepose_controller* controller,
                                               const truepose_setpoint* setpoint,
                                               const truepose_real q_e[TRUEPOSE_READINGS],
                                               const truepose_knowledge* known, truepose_real* work,
                                               truepose_real torque[TRUEPOSE_FREEDOMS]);

/* ------------------------------------------------------------------------------------------------
 * Fault monitor: detection, isolation and substitution of faulty readings
 */

/** Constant while a monitor runs: `truepose export c` writes it for a robot and its gains. */
typedef struct truepose_fault_monitor_settings {
  int32_t refresh;           /**< cycles at most between looks at what the geometry leaves open */
  int32_t coast;             /**< cycles a reading is bridged before it has failed */
  int32_t decide;            /**< cycles of disagreement after which the robot stops */
  int32_t spikes, within;    /**< so many bridged faults (1 to 8) in so many cycles are a failure */
  int32_t unused;            /**< 0 */
  truepose_real period;      /**< s */
  truepose_real false_alarm; /**< chance of one in a cycle, 0 to 0.1 */
  truepose_real replaceable; /**< sigma up to which a motor's reading is replaced, rad or m */
  truepose_real correlation; /**< way on which a geometry's error changes by itself, m or rad */
  truepose_real stop;        /**< s in which the robot comes to rest along its path, */
  truepose_real stop_lost;   /**< and with a lost motor: twice the time in which a brake closes */
  truepose_real held;        /**< s at most for which a torque is held that nothing answers for */
  truepose_real fastest[TRUEPOSE_READINGS]; /**< largest second derivatives (0: not watched) */
  truepose_real moved[TRUEPOSE_READINGS];   /**< motion beside unchanged counts (0: not watched) */
  truepose_real kp[TRUEPOSE_FREEDOMS], kd[TRUEPOSE_FREEDOMS]; /**< 1/s², 1/s: the motors' loops */
  truepose_real rests[TRUEPOSE_FREEDOMS];  /**< error at which a healthy motor may rest */
  truepose_real shaken[TRUEPOSE_FREEDOMS]; /**< largest innovation sigma per cycle (0: any) */
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

/** What a monitor says. Sets of readings or motors are bits, the first one's 1. */
typedef struct truepose_fault_report {
  int32_t health[TRUEPOSE_READINGS];  /**< truepose_health */
  int32_t symptom[TRUEPOSE_READINGS]; /**< truepose_symptom, the latest */
  uint32_t doubted;                   /**< readings of which one is wrong; nobody knows which */
  uint32_t lost; /**< motors whose reading has failed, and nothing could stand for it */
  uint32_t
      brakes; /**< motors whose brakes must hold them until truepose_fault_monitor_acknowledge() */
  int32_t stops;      /**< 1: come to rest along the path, and stay: yours to obey, */
  truepose_real stop; /**< in so many s, for truepose_advance(); 0: it goes on */
} truepose_fault_report;

/** Settings, and what a monitor remembers. Opaque. */
typedef union truepose_fault_monitor {
  int64_t align;
  unsigned char bytes[16384];
} truepose_fault_monitor;
TRUEPOSE_API size_t truepose_fault_monitor_size(void);

/** Starts a monitor, or starts it anew. @return NO_SUCH_VALUE, NOT_FINITE, TOO_SMALL */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_init(
    truepose_fault_monitor* monitor, size_t size, const truepose_fault_monitor_settings* settings);

/** As truepose_control(), with the readings watched: what is not believed is replaced. A motor
 * whose brake is asked for gets its feed-forward alone; once all brakes are asked for, all torques
 * are those of gravity at rest. Both last until truepose_fault_monitor_acknowledge().
 *
 * @param finest  the robot as the watch understands it; null: `model`
 * @param known   of that robot; the controller's law weighs by it too
 * @param work    truepose_work(finest, known->count) numbers
 * @return DISAGREE and a reading: it is not valid, and the robot goes on without
 */
TRUEPOSE_API truepose_outcome truepose_control_fault_tolerant(
    const truepose_model* model, const truepose_model* finest, truepose_controller* controller,
    truepose_fault_monitor* monitor, const truepose_setpoint* setpoint,
    const truepose_real q_e[TRUEPOSE_READINGS], const truepose_knowledge* known,
    truepose_real* work, truepose_real torque[TRUEPOSE_FREEDOMS], truepose_fault_report* report);

/** The watch alone, for drives that close their own loops.
 *
 * @param desired   what the motors were asked for, n
 * @param believed  out: the readings, or what stands for those that are not believed
 */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_step(
    const truepose_model* finest, truepose_fault_monitor* monitor,
    const truepose_real desired[TRUEPOSE_FREEDOMS], const truepose_real q_e[TRUEPOSE_READINGS],
    const truepose_knowledge* known, truepose_real* work, truepose_real believed[TRUEPOSE_READINGS],
    truepose_fault_report* report);

/** A reading that was mended is believed again, and the robot may go on.
 * @return NO_SUCH_PART (`part`: the reading), UNFINISHED */
TRUEPOSE_API truepose_outcome truepose_fault_monitor_acknowledge(truepose_fault_monitor* monitor,
                                                                 int32_t reading);

/** Time along a path. Start with {0, 1, 0, 0}. */
typedef struct truepose_path_clock {
  truepose_real time; /**< s along the path */
  truepose_real rate; /**< 1: as fast as real time, */
  truepose_real slowing, since;
} truepose_path_clock;
/** One period. @param stop  truepose_fault_report's: s in which it comes to rest; 0: goes on */
TRUEPOSE_API void truepose_advance(truepose_path_clock* clock, truepose_real period,
                                   truepose_real stop);
/** Turns what a path says at clock->time into what to ask of the robot. */
TRUEPOSE_API void truepose_pace(const truepose_path_clock* clock, truepose_setpoint* setpoint);

/* ------------------------------------------------------------------------------------------------
 * Online calibration
 */

/** What a calibrator remembers. Opaque; holds pointers to the model it began with and to its
 * memory.
 */
typedef union truepose_online_calibrator {
  int64_t align;
  unsigned char bytes[20480];
} truepose_online_calibrator;
TRUEPOSE_API size_t truepose_online_calibrator_size(void);

/** Numbers of memory that a calibrator of so many parameters needs; 0 of a model that was not
 * loaded. */
TRUEPOSE_API size_t truepose_online_calibrator_memory(const truepose_model* drawn, int32_t count);

/** Starts from the model's own values and what is known of them.
 *
 * @param drawn   stays where it is while the calibrator is used
 * @param prior   `column` likewise; at least one sensor, and one parameter
 * @param memory  truepose_online_calibrator_memory(drawn, prior->count) numbers, the calibrator's
 * @return TOO_SMALL, UNFINISHED, NO_SUCH_PART (a column), NOT_MEASURED (no sensor)
 */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_init(
    truepose_online_calibrator* calibrator, size_t size, const truepose_model* drawn,
    const truepose_knowledge* prior, truepose_real* memory, size_t count);

/** One line of readings; one that is no news costs next to nothing.
 * @return DISAGREE: not learnt from, or not from the reading named; STOPPED: nothing is any more */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_step(
    truepose_online_calibrator* calibrator, const truepose_real q_e[TRUEPOSE_READINGS]);
/** How many lines counted, and how many were left out, or a reading of theirs. @return UNFINISHED
 */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_samples(
    const truepose_online_calibrator* calibrator, int64_t* learnt, int64_t* left_out);
/** Goes back to before the latest lines: one of their readings was found to lie. */
TRUEPOSE_API truepose_outcome
truepose_online_calibrator_roll_back(truepose_online_calibrator* calibrator);

/** The robot as it is believed to be by now. @param model  out */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_model(
    const truepose_online_calibrator* calibrator, truepose_model* model, size_t size);
/** And how well that is known. @param known  out; points into the calibrator's memory */
TRUEPOSE_API truepose_outcome truepose_online_calibrator_knowledge(
    const truepose_online_calibrator* calibrator, truepose_knowledge* known);

#ifdef __cplusplus
}
#endif

#endif
