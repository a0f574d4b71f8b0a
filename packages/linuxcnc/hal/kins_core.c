/* Kinematics between joints and axes. */
#include "kins_core.h"

#include "table.h"

#include <math.h>
#include <string.h>

static const truepose_real kTurn = 6.283185307179586;
static const char kLetters[] = "xyzabcuvw";

enum { kA = 3, kC = 5, kScrewSteps = 20 };

truepose_outcome truepose_kins_load(truepose_kins* kins, const truepose_description* robot,
                                    truepose_real unit) {
  const truepose_outcome no_unit = {TRUEPOSE_NO_SUCH_VALUE, -1};
  memset(kins, 0, sizeof *kins);
  kins->outcome =
      unit > 0 && isfinite(unit) ? truepose_load(&kins->model, sizeof kins->model, robot) : no_unit;
  if (kins->outcome.status > TRUEPOSE_OK) return kins->outcome;
  kins->robot = *robot;
  kins->motors = truepose_freedoms(&kins->model);
  if (truepose_motors(&kins->model) != kins->motors) kins->outcome.status = TRUEPOSE_NOT_SQUARE;
  if (kins->outcome.status > TRUEPOSE_OK) return kins->outcome;
  kins->cap = TRUEPOSE_STEPS;
  for (int i = 0; i < kins->motors; ++i) {
    const int plain = robot->mobility == TRUEPOSE_SPATIAL       ? 6
                      : robot->mobility >= TRUEPOSE_TRANSLATION ? 3
                                                                : 2;
    kins->scale[i] = truepose_reading_scale(robot, i, unit);
    kins->pose_scale[i] = truepose_freedom_scale(robot, i, unit);
    kins->axis[i] = i < plain ? i : kC; /* theta */
  }
  memcpy(kins->guess, robot->home, sizeof kins->guess);
  return kins->outcome;
}

int truepose_kins_extras(truepose_kins* kins, const char* letters) {
  kins->extras = 0;
  for (; *letters != '\0'; ++letters) {
    const char* at = strchr(kLetters, *letters);
    const int axis = at != NULL ? (int)(at - kLetters) : -1;
    if (axis < 3 || kins->motors + kins->extras >= TRUEPOSE_KINS_AXES) return 0;
    for (int i = 0; i < kins->motors; ++i)
      if (kins->axis[i] == axis) return 0;
    for (int k = 0; k < kins->extras; ++k)
      if (kins->extra[k] == axis) return 0;
    kins->extra[kins->extras++] = axis;
  }
  return 1;
}

/** The platform's pose at axes: a, b, c are roll, pitch, yaw; for other mobilities c is theta. */
static truepose_outcome pose_at(const truepose_kins* kins, const truepose_real* axes,
                                truepose_pose* pose) {
  truepose_real x[6] = {0};
  for (int i = 0; i < kins->motors; ++i) x[i] = axes[kins->axis[i]] * kins->pose_scale[i];
  if (kins->robot.mobility != TRUEPOSE_SPATIAL) return truepose_pose_of(&kins->model, x, pose);
  memcpy(pose->position, x, sizeof pose->position);
  return truepose_from_roll_pitch_yaw(x + kA, pose->rotation);
}

static truepose_outcome axes_of(const truepose_kins* kins, const truepose_real* x,
                                truepose_real* axes) {
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  truepose_real shown[6];
  memcpy(shown, x, sizeof shown);
  if (kins->robot.mobility == TRUEPOSE_SPATIAL) {
    truepose_pose pose;
    for (int i = kA; i < 6; ++i) shown[i] = isfinite(axes[i]) ? axes[i] * kins->pose_scale[i] : 0;
    outcome = truepose_pose_of(&kins->model, x, &pose);
    if (outcome.status <= TRUEPOSE_OK)
      outcome = truepose_to_roll_pitch_yaw(pose.rotation, shown + kA);
    if (outcome.status > TRUEPOSE_OK) return outcome;
  }
  for (int i = 0; i < kins->motors; ++i) axes[kins->axis[i]] = shown[i] / kins->pose_scale[i];
  return outcome;
}

