// Validation of a C table: every count, index, enum and number is checked before use.
#include "description.hpp"
#include "model.hpp"

namespace truepose::c {
namespace {

static_assert(kSensorPart == 6 && kBodyPart == 18 && kAxisPart == 26);  // as in truepose.h

bool unit(const Vec3& v) { return std::fabs(v.squaredNorm() - 1) < 1e-6; }

Status chain_status(const truepose_chain& c, const Chain& chain) {
  truepose_chain finite = c;  // stops may be infinite, but not NaN
  if (std::isinf(c.low)) finite.low = 0;
  if (std::isinf(c.high)) finite.high = 0;
  Finite numbers;
  chain_fields(finite, chain, numbers);
  if (!numbers.all) return Status::not_finite;
  const bool revolute = chain.actuator == Actuator::revolute;
  const bool telescopic = chain.actuator == Actuator::telescopic;
  bool good = c.low <= c.high && c.encoder_gain != 0 && c.gear != 0 && c.rod_spacing >= 0;
  good = good && (telescopic || (c.rod > 0 && unit(chain.axis))) &&
         (!revolute || (c.arm > 0 && c.encoder_buildup == 0));
  if (revolute) good = good && unit(chain.zero) && std::fabs(chain.axis().dot(chain.zero())) < 1e-6;
  for (const truepose_real number : {c.encoder_step, c.encoder_noise, c.torque_limit,
                                     c.drive_inertia, c.arm_mass, c.rod_mass, c.viscous, c.coulomb})
    good = good && number >= 0;
  return good ? Status::ok : Status::no_such_value;
}

Status sensor_status(const truepose_sensor& c, const Sensor& sensor) {
  Finite numbers;
  sensor_fields(c, sensor, numbers);
  if (!numbers.all) return Status::not_finite;
  const unsigned mounting = properties(sensor.kind).mounting;
  const bool good = c.gain != 0 && c.gear != 0 && c.step >= 0 && c.noise >= 0 && c.weight >= 0 &&
                    (!(mounting & kDirection) || unit(sensor.direction)) &&
                    (!(mounting & kNormal) || unit(sensor.normal));
  return good ? Status::ok : Status::no_such_value;
}

Status body_status(const truepose_body& c, const Body& body) {
  Finite numbers;
  body_fields(c, body, numbers);
  if (!numbers.all) return Status::not_finite;
  const Mat3 inertia = body.inertia;
  const bool symmetric = inertia == inertia.transpose() && inertia.diagonal().minCoeff() >= 0;
  return c.mass >= 0 && symmetric ? Status::ok : Status::no_such_value;
}

Status axis_status(const truepose_axis& c, const PassiveAxis& axis) {
  truepose_axis finite = c;  // as for a chain
  if (std::isinf(c.low)) finite.low = 0;
  if (std::isinf(c.high)) finite.high = 0;
  Finite numbers;
  axis_fields(finite, axis, numbers);
  if (!numbers.all) return Status::not_finite;
  return c.low <= c.high && unit(axis.direction) ? Status::ok : Status::no_such_value;
}

bool within(std::int32_t count, int most) { return count >= 0 && count <= most; }

/// Copies as far as counts allow; parts_exist checks the rest. @param robot  newly constructed
Outcome copied(const truepose_description& of, Robot& robot) {
  constexpr Copy<true> copy;
  if (!within(of.chains, kMaxChains) || !within(of.sensors, kMaxSensors) ||
      !within(of.bodies, kMaxBodies))
    return {Status::no_such_part, -1};
  robot.mobility = static_cast<Mobility>(of.mobility);
  robot.chains = of.chains;
  robot.motors = of.motors;
  robot.r = of.sensors;
  robot.bodies = of.bodies;
  robot.bar_joint = static_cast<BarJoint>(of.bar_joint);
  robot.level = static_cast<Level>(of.level);
  copy("gravity", of.gravity, robot.gravity);
  copy("home", of.home, robot.home);
  for (int i = 0; i < of.chains; ++i) {
    Chain& chain = robot.chain[i];
    chain.actuator = static_cast<Actuator>(of.chain[i].actuator);
    chain.working_mode = of.chain[i].working_mode;
    chain.bar = of.chain[i].bar;
    chain_fields(of.chain[i], chain, copy);
  }
  for (int k = 0; k < of.sensors; ++k) {
    Sensor& sensor = robot.sensor[k];
    sensor.kind = static_cast<SensorKind>(of.sensor[k].kind);
    sensor.chain = of.sensor[k].chain;
    sensor.at_nacelle = of.sensor[k].at_nacelle != 0;
    sensor.rod = of.sensor[k].rod;
    sensor.bar = of.sensor[k].bar;
    sensor.axis = of.sensor[k].axis;
    sensor_fields(of.sensor[k], sensor, copy);
  }
  for (int k = 0; k < of.bodies; ++k) {
    robot.body[k].bar = of.body[k].bar;
    body_fields(of.body[k], robot.body[k], copy);
  }
  if (!within(of.mobility, kMobilities - 1)) return {Status::no_such_part, -1};
  for (int j = 0; j < passive_axes(robot.mobility); ++j)
    axis_fields(of.axis[j], robot.axis[j], copy);
  return {};
}

}  // namespace

Outcome load(const truepose_description& of, Robot& robot) {
  if (of.abi != TRUEPOSE_ABI || of.size != sizeof of) return {Status::other_version, -1};
  Outcome outcome = copied(of, robot);
  if (outcome) outcome = parts_exist(robot);
  if (!outcome) return outcome;
  Finite head;
  head("gravity", of.gravity, 0);
  head("home", of.home, 0);
  if (!head.all) return {Status::not_finite, -1};
  for (int i = 0; i < robot.chains && outcome; ++i)
    outcome = {chain_status(of.chain[i], robot.chain[i]), i};
  for (int k = 0; k < robot.r && outcome; ++k)
    outcome = {sensor_status(of.sensor[k], robot.sensor[k]), kSensorPart + k};
  for (int k = 0; k < robot.bodies && outcome; ++k)
    outcome = {body_status(of.body[k], robot.body[k]), kBodyPart + k};
  for (int j = 0; j < passive_axes(robot.mobility) && outcome; ++j)
    outcome = {axis_status(of.axis[j], robot.axis[j]), kAxisPart + j};
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
