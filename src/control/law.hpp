// Control laws: motor errors from readings, the paper's three and two that weigh the readings.
//
// For a robot at the full level (Robot::level), desired readings, weights and estimate come from
// that level. J and the paper's TEJ, which only map errors to errors, and the dynamics stay ideal.
#pragma once

#include "control/redundant_fkm.hpp"
#include "estimation/cached_gain.hpp"

namespace truepose {
enum class Law : int {
  joint = 0,      ///< Figure 1: e_q = q_d - q
  tej = 1,        ///< Figure 2: ê_q = TEJ (q_de - q_e)
  cartesian = 2,  ///< closing remark: ê_q = J⁻¹ (x_d - x̂), x̂ of `redundant_fkm`
  weighted = 3,   ///< as tej, with the weighted TEJ (estimate.hpp)
  estimated = 4,  ///< as cartesian, x̂ from `estimate`: any mobility, any sensors
};

/// Errors that a law corrects.
enum class Corrects : int {
  motors = 0,    ///< e_q of the motors' own readings
  readings = 1,  ///< all readings, mapped by a TEJ (see `map_of`)
  pose = 2,      ///< x_d - x̂ (see `found_pose`), mapped by J⁻¹
};

/// Properties of a law.
struct LawProperties {
  Law law;
  const char* name;
  Corrects corrects;
  bool weighs = false;  ///< uses knowledge of the robot: needs Weighing, its highest level
  bool sensed = true;   ///< needs a redundant sensor in use: without one it is another law
};

/// In the order of Law. The only table of their properties, also for Python.
inline constexpr std::array kLawTable{
    LawProperties{
        .law = Law::joint, .name = "joint", .corrects = Corrects::motors, .sensed = false},
    LawProperties{Law::tej, "tej", Corrects::readings},
    LawProperties{Law::cartesian, "cartesian", Corrects::pose},
    LawProperties{
        .law = Law::weighted, .name = "weighted", .corrects = Corrects::readings, .weighs = true},
    LawProperties{
        .law = Law::estimated, .name = "estimated", .corrects = Corrects::pose, .weighs = true},
};  // the last row
static_assert(in_order(kLawTable, &LawProperties::law));

constexpr const LawProperties& properties(Law law) {
  return kLawTable[static_cast<std::size_t>(law)];
}

/// Inputs of laws that weigh, besides the robot. One per running controller: `work` is written to.
struct Weighing {
  const Knowledge* known = nullptr;  ///< about the robot's own parameter values
  Real* work = nullptr;              ///< estimate_work(robot, known->count) numbers
  CachedGain* kept = nullptr;        ///< cached from cycle to cycle; nullptr: no cache
  explicit operator bool() const { return known != nullptr && work != nullptr; }
};

/// The same, every reading's own σ times `scale`: see ControlSettings::sigma_scale.
class Scaled {
 public:
  Scaled(const Weighing& of, int scale) : weighing(of) {
    if (scale == 1 || of.known == nullptr) return;
    known_ = *of.known;
    for (Real& sigma : known_.sigma) sigma *= scale;
    weighing.known = &known_;
  }
  Scaled(const Scaled&) = delete;
  Scaled& operator=(const Scaled&) = delete;

  Weighing weighing;

 private:
  Knowledge known_;
};

/// Inputs of a law that depend on x_d alone: q_de, J, TEJ, q_d.
struct Reference {
  Closure closure;
  Jacobians jacobians;
  Extended q_e;  ///< q_de
  SensorRows jr;
  ExtendedColumns M;
  ExtendedRows tej;
  Pose pose;  ///< laws of the pose: x̂ of the readings q_de
};

/// As linearise(), at the reference's pose.
Outcome linearise(const Robot& robot, const Reference& reference, Extended& q_e, PoseRows& H_x,
                  Real* H_xi, Parasitic& rest);

/// The same with the weights at that pose: cached, or fresh beyond their validity radius.
/// @return singular where the motors alone do not determine the pose
Outcome linearise_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                       Extended& q_e, PoseRows& H_x, Parasitic& rest, CachedFusion& at);

/// Weighted TEJ at the reference's pose: M⁺ = (MᵀC⁻¹M)⁻¹MᵀC⁻¹, C at that pose or from the cache.
Outcome weigh(const Robot& robot, const Weighing& weighing, Parasitic& rest, Reference& reference);

/// q_de with every rod closing its own loop.
Outcome refer_full(const Robot& robot, Parasitic& rest, Reference& reference);

/// TEJ of a law of all readings.
Outcome map_of(const Robot& robot, Law law, const Weighing& weighing, Parasitic& rest,
               Reference& reference);

Outcome found_pose(const Robot& robot, Law law, const Pose& desired, const Extended& q_e,
                   Pose& found, const Weighing& weighing = {}, const Parasitic& nearby = {});

