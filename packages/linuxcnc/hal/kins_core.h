/* Kinematics between LinuxCNC's joints and axes, as functions on a block of parameters. Independent
 * of LinuxCNC: testable without it, and the interface of another version is a thin shim.
 *
 * Joints and axes are in machine units: lengths in units of `unit` metres, angles in degrees. */
#ifndef TRUEPOSE_LINUXCNC_KINS_CORE_H
#define TRUEPOSE_LINUXCNC_KINS_CORE_H

#include "truepose/truepose.h"

enum { TRUEPOSE_KINS_AXES = 9 }; /**< x y z a b c u v w; also the maximum number of joints */

/** Effect of universal joints on a strut whose screw may turn in its nut (genhexkins). */
typedef struct truepose_screw {
  truepose_real lead;                /**< machine units per turn; 0: no such effect */
  truepose_real base_axis[6][3];     /**< unit, base frame */
  truepose_real platform_axis[6][3]; /**< unit, platform frame */
  truepose_real correction[6];       /**< out: the latest, machine units */
} truepose_screw;

typedef struct truepose_kins {
  /* parameters */
  truepose_description robot;
  truepose_model model; /**< of this robot */
  int32_t motors;
  truepose_real scale[6];            /**< rad or m per joint unit */
  truepose_real pose_scale[6];       /**< rad or m per axis unit, of the pose's freedoms */
  int32_t axis[6];                   /**< their axes */
  truepose_real least_conditioning;  /**< below it a pose is refused; 0: never */
  int32_t cap;                       /**< steps of the forward model, each of its two searches */
  int32_t extra[TRUEPOSE_KINS_AXES]; /**< axes of joints beyond the motors, in their order */
  int32_t extras;
  truepose_screw screw;
  /* state */
  truepose_real guess[6]; /**< last coordinates of the forward model */
  /* outputs */
  truepose_outcome outcome;                  /**< of the last call */
  truepose_outcome refusal;                  /**< of the last refused call; stays */
  truepose_real refused[TRUEPOSE_KINS_AXES]; /**< axes of a refused inverse */
  truepose_real conditioning;                /**< of the last inverse, 0 to 1 */
  int32_t iterations, most_iterations;       /**< of the forward model */
  truepose_real residual;                    /**< of the forward model, m */
} truepose_kins;

/** Initialises with a robot. @param unit  m @return as truepose_load() */
truepose_outcome truepose_kins_load(truepose_kins* kins, const truepose_description* robot,
                                    truepose_real unit);
/** Sets the axes of joints beyond the motors. @param letters  such as "uv" @return 0: invalid */
int truepose_kins_extras(truepose_kins* kins, const char* letters);

/** Computes the joints of a feasible pose: in the robot's own mode, within its stops, and not below
 * least_conditioning. @return a truepose_status; above TRUEPOSE_OK joints are unchanged */
int32_t truepose_kins_inverse(truepose_kins* kins, const truepose_real axes[TRUEPOSE_KINS_AXES],
                              truepose_real joints[TRUEPOSE_KINS_AXES]);
/** Computes the pose of joints, searched for from the given axes, then from the last pose, then
 * from home. All axes 0, LinuxCNC's first guess, are no guess.
 * @param axes  in: the guess, next to which angles are returned; out
 * @return a truepose_status; above TRUEPOSE_OK axes are unchanged */
int32_t truepose_kins_forward(truepose_kins* kins, const truepose_real joints[TRUEPOSE_KINS_AXES],
                              truepose_real axes[TRUEPOSE_KINS_AXES]);

#endif
