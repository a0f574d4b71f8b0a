// What a C program has of a robot: its model, what is known of it, a controller, a fault monitor.
#pragma once

#include "../../src/c/controllers.hpp"
#include "controllers.hpp"
#include "truepose/truepose.hpp"

namespace mechanisms {

inline bool same(truepose_outcome a, Outcome b) {
  return a.status == static_cast<int>(b.status) && a.part == b.chain;
}

template <class Values>
bool same(const truepose_real* a, const Values& b) {
  return std::equal(b.begin(), b.end(), a);
}

/// The table in C of a robot, and of settings.
inline truepose_description in_c(const Robot& robot) {
  truepose_description table;
  c::describe(robot, table);
  return table;
}
template <class Core>
auto in_c(const Core& core) {
  return c::converted<typename c::Described<Core>::type>(core);
}

struct ModelInC {
  explicit ModelInC(const truepose_description& description) : table(description) {
    outcome = truepose_load(&model, sizeof model, &table);
  }
  explicit ModelInC(const Robot& robot) : ModelInC(in_c(robot)) {}
  operator const truepose_model*() const { return &model; }
  truepose_description table;
  truepose_model model;
  truepose_outcome outcome;
};

/// A prior, and the memory that estimates by it need.
struct KnownInC {
  explicit KnownInC(const Robot& robot) : prior(robot), work(estimate_work(robot, of.count)) {}
  operator const truepose_knowledge*() const { return &table; }
  Prior prior;
  const Knowledge& of = prior.known();
  truepose_knowledge table = c::converted<truepose_knowledge>(of);
  std::vector<truepose_real> work;
};

inline truepose_setpoint setpoint_in_c(const Coordinates& x) {
  truepose_setpoint setpoint{};
  std::copy_n(x.begin(), kMaxDof, setpoint.x);
  return setpoint;
}

inline truepose_controller controller_in_c(const truepose_control_settings& table) {
  truepose_controller controller;
  CHECK(same(truepose_controller_init(&controller, sizeof controller, &table), {}));
  return controller;
}

inline truepose_fault_monitor monitor_in_c(const FaultTolerantSettings& settings) {
  const auto table = in_c(settings.monitor);
  truepose_fault_monitor monitor;
  CHECK(same(truepose_fault_monitor_init(&monitor, sizeof monitor, &table), {}));
  return monitor;
}

}  // namespace mechanisms