/// Computes a law's reference at x_d.
/// @param band      conditioning below which J and J⁻¹ are damped (0: never, the paper's law)
/// @param weighing  for the weighted law
/// @param nearby    null, or the full level's residual motion at the last x_d, then at this one
/// @return near_singular: J is damped; not_measured:
/// the law needs knowledge, or a redundant sensor in use, and there is none; joint_limit: a motor
/// would have to pass its stops; branch_lost: x_d is in another assembly mode than home (in the
/// band, where the modes meet, both are accepted)
inline Outcome refer(const Robot& robot, Law law, const Coordinates& x_d, Reference& reference,
                     Real band = 0, const Weighing& weighing = {}, Parasitic* nearby = nullptr) {
  if (robot.r == 0 && properties(law).sensed) return {Status::not_measured, -1};
  Parasitic unknown;
  Parasitic& rest = nearby ? *nearby : unknown;
  Outcome outcome = ikm(robot, to_pose(robot.mobility, x_d), reference.closure);
  if (outcome) outcome = within_limits(robot, reference.closure.pose, reference.closure.q());
  if (outcome) outcome = jacobian(reference.closure, band, reference.jacobians);
  const Outcome regular = outcome;
  Reading r;
  if (outcome) outcome = rkm(robot, reference.closure, r, reference.jr);
  // The motors would have to pass through a singularity to reach another mode.
  const bool modes_meet = regular.status == Status::near_singular && regular.chain < 0;
  if (outcome && !modes_meet && other_mode(robot.assembly_sign, reference.jacobians.sign))
    outcome = {Status::branch_lost, -1};
  if (!outcome) return outcome;
  extend(robot, reference.closure.q(), r, reference.q_e);
  reference.pose = reference.closure.pose;
  if (robot.rod_by_rod()) {
    outcome = refer_full(robot, rest, reference);
    // The ideal model's pose of q_e is compared with its pose of q_de: at x_d both agree.
    if (outcome && properties(law).corrects == Corrects::pose && !properties(law).weighs)
      outcome = found_pose(robot, law, reference.closure.pose, reference.q_e, reference.pose,
                           weighing, rest);
    if (!outcome) return outcome;
  }
  if (properties(law).corrects == Corrects::readings)
    outcome = map_of(robot, law, weighing, rest, reference);
  return outcome ? regular : outcome;
}

/// x̂ with cached weights: it solves HᵀC⁻¹(q_e - h) = 0 with the weights of its own pose. Far
/// from the reference they are computed anew.
Outcome find_kept(const Robot& robot, const Weighing& weighing, const Reference& reference,
                  const Extended& q_e, Pose& found, Parasitic rest);

/// x̂ of a law of the pose, near the desired pose. @param nearby  residual motion there
Outcome found_pose(const Robot& robot, Law law, const Pose& desired, const Extended& q_e,
                   Pose& found, const Weighing& weighing, const Parasitic& nearby);

/// Motor error under a law. @param found  out, laws of the pose only: x̂
inline Outcome motor_error(const Robot& robot, Law law, const Reference& reference,
                           const Extended& q_e, Joint& error, Pose& found,
                           const Weighing& weighing = {}, const Parasitic& nearby = {}) {
  const int n = dof(robot.mobility);
  const Corrects corrects = properties(law).corrects;
  if (corrects == Corrects::pose) {
    const Outcome outcome =
        properties(law).weighs && weighing.kept
            ? find_kept(robot, weighing, reference, q_e, found, nearby)
            : found_pose(robot, law, reference.closure.pose, q_e, found, weighing, nearby);
    if (outcome)
      error = reference.jacobians.joint_rate(difference(robot.mobility, reference.pose, found));
    return outcome;
  }
  std::array<Real, kMaxReadings> e_qe;
  for (int i = 0; i < n; ++i) e_qe[i] = reference.q_e[i] - q_e[i];
  if (corrects == Corrects::motors) {
    for (int i = 0; i < n; ++i) error[i] = e_qe[i];
  } else {
    for (int k = n; k < n + robot.r; ++k) e_qe[k] = reference.q_e[k] - q_e[k];
    for (int i = 0; i < n; ++i) {
      error[i] = 0;
      for (int c = 0; c < n + robot.r; ++c) error[i] += reference.tej[i][c] * e_qe[c];
    }
  }
  return {};
}

/// Outputs of a servo cycle.
struct ServoCycle {
  Joint q_d{};    ///< desired motor readings, at the robot's level
  Joint error{};  ///< ê_q
  JointMatrix J{};
  ExtendedRows tej{};  ///< laws of all readings only
  Coordinates x{};     ///< laws of the pose: the estimated one; else the desired one
};

/// One servo cycle for drives that close their own loops: IKM, assembly mode, J, TEJ, ê_q.
/// @param error  out: ê_q
/// @param band   conditioning below which J and J⁻¹ are damped (0: never)
/// @param kept   as `nearby` of refer()
/// @param cycle  out unless null
inline Outcome motor_error(const Robot& robot, Law law, const Coordinates& x_d, const Extended& q_e,
                           Joint& error, Real band = 0, const Weighing& weighing = {},
                           Parasitic* kept = nullptr, ServoCycle* cycle = nullptr) {
  const int n = dof(robot.mobility);
  const bool alone = properties(law).corrects == Corrects::motors;
  if (!all_finite(q_e, alone ? n : n + robot.r) || !all_finite(x_d, n))
    return Outcome{Status::not_finite, -1};
  Reference reference;
  Parasitic unknown;
  Parasitic& nearby = kept ? *kept : unknown;
  const Outcome regular = refer(robot, law, x_d, reference, band, weighing, &nearby);
  if (!regular) return regular;
  Pose found;
  Joint e{};
  Outcome outcome = motor_error(robot, law, reference, q_e, e, found, weighing, nearby);
  if (outcome && !all_finite(e, n)) outcome = {Status::not_finite, -1};
  if (!outcome) return outcome;
  error = e;
  if (cycle == nullptr) return regular;
  const Corrects corrects = properties(law).corrects;
  *cycle = {};
  cycle->x = corrects == Corrects::pose ? to_coordinates(robot.mobility, found) : x_d;
  cycle->error = e;
  for (int i = 0; i < n; ++i) {
    cycle->q_d[i] = reference.q_e[i];
    std::copy_n(reference.jacobians.J[i].begin(), n, cycle->J[i].begin());
    if (corrects == Corrects::readings)
      std::copy_n(reference.tej[i].begin(), n + robot.r, cycle->tej[i].begin());
  }
  return regular;
}
}  // namespace truepose
