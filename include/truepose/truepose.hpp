/// @file
/// The compiled library for controllers in C++20: the functions of truepose.h as methods.
/// Links truepose::truepose. Guide: docs/cpp.md.
///
/// Every method returns an Outcome; outputs are unchanged where it is false. Nothing allocates,
/// locks or throws. Units m, rad, s, kg, N, N·m; base frame.
#pragma once

#include <array>
#include <type_traits>

#include "truepose/sizes.hpp"
#include "truepose/status.hpp"
#include "truepose/truepose.h"

namespace truepose {
inline Outcome outcome_of(truepose_outcome from) { return from; }

/// Knowledge of a robot's geometry and readings, for laws that weigh, and their work space of
/// truepose_work() numbers. Default: none, for laws that do not weigh.
struct Weights {
  const truepose_knowledge* known = nullptr;
  Real* work = nullptr;
};

/// A robot from a constant table (`truepose export c`), checked. Copies are independent.
class Model {
 public:
  Model() : model_{} {}
  /// @return as truepose_load(); a refused model answers Status::unfinished
  Outcome load(const truepose_description& robot) {
    return truepose_load(&model_, sizeof model_, &robot);
  }
  /// For functions of truepose.h that have no method here.
  const truepose_model* c() const { return &model_; }
  int freedoms() const { return truepose_freedoms(&model_); }
  int motors() const { return truepose_motors(&model_); }
  int sensors() const { return truepose_sensors(&model_); }

  /// q = IKM(x); refuses poses beyond a stop or a singularity.
  Outcome ikm(const Coordinates& x, Joint& q) const {
    return truepose_ikm(&model_, x.data(), q.data());
  }
  /// The same for a pose. @param conditioning  out unless null: 0 (singular) to 1
  Outcome ikm(const truepose_pose& pose, Joint& q, Real* conditioning = nullptr) const {
    return truepose_ikm_pose(&model_, &pose, q.data(), conditioning);
  }
  /// x = FKM(q). @param x  in: a guess @param cap  iterations at most
  Outcome fkm(const Joint& q, Coordinates& x, int cap = 12) const {
    return truepose_fkm(&model_, q.data(), cap, x.data()).outcome;
  }
  /// All readings at a pose: {IKM(x), RKM(x)}.
  Outcome readings(const Coordinates& x, Extended& q_e) const {
    return truepose_readings(&model_, x.data(), q_e.data());
  }
  /// J by rows, dx = J dq.
  Outcome jacobian(const Coordinates& x, std::array<Joint, TRUEPOSE_FREEDOMS>& J) const {
    return truepose_jacobian(&model_, x.data(), J[0].data());
  }
  /// Extended-to-joint matrix by rows. @param band  conditioning below which J is damped
  Outcome tej(const Coordinates& x, std::array<Extended, TRUEPOSE_MOTORS>& tej,
              Real band = 0) const {
    return truepose_tej(&model_, x.data(), band, tej[0].data());
  }
  /// One servo cycle for drives that close their own loops: IKM, assembly mode, J, TEJ and ê.
  /// @param law  a truepose_law
  Outcome servo(truepose_law law, const Coordinates& x_d, const Extended& q_e,
                truepose_servo_cycle& cycle, Real band = 0, Weights weights = {}) const {
    return truepose_servo(&model_, law, band, x_d.data(), q_e.data(), weights.known, weights.work,
                          &cycle);
  }
  /// Pose of all readings by weighted least squares. @param x  in: a guess; out
  truepose_estimate_result estimate(const Extended& q_e, Weights weights, Coordinates& x) const {
    return truepose_estimate(&model_, weights.known, q_e.data(), weights.work, x.data());
  }
  /// Joint state of a platform on passive axes from its motors'. @param joints  in: a guess; out
  Outcome joint_state(const truepose_axis_state& motors, truepose_axis_state& joints,
                      int cap = 12) const {
    return truepose_joint_state(&model_, &motors, cap, &joints);
  }
  /// Motor command from a joint command, at the given state.
  Outcome motor_command(const truepose_axis_state& motors, const truepose_axis_state& joints,
                        const truepose_axis_command& wanted, truepose_axis_command& given) const {
    return truepose_motor_command(&model_, &motors, &joints, &wanted, &given);
  }

 private:
  truepose_model model_;
};

/// A controller with torques as output, with or without the fault monitor.
class Controller {
 public:
  /// @return as truepose_controller_init()
  Outcome begin(const truepose_control_settings& settings) {
    return truepose_controller_init(&controller_, sizeof controller_, &settings);
  }
  /// @return as truepose_fault_monitor_init()
  Outcome begin(const truepose_fault_monitor_settings& settings) {
    return truepose_fault_monitor_init(&monitor_, sizeof monitor_, &settings);
  }
  /// One servo cycle with the settings' law, for drives that close their own loops. A law that
  /// weighs caches its weights.
  Outcome servo(const Model& model, const Coordinates& x_d, const Extended& q_e,
                truepose_servo_cycle& cycle, Weights weights = {}) {
    return truepose_controller_servo(model.c(), &controller_, x_d.data(), q_e.data(), weights.known,
                                     weights.work, &cycle);
  }
  Outcome step(const Model& model, const truepose_setpoint& setpoint, const Extended& q_e,
               Joint& torque, Weights weights = {}) {
    return truepose_control(model.c(), &controller_, &setpoint, q_e.data(), weights.known,
                            weights.work, torque.data());
  }
  /// One cycle with the readings monitored. @param finest  model of the highest level
  Outcome step(const Model& model, const Model& finest, const truepose_setpoint& setpoint,
               const Extended& q_e, Joint& torque, truepose_fault_report& report,
               Weights weights = {}) {
    return truepose_control_fault_tolerant(model.c(), finest.c(), &controller_, &monitor_,
                                           &setpoint, q_e.data(), weights.known, weights.work,
                                           torque.data(), &report);
  }
  /// Changes the law from the next cycle on, without a step of the torque.
  Outcome change_law(truepose_law law) { return truepose_change_law(&controller_, law); }
  /// Marks a repaired reading as valid. @param reading  from 0
  Outcome acknowledge(int reading) {
    return truepose_fault_monitor_acknowledge(&monitor_, reading);
  }

 private:
  truepose_controller controller_{};
  truepose_fault_monitor monitor_{};
};
}  // namespace truepose
