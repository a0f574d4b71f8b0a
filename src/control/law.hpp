// Control laws: motor errors from readings, the paper's three and two that weigh the readings.
//
// For a robot at the full level (Robot::level), desired readings, weights and estimate come from
// that level. J and the paper's TEJ, which only map errors to errors, and the dynamics stay ideal.
#pragma once

#include "control/redundant_fkm.hpp"
#include "estimation/cached_gain.hpp"

namespace truepose {
enum class Law : int {
  joint = 0,      ///< Figure 1: e_q = q_d - q; more motors than freedoms: K J (q_d - q)
  tej = 1,        ///< Figure 2: ê_q = TEJ (q_de - q_e)
  cartesian = 2,  ///< closing remark: ê_q = K (x_d - x̂), K = J⁻¹, x̂ of `redundant_fkm`
  weighted = 3,   ///< as tej, with the weighted TEJ (estimate.hpp)
  estimated = 4,  ///< as cartesian, x̂ from `estimate`: any mobility, any sensors
};

/// Errors that a law corrects.
enum class Corrects : int {
  motors = 0,    ///< e_q of the motors' own readings
  readings = 1,  ///< all readings, mapped by a TEJ (see `refer`)
  pose = 2,      ///< x_d - x̂ (of `redundant_fkm` or `search_pose`), mapped by J⁻¹
};

/// Properties of a law.
struct LawProperties {
  Law law;
  const char* name;
  Corrects corrects;
  bool weighs = false;  ///< uses knowledge of the robot: needs Weighing, its highest level
  bool sensed = true;   ///< needs a redundant reading: without one it is another law
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

constexpr const LawProperties& properties(Law law) { return kLawTable[std::size_t(law)]; }

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
  ExtendedRows tej;
  Pose pose;           ///< laws of the pose: x̂ of the readings q_de
  Parasitic rest;      ///< residual motion at x_d, and the steps left to the cycle
  PoseRows H_x;        ///< laws that weigh: at x_d; without cached weights, `work` has H_ξ there
  std::uint64_t mark;  ///< fingerprint of robot and knowledge; 0: no cache
  bool cached;         ///< the cached weights are valid at x_d
};

/// What a controller keeps for its next cycle.
struct Nearby : Parasitic {
  PoseSearch search;  ///< for x̂
};

/// Computes a law's reference at x_d.
/// @param band      conditioning below which J and J⁻¹ are damped (0: never, the paper's law)
/// @param weighing  for laws that weigh; its `work` stays as it is until motor_error
/// @param nearby    null, or the full level's residual motion at the last x_d, then at this one
/// @return near_singular: J is damped; not_measured: the law needs knowledge, or a redundant
/// reading, and there is none; joint_limit: a motor would have to pass its stops; branch_lost: x_d
/// is in another assembly mode than home (in the band, where the modes meet, both are accepted)
Outcome refer(const Robot& robot, Law law, const Coordinates& x_d, Reference& reference,
              Real band = 0, const Weighing& weighing = {}, Parasitic* nearby = nullptr);

/// Motor error under a law.
/// @param found   out, laws of the pose only: x̂
/// @param search  null, or where that for x̂ starts, then where the next one does
Outcome motor_error(const Robot& robot, Law law, const Reference& reference, const Extended& q_e,
                    Joint& error, Pose& found, const Weighing& weighing = {},
                    PoseSearch* search = nullptr);

/// Outputs of a servo cycle.
struct ServoCycle {
  Joint q_d{};    ///< desired motor readings, at the robot's level
  Joint error{};  ///< ê_q
  JointMatrix J{};
  ExtendedRows tej{};  ///< laws of all readings only
  Coordinates x{};     ///< laws of the pose: the estimated one; else the desired one
};

/// One servo cycle for drives that close their own loops: IKM, assembly mode, J, TEJ, ê_q.
/// @param cycle  out; unchanged without an answer
/// @param band   conditioning below which J and J⁻¹ are damped (0: never)
/// @param kept   null, or what a controller keeps: it then takes at most cycle_steps()
Outcome servo_cycle(const Robot& robot, Law law, const Coordinates& x_d, const Extended& q_e,
                    ServoCycle& cycle, Real band = 0, const Weighing& weighing = {},
                    Nearby* kept = nullptr);
}  // namespace truepose
