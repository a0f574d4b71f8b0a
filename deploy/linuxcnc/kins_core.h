/* Kinematics between LinuxCNC's joints and axes, as functions of a block of parameters: nothing of
 * LinuxCNC is needed, so that it is tested without, and another version's interface is a thin shim.
 *
 * Joints and axes are in machine units: lengths in units of `unit` metres, angles in degrees. */
#ifndef TRUEPOSE_LINUXCNC_KINS_CORE_H
#define TRUEPOSE_LINUXCNC_KINS_CORE_H

#include "truepose/truepose.h"

enum { TRUEPOSE_KINS_AXES = 9 }; /**< x y z a b c u v w, and at most so many joints */

/** What universal joints add to a strut whose screw may turn in its nut (genhexkins). */
typedef struct truepose_screw {
  truepose_real lead;                /**< machine units a turn; 0: no such thing */
  truepose_real base_axis[6][3];     /**< unit, base frame */
  truepose_real platform_axis[6][3]; /**< unit, nacelle's frame */
  truepose_real correction[6];       /**< out: the latest, machine units */
} truepose_screw;

typedef struct truepose_kins {
  /* parameters */
  truepose_description robot;
  truepose_model model; /**< of it */
  int32_t motors;
  truepose_real scale[6];            /**< rad or m of a joint's unit */
  truepose_real unit;                /**< m of a machine unit of length */
  truepose_real least_conditioning;  /**< below it a pose is refused; 0: none is */
  int32_t cap;                       /**< steps of the forward model, each of its two searches */
  int32_t extra[TRUEPOSE_KINS_AXES]; /**< the axes of joints beyond the motors, in their order */
  int32_t extras;
  truepose_screw screw;
  /* memory */
  truepose_real guess[6]; /**< coordinates that the forward model found last */
  /* what happened */
  truepose_outcome outcome;                  /**< of the latest call */
  truepose_outcome refusal;                  /**< of the latest that was refused; stays */
  truepose_real refused[TRUEPOSE_KINS_AXES]; /**< the axes asked for by it, of an inverse */
  truepose_real conditioning;                /**< of the latest inverse, 0 to 1 */
  int32_t forward_status;                    /**< of the latest forward */
  int32_t iterations, most_iterations;       /**< of the forward model */
  truepose_real residual;                    /**< m, likewise */
} truepose_kins;

/** Begins anew with a robot. @param unit  m @return what truepose_load() says */
truepose_outcome truepose_kins_load(truepose_kins* kins, const truepose_description* robot,
                                    truepose_real unit);
/** Which axes do joints beyond the motors move? @param letters  such as "uv" @return 0: not these
 */
int truepose_kins_extras(truepose_kins* kins, const char* letters);

/** Joints of a pose that can be stood at: of the robot's own mode, within its stops, and no nearer
 * to a singularity than asked. @return a truepose_status; above TRUEPOSE_OK joints stay */
int32_t truepose_kins_inverse(truepose_kins* kins, const truepose_real axes[TRUEPOSE_KINS_AXES],
                              truepose_real joints[TRUEPOSE_KINS_AXES]);
/** The pose of joints, searched for from the axes given, then from the pose found last, then from
 * the robot's home. All axes 0, LinuxCNC's first guess, are none.
 * @param axes  in: the guess, and angles are given next to these; out
 * @return a truepose_status; above TRUEPOSE_OK axes stay */
int32_t truepose_kins_forward(truepose_kins* kins, const truepose_real joints[TRUEPOSE_KINS_AXES],
                              truepose_real axes[TRUEPOSE_KINS_AXES]);

#endif
