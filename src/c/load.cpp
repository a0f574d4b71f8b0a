// Validation of a C table: every count, index, enum and number is checked before use.
#include "c/model.hpp"

namespace truepose::c {
namespace {
static_assert(kSensorPart == 8 && kBodyPart == 20 && kAxisPart == 28);  // as in truepose.h

bool unit(const Vec3& v) { return fabs(v.squaredNorm() - 1) < 1e-6; }

/// Whether all numbers are finite; stops may be infinite, but not NaN.
template <class Part>
bool sound(Part part) {
  if constexpr (requires { part.low; }) {
    if (std::isinf(part.low)) part.low = 0;
    if (std::isinf(part.high)) part.high = 0;
  }
  return finite(part);
}

bool good(const Chain& c) {
  const bool revolute = c.actuator == Actuator::revolute;
  const bool telescopic = c.actuator == Actuator::telescopic;
  bool all = c.low <= c.high && c.encoder_gain != 0 && c.eccentricity.gear != 0 &&
             c.rod_spacing >= 0 && (telescopic || (c.rod > 0 && unit(c.axis))) &&
             (!revolute || (c.arm > 0 && c.encoder_buildup == 0));
  if (revolute) all = all && unit(c.zero) && fabs(c.axis.dot(c.zero)) < 1e-6;
  for (const Real number : {c.encoder_step, c.encoder_noise, c.torque_limit, c.drive_inertia,
                            c.arm_mass, c.rod_mass, c.viscous, c.coulomb})
    all = all && number >= 0;
  return all;
}
bool good(const Sensor& s) {
  const unsigned mounting = properties(s.kind).mounting;
  return s.gain != 0 && s.eccentricity.gear != 0 && s.step >= 0 && s.noise >= 0 && s.weight >= 0 &&
         (!(mounting & kDirection) || unit(s.direction)) &&
         (!(mounting & kNormal) || unit(s.normal));
}
bool good(const Body& body) {
  bool symmetric = true;
  for (int i : range(3))
    for (int j : range(i + 1))
      symmetric = symmetric && body.inertia(i, j) == body.inertia(j, i) && body.inertia(i, i) >= 0;
  return body.mass >= 0 && symmetric;
}
bool good(const PassiveAxis& axis) { return axis.low <= axis.high && unit(axis.direction); }

/// The first part with invalid numbers. @param first  number of a kind's first part in outcomes
Outcome checked(const auto& parts, int count, int first) {
  for (int k : range(count)) {
    if (!sound(parts[k])) return {Status::not_finite, first + k};
    if (!good(parts[k])) return {Status::no_such_value, first + k};
  }
  return {};
}

/// The finished robot of a description.
Outcome load(const truepose_description& of, Robot& robot) {
  if (of.abi != TRUEPOSE_ABI || of.size != sizeof of) return Status::other_version;
  std::memcpy(static_cast<void*>(&robot), &of, sizeof of);
  Outcome outcome = parts_exist(robot);
  if (outcome && !finite(robot)) outcome = {Status::not_finite};
  if (outcome) outcome = checked(robot.chain, robot.chains, 0);
  if (outcome) outcome = checked(robot.sensor, robot.r, kSensorPart);
  if (outcome) outcome = checked(robot.body, robot.bodies, kBodyPart);
  if (outcome) outcome = checked(robot.axis, passive_axes(robot.mobility), kAxisPart);
  if (!outcome) return outcome;
  outcome = finish(robot);
  if (!outcome || robot.level == Level::ideal) return outcome;
  outcome = finish_full(robot);
  const bool has = robot.full.own() || robot.full.kind == FullKind::same;
  return outcome && !has ? Outcome{Status::no_full_level} : outcome;
}
}  // namespace
}  // namespace truepose::c

using namespace truepose;

using namespace truepose::c;

extern "C" {
size_t truepose_model_size(void) { return sizeof(Model); }

int32_t truepose_abi(void) { return TRUEPOSE_ABI; }

const char* truepose_status_text(int32_t status) { return describe(static_cast<Status>(status)); }

truepose_outcome truepose_load(truepose_model* model, size_t size,
                               const truepose_description* description) {
  return answer(
      begun({}, model, size, [&](Model& made) { return load(*description, made.robot); }));
}

truepose_outcome truepose_description_of(const truepose_model* model,
                                         truepose_description* description) {
  return with(model)([&](const Robot& robot) { describe(robot, *description); });
}

int32_t truepose_freedoms(const truepose_model* model) {
  const Robot* robot = held(model);
  return robot ? dof(robot->mobility) : 0;
}

int32_t truepose_motors(const truepose_model* model) {
  const Robot* robot = held(model);
  return robot ? robot->motors : 0;
}

int32_t truepose_sensors(const truepose_model* model) {
  const Robot* robot = held(model);
  return robot ? robot->r : 0;
}
}
