// Validation of a C table: every count, index, enum and number is checked before use.
#include "c/description.hpp"
#include "c/model.hpp"

namespace truepose::c {
namespace {
static_assert(kSensorPart == 6 && kBodyPart == 18 && kAxisPart == 26);  // as in truepose.h

bool unit(const Vec3& v) { return std::fabs(v.squaredNorm() - 1) < 1e-6; }

/// A part whose stops may be infinite, but not NaN, without infinite ones.
template <class C>
C bounded(C part) {
  if (std::isinf(part.low)) part.low = 0;
  if (std::isinf(part.high)) part.high = 0;
  return part;
}

Status status_of(const truepose_chain& c, const Chain& chain) {
  if (!finite(bounded(c), chain)) return Status::not_finite;
  const bool revolute = chain.actuator == Actuator::revolute;
  const bool telescopic = chain.actuator == Actuator::telescopic;
  bool good = c.low <= c.high && c.encoder_gain != 0 && c.gear != 0 && c.rod_spacing >= 0;
  good = good && (telescopic || (c.rod > 0 && unit(chain.axis))) &&
         (!revolute || (c.arm > 0 && c.encoder_buildup == 0));
  if (revolute) good = good && unit(chain.zero) && std::fabs(chain.axis.dot(chain.zero)) < 1e-6;
  for (const truepose_real number : {c.encoder_step, c.encoder_noise, c.torque_limit,
                                     c.drive_inertia, c.arm_mass, c.rod_mass, c.viscous, c.coulomb})
    good = good && number >= 0;
  return good ? Status::ok : Status::no_such_value;
}

Status status_of(const truepose_sensor& c, const Sensor& sensor) {
  if (!finite(c, sensor)) return Status::not_finite;
  const unsigned mounting = properties(sensor.kind).mounting;
  const bool good = c.gain != 0 && c.gear != 0 && c.step >= 0 && c.noise >= 0 && c.weight >= 0 &&
                    (!(mounting & kDirection) || unit(sensor.direction)) &&
                    (!(mounting & kNormal) || unit(sensor.normal));
  return good ? Status::ok : Status::no_such_value;
}

Status status_of(const truepose_body& c, const Body& body) {
  if (!finite(c, body)) return Status::not_finite;
  bool symmetric = true;
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j <= i; ++j)
      symmetric = symmetric && body.inertia(i, j) == body.inertia(j, i) && body.inertia(i, i) >= 0;
  return c.mass >= 0 && symmetric ? Status::ok : Status::no_such_value;
}

Status status_of(const truepose_axis& c, const PassiveAxis& axis) {
  if (!finite(bounded(c), axis)) return Status::not_finite;
  return c.low <= c.high && unit(axis.direction) ? Status::ok : Status::no_such_value;
}

/// The first part with invalid numbers. @param first  number of a kind's first part in outcomes
Outcome checked(const auto& c, const auto& core, int count, int first) {
  for (int k = 0; k < count; ++k)
    if (const Status status = status_of(c[k], core[k]); status != Status::ok)
      return {status, first + k};
  return {};
}

bool within(std::int32_t count, int most) { return count >= 0 && count <= most; }
}  // namespace

Outcome load(const truepose_description& of, Robot& robot) {
  if (of.abi != TRUEPOSE_ABI || of.size != sizeof of) return {Status::other_version, -1};
  if (!within(of.chains, kMaxChains) || !within(of.sensors, kMaxSensors) ||
      !within(of.bodies, kMaxBodies))
    return {Status::no_such_part, -1};
  fields(of, robot, Copy<true>{});
  parts(of, robot, [](const auto& c, auto& part) { fields(c, part, Copy<true>{}); });
  Outcome outcome = parts_exist(robot);
  if (outcome && !finite(of, robot)) outcome = {Status::not_finite, -1};
  if (outcome) outcome = checked(of.chain, robot.chain, robot.chains, 0);
  if (outcome) outcome = checked(of.sensor, robot.sensor, robot.r, kSensorPart);
  if (outcome) outcome = checked(of.body, robot.body, robot.bodies, kBodyPart);
  if (outcome) outcome = checked(of.axis, robot.axis, passive_axes(robot.mobility), kAxisPart);
  if (!outcome) return outcome;
  const Level level = robot.level;
  outcome = finish(robot);
  if (outcome && level == Level::full) {
    outcome = finish_full(robot);
    const bool has = robot.full.own() || robot.full.kind == FullKind::same;
    if (outcome && !has) outcome = {Status::no_full_level, -1};
  }
  if (!outcome) robot.finished = false;
  return outcome;
}
}  // namespace truepose::c

using namespace truepose;

extern "C" {
size_t truepose_model_size(void) { return sizeof(c::Model); }

int32_t truepose_abi(void) { return TRUEPOSE_ABI; }

const char* truepose_status_text(int32_t status) { return describe(static_cast<Status>(status)); }

truepose_outcome truepose_load(truepose_model* model, size_t size,
                               const truepose_description* description) {
  c::Model* made = c::Model::make(model, size);
  if (made == nullptr) return c::answer({Status::too_small, -1});
  return c::answer(c::load(*description, made->robot));
}

truepose_outcome truepose_description_of(const truepose_model* model,
                                         truepose_description* description) {
  return c::asked(model, [&](const Robot& robot) -> Outcome {
    c::describe(robot, *description);
    return {};
  });
}

int32_t truepose_freedoms(const truepose_model* model) {
  return c::of_robot(model, 0, [](const Robot& robot) { return robot.motors; });
}

int32_t truepose_sensors(const truepose_model* model) {
  return c::of_robot(model, 0, [](const Robot& robot) { return robot.r; });
}
}
