/* Kinematics between joints and axes. */
#include "kins_core.h"

#include "table.h"

#include <math.h>
#include <string.h>

static const truepose_real kDegree = 0.017453292519943295;
static const char kLetters[] = "xyzabcuvw";

enum { kX = 0, kZ = 2, kA = 3, kC = 5, kCap = 12, kScrewSteps = 20 };

/** Whether there is z; a turn about it (axis c); all three turns (a, b, c). */
static int has_z(int32_t mobility) { return mobility >= TRUEPOSE_TRANSLATION; }
static int turns_about_z(int32_t mobility) {
  return mobility == TRUEPOSE_PLANAR || mobility == TRUEPOSE_SCHOENFLIES;
}

truepose_outcome truepose_kins_load(truepose_kins* kins, const truepose_description* robot,
                                    truepose_real unit) {
  const truepose_outcome no_unit = {TRUEPOSE_NO_SUCH_VALUE, -1};
  memset(kins, 0, sizeof *kins);
  kins->outcome =
      unit > 0 && isfinite(unit) ? truepose_load(&kins->model, sizeof kins->model, robot) : no_unit;
  if (kins->outcome.status > TRUEPOSE_OK) return kins->outcome;
  kins->robot = *robot;
  kins->motors = truepose_freedoms(&kins->model);
  kins->unit = unit;
  kins->cap = kCap;
  for (int i = 0; i < kins->motors; ++i) kins->scale[i] = truepose_reading_scale(robot, i, unit);
  memcpy(kins->guess, robot->home, sizeof kins->guess);
  return kins->outcome;
}

int truepose_kins_extras(truepose_kins* kins, const char* letters) {
  const int own = kins->robot.mobility == TRUEPOSE_SPATIAL ? 6 : 3;
  kins->extras = 0;
  for (; *letters != '\0'; ++letters) {
    const char* at = strchr(kLetters, *letters);
    const int axis = at != NULL ? (int)(at - kLetters) : -1;
    if (axis < own || kins->motors + kins->extras >= TRUEPOSE_KINS_AXES) return 0;
    if (axis == kC && turns_about_z(kins->robot.mobility)) return 0;
    for (int k = 0; k < kins->extras; ++k)
      if (kins->extra[k] == axis) return 0;
    kins->extra[kins->extras++] = axis;
  }
  return 1;
}

/** The platform's pose at axes: a, b, c are roll, pitch, yaw; for other mobilities c is theta. */
static truepose_outcome pose_at(const truepose_kins* kins, const truepose_real* axes,
                                truepose_pose* pose) {
  const int spatial = kins->robot.mobility == TRUEPOSE_SPATIAL;
  truepose_real x[6] = {0}, angles[3];
  for (int i = 0; i < (has_z(kins->robot.mobility) ? 3 : 2); ++i) x[i] = axes[kX + i] * kins->unit;
  if (turns_about_z(kins->robot.mobility)) x[kins->motors - 1] = axes[kC] * kDegree;
  if (!spatial) return truepose_pose_of(&kins->model, x, pose);
  for (int i = 0; i < 3; ++i) {
    angles[i] = axes[kA + i] * kDegree;
    pose->position[i] = x[i];
  }
  return truepose_from_roll_pitch_yaw(angles, pose->rotation);
}

static truepose_outcome axes_of(const truepose_kins* kins, const truepose_real* x,
                                truepose_real* axes) {
  truepose_outcome outcome = {TRUEPOSE_OK, -1};
  truepose_pose pose;
  truepose_real angles[3];
  if (kins->robot.mobility == TRUEPOSE_SPATIAL) {
    for (int i = 0; i < 3; ++i) angles[i] = isfinite(axes[kA + i]) ? axes[kA + i] * kDegree : 0;
    outcome = truepose_pose_of(&kins->model, x, &pose);
    if (outcome.status <= TRUEPOSE_OK) outcome = truepose_to_roll_pitch_yaw(pose.rotation, angles);
    if (outcome.status > TRUEPOSE_OK) return outcome;
    for (int i = 0; i < 3; ++i) axes[kA + i] = angles[i] / kDegree;
  }
  for (int i = 0; i < (has_z(kins->robot.mobility) ? 3 : 2); ++i) axes[kX + i] = x[i] / kins->unit;
  if (turns_about_z(kins->robot.mobility)) axes[kC] = x[kins->motors - 1] / kDegree;
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
    kins->screw.correction[i] = kins->screw.lead * asin(fmax(-1, fmin(1, sine))) / (360 * kDegree);
    if (!(size > 0)) outcome.status = TRUEPOSE_SINGULAR, outcome.part = i;
  }
  return outcome;
}

static truepose_outcome inverse(truepose_kins* kins, const truepose_real* axes,
                                truepose_real* joints) {
  truepose_real q[6];
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
  memcpy(x, kins->guess, sizeof kins->guess); /* selects the turn */
  if (turns_about_z(kins->robot.mobility)) x[kins->motors - 1] = axes[kC] * kDegree;
  if (any && pose_at(kins, axes, &pose).status <= TRUEPOSE_OK &&
      truepose_coordinates_of(&kins->model, &pose, x).status <= TRUEPOSE_OK) {
    for (int i = 0; i < kins->motors; ++i) any &= isfinite(x[i]) != 0;
    if (any) return 1;
  }
  memcpy(x, kins->guess, sizeof kins->guess);
  return 0;
}

/** x of joints, from the guess, minus the known corrections. */
static truepose_fkm_result search(truepose_kins* kins, const truepose_real* joints,
                                  truepose_real* x) {
  truepose_real q[6] = {0};
  for (int i = 0; i < kins->motors; ++i)
    q[i] = (joints[i] - kins->screw.correction[i]) * kins->scale[i];
  return truepose_fkm(&kins->model, q, kins->cap, x);
}

/** The screws' corrections depend on the pose, which hardly depends on them: a few rounds. */
static truepose_fkm_result search_with_screws(truepose_kins* kins, const truepose_real* joints,
                                              truepose_real* x) {
  truepose_fkm_result result = {{TRUEPOSE_NOT_CONVERGED, -1}, 0, 0, 0};
  int32_t iterations = 0;
  for (int round = 0; round < kScrewSteps; ++round) {
    truepose_real before[6], change = 0;
    truepose_pose pose;
    memcpy(before, kins->screw.correction, sizeof before);
    result = search(kins, joints, x);
    iterations += result.iterations;
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
    result = kins->screw.lead != 0 ? search_with_screws(kins, joints, x) : search(kins, joints, x);
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
