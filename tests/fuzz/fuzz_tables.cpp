// Does any table that a C program may hand in, or any input after it, crash the C interface, or
// make it call a NaN an answer?
#include "../../src/c/fields.hpp"
#include "decode.hpp"

namespace {

using namespace fuzz;

/// Overwrites some words of a struct by anything.
template <class Struct>
void scribble(Bytes& bytes, Struct& table) {
  for (int k = bytes.below(6); k > 0; --k) {
    const int at = bytes.byte() << 8 | bytes.byte();
    unsigned char* memory = reinterpret_cast<unsigned char*>(&table);
    if (bytes.one_in(2)) {
      const std::size_t word = static_cast<std::size_t>(at) % (sizeof table / sizeof(double));
      const double value = bytes.number();
      std::memcpy(memory + word * sizeof value, &value, sizeof value);
    } else {
      const std::size_t word = static_cast<std::size_t>(at) % (sizeof table / sizeof(std::int32_t));
      const std::int32_t value = bytes.one_in(2) ? bytes.below(20) - 8 : bytes.byte() * 0x7fffff;
      std::memcpy(memory + word * sizeof value, &value, sizeof value);
    }
  }
}

bool answered(truepose_outcome outcome) { return outcome.status <= TRUEPOSE_OK; }

void finite(const truepose_real* values, int count, const char* promise) {
  for (int k = 0; k < count; ++k) require(std::isfinite(values[k]), promise);
}

template <class Values>
Values numbers(Bytes& bytes, const Values& around) {
  Values values = around;
  const bool wild = bytes.one_in(4);
  for (double& value : values) value = wild ? bytes.number() : value + 0.1 * bytes.share();
  return values;
}

void ask(Bytes& bytes, const Robot& drawn, const truepose_model& model) {
  const int n = truepose_freedoms(&model), m = truepose_motors(&model),
            r = truepose_sensors(&model);
  const Coordinates x = numbers(bytes, drawn.home);
  truepose_real q[TRUEPOSE_MOTORS] = {}, back[TRUEPOSE_FREEDOMS] = {}, q_e[TRUEPOSE_READINGS] = {};
  truepose_real J[TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS] = {},
                                      tej[TRUEPOSE_MOTORS * TRUEPOSE_READINGS] = {};
  truepose_real serial[TRUEPOSE_MOTORS] = {};
  truepose_real parallel = 0;
  truepose_pose pose{};
  if (answered(truepose_ikm(&model, x.data(), q))) finite(q, m, "ikm: ok is finite");
  std::copy_n(drawn.home.begin(), 6, back);
  const truepose_fkm_result found = truepose_fkm(&model, q, 1 + bytes.below(20), back);
  if (answered(found.outcome)) finite(back, 6, "fkm: ok is finite");
  if (answered(truepose_readings(&model, x.data(), q_e)))
    finite(q_e, m + r, "readings: ok is finite");
  if (answered(truepose_jacobian(&model, x.data(), J)))
    finite(J, TRUEPOSE_FREEDOMS * TRUEPOSE_MOTORS, "jacobian: ok is finite");
  if (answered(truepose_tej(&model, x.data(), 0.05 * bytes.below(2), tej)))
    finite(tej, TRUEPOSE_MOTORS * TRUEPOSE_READINGS, "tej: ok is finite");
  if (answered(truepose_conditioning(&model, x.data(), &parallel, serial)))
    finite(serial, m, "conditioning: ok is finite");
  if (answered(truepose_pose_of(&model, x.data(), &pose))) {
    scribble(bytes, pose);
    if (answered(truepose_coordinates_of(&model, &pose, back)))
      finite(back, n, "coordinates: ok is finite");
    truepose_real angles[3] = {bytes.number(), bytes.number(), bytes.number()};
    if (answered(truepose_to_roll_pitch_yaw(pose.rotation, angles)))
      finite(angles, 3, "angles: ok is finite");
  }

  mechanisms::Prior prior(drawn);
  const auto known = c::converted<truepose_knowledge>(prior.known());
  const bool same = m == drawn.motors && r == drawn.r;  // columns and work are the drawn robot's
  std::vector<truepose_real> work(truepose_work(&model, known.count));
  truepose_control_settings control;
  truepose_control_defaults(&control);
  auto monitor = c::converted<truepose_fault_monitor_settings>(FaultMonitorSettings{});
  static_cast<void>(truepose_place_poles(&model, drawn.home.data(), 100, 1, &control));
  control.law = bytes.below(5);
  if (bytes.one_in(4)) scribble(bytes, control);
  if (bytes.one_in(4)) scribble(bytes, monitor);
  truepose_controller controller;
  truepose_fault_monitor fault_state;
  if (!answered(truepose_controller_init(&controller, sizeof controller, &control)) ||
      !answered(truepose_fault_monitor_init(&fault_state, sizeof fault_state, &monitor)) || !same)
    return;
  truepose_setpoint setpoint{};
  std::copy_n(drawn.home.begin(), 6, setpoint.x);
  for (int k = 0; k < 8; ++k) {
    truepose_real read[TRUEPOSE_READINGS], torque[TRUEPOSE_MOTORS] = {};
    const Extended off = numbers(bytes, Extended{});
    for (int c = 0; c < kMaxReadings; ++c) read[c] = q_e[c] + off[static_cast<std::size_t>(c)];
    if (bytes.one_in(4)) scribble(bytes, setpoint);
    truepose_fault_report report;
    static_cast<void>(truepose_control_fault_tolerant(&model, nullptr, &controller, &fault_state,
                                                      &setpoint, read, &known, work.data(), torque,
                                                      &report));
    finite(torque, m, "torques are finite");
    for (int i = 0; i < m; ++i)
      if (const double limit = drawn.chain[i].torque_limit; limit > 0 && std::isfinite(limit))
        require(std::fabs(torque[i]) <= limit, "torques are within their limits");
    if (bytes.one_in(4)) static_cast<void>(truepose_change_law(&controller, bytes.below(6)));
    if (bytes.one_in(8))
      static_cast<void>(truepose_fault_monitor_acknowledge(&fault_state, bytes.below(20) - 2));
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  Bytes bytes(data, size);
  const Subject subject = decode_robot(bytes);
  static truepose_description table;
  static truepose_model model;
  if (!subject.robot.finished) return 0;
  c::describe(subject.robot, table);
  if (bytes.one_in(2)) scribble(bytes, table);
  if (!answered(truepose_load(&model, sizeof model, &table))) {
    truepose_real q[TRUEPOSE_MOTORS];
    require(truepose_ikm(&model, table.home, q).status == TRUEPOSE_UNFINISHED,
            "a table that was refused answers nothing");
    return 0;
  }
  Robot loaded = subject.robot;
  for (int i = 0; i < loaded.chains; ++i)
    loaded.chain[i].torque_limit = table.chain[i].torque_limit;
  ask(bytes, loaded, model);
  return 0;
}