static void cross(const truepose_real* a, const truepose_real* b, truepose_real* c) {
  for (int i = 0; i < 3; ++i)
    c[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}
static truepose_real dot(const truepose_real* a, const truepose_real* b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** Turns of the struts' screws at a pose. A strut's two universal joints fix the rolls of its ends:
 * the base's second axis is normal to the base's own and to the strut, likewise the platform's. The
 * screw turns by the angle between the two normals about the strut. */
static truepose_outcome screw_turns(truepose_kins* kins, const truepose_pose* pose) {
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  for (int i = 0; i < kins->motors && outcome.status <= TRUEPOSE_OK; ++i) {
    const truepose_chain* chain = &kins->robot.chain[i];
    truepose_real strut[3], axis[3], base[3], normal[3], platform[3];
    for (int k = 0; k < 3; ++k) {
      const truepose_real* row = pose->rotation + 3 * k;
      strut[k] = pose->position[k] + dot(row, chain->pivot) - chain->base[k];
      axis[k] = dot(row, kins->screw.platform_axis[i]);
    }
    cross(kins->screw.base_axis[i], strut, base);
    cross(strut, base, normal);
    cross(axis, strut, platform);
    const truepose_real size = sqrt(dot(normal, normal) * dot(platform, platform));
    const truepose_real sine = dot(normal, platform) / size;
    kins->screw.correction[i] = kins->screw.lead * asin(fmax(-1, fmin(1, sine))) / kTurn;
    if (!(size > 0)) outcome.status = TRUEPOSE_SINGULAR, outcome.part = i;
  }
  return outcome;
}

static truepose_outcome inverse(truepose_kins* kins, const truepose_real* axes,
                                truepose_real* joints) {
  truepose_real q[TRUEPOSE_MOTORS];
  truepose_pose pose;
  truepose_outcome outcome = pose_at(kins, axes, &pose);
  if (outcome.status <= TRUEPOSE_OK)
    outcome = truepose_ikm_pose(&kins->model, &pose, q, &kins->conditioning);
  if (outcome.status <= TRUEPOSE_OK && !(kins->conditioning >= kins->least_conditioning))
    outcome.status = TRUEPOSE_SINGULAR;
  if (outcome.status <= TRUEPOSE_OK && kins->screw.lead != 0) outcome = screw_turns(kins, &pose);
  for (int k = 0; k < kins->extras && outcome.status <= TRUEPOSE_OK; ++k)
    if (!isfinite(axes[kins->extra[k]])) outcome.status = TRUEPOSE_NOT_FINITE;
  if (outcome.status > TRUEPOSE_OK) return outcome;
  for (int i = 0; i < kins->motors; ++i)
    joints[i] = q[i] / kins->scale[i] + kins->screw.correction[i];
  for (int k = 0; k < kins->extras; ++k) joints[kins->motors + k] = axes[kins->extra[k]];
  return outcome;
}

int32_t truepose_kins_inverse(truepose_kins* kins, const truepose_real axes[TRUEPOSE_KINS_AXES],
                              truepose_real joints[TRUEPOSE_KINS_AXES]) {
  kins->outcome = inverse(kins, axes, joints);
  if (kins->outcome.status > TRUEPOSE_OK) {
    kins->refusal = kins->outcome;
    memcpy(kins->refused, axes, sizeof kins->refused);
  }
  return kins->outcome.status;
}

/** Converts axes to a guess of the coordinates. @return 0: no guess */
static int guessed(const truepose_kins* kins, const truepose_real* axes, truepose_real* x) {
  int any = 0;
  truepose_pose pose;
  for (int k = 0; k < TRUEPOSE_KINS_AXES; ++k) any |= axes[k] != 0;
  memcpy(x, kins->guess, sizeof kins->guess); /* coordinates of a turn are next to it */
  if (kins->robot.mobility == TRUEPOSE_SPATIAL)
    any = any && pose_at(kins, axes, &pose).status <= TRUEPOSE_OK &&
          truepose_coordinates_of(&kins->model, &pose, x).status <= TRUEPOSE_OK;
  for (int i = 0; i < kins->motors; ++i) {
    if (kins->robot.mobility != TRUEPOSE_SPATIAL) x[i] = axes[kins->axis[i]] * kins->pose_scale[i];
    any &= isfinite(x[i]) != 0;
  }
  if (!any) memcpy(x, kins->guess, sizeof kins->guess);
  return any;
}

/** x of joints, from the guess. The screws' corrections depend on the pose, which hardly depends on
 * them: a few rounds. */
static truepose_fkm_result search(truepose_kins* kins, const truepose_real* joints,
                                  truepose_real* x) {
  truepose_fkm_result result;
  int32_t iterations = 0;
  for (int round = 0; round < kScrewSteps; ++round) {
    truepose_real q[TRUEPOSE_MOTORS] = {0}, before[6], change = 0;
    truepose_pose pose;
    memcpy(before, kins->screw.correction, sizeof before);
    for (int i = 0; i < kins->motors; ++i) q[i] = (joints[i] - before[i]) * kins->scale[i];
    result = truepose_fkm(&kins->model, q, kins->cap, x);
    iterations += result.iterations;
    if (kins->screw.lead == 0) break;
    if (result.outcome.status <= TRUEPOSE_OK)
      result.outcome = truepose_pose_of(&kins->model, x, &pose);
    if (result.outcome.status <= TRUEPOSE_OK) result.outcome = screw_turns(kins, &pose);
    if (result.outcome.status > TRUEPOSE_OK) break;
    for (int i = 0; i < kins->motors; ++i)
      change = fmax(change, fabs(kins->screw.correction[i] - before[i]));
    if (change <= 1e-13 * fabs(kins->screw.lead)) break;
    if (round == kScrewSteps - 1) result.outcome.status = TRUEPOSE_NOT_CONVERGED;
  }
  result.iterations = iterations;
  return result;
}

int32_t truepose_kins_forward(truepose_kins* kins, const truepose_real joints[TRUEPOSE_KINS_AXES],
                              truepose_real axes[TRUEPOSE_KINS_AXES]) {
  truepose_real x[6], kept[6];
  truepose_outcome outcome;
  truepose_fkm_result result;
  int again = guessed(kins, axes, x);
  memcpy(kept, kins->screw.correction, sizeof kept);
  for (;; again = 0) {
    result = search(kins, joints, x);
    if (result.outcome.status <= TRUEPOSE_OK || !again) break;
    memcpy(x, kins->guess, sizeof x);
    memcpy(kins->screw.correction, kept, sizeof kept);
  }
  outcome = result.outcome;
  kins->iterations = result.iterations;
  kins->residual = result.residual;
  for (int k = 0; k < kins->extras && outcome.status <= TRUEPOSE_OK; ++k)
    if (!isfinite(joints[kins->motors + k])) outcome.status = TRUEPOSE_NOT_FINITE;
  if (outcome.status <= TRUEPOSE_OK) outcome = axes_of(kins, x, axes);
  kins->outcome = outcome;
  if (outcome.status > TRUEPOSE_OK) {
    kins->refusal = outcome;
    memcpy(kins->screw.correction, kept, sizeof kept);
    return outcome.status;
  }
  if (kins->iterations > kins->most_iterations) kins->most_iterations = kins->iterations;
  memcpy(kins->guess, x, sizeof x);
  for (int k = 0; k < kins->extras; ++k) axes[kins->extra[k]] = joints[kins->motors + k];
  return outcome.status;
}
