// Physical effects of the exact plant that the model omits: friction, compliance, backlash, ripple.
//
// Thermal growth, eccentric encoders and quantization are parameters of the true robot.
#pragma once

#include "control/supervisor.hpp"
#include "simulation/plant.hpp"

namespace truepose {
/// Effects; zero disables an effect.
struct Effects {
  double backlash = 0;        ///< full backlash of a geared platform angle's gear, rad of the angle
  Joint friction{};           ///< Coulomb friction at each motor, N·m or N
  double presliding = 1e-4;   ///< reversal distance of friction, rad or m of the motor
  double arm_stiffness = 0;   ///< of an arm at its root, N·m/rad (0: rigid)
  double arm_damping = 0.05;  ///< of the rotor against its arm, ratio
  double rod_stiffness = 0;   ///< of one rod along its axis, N/m (0: rigid)
  double ripple = 0;          ///< relative amplitude of a motor's torque ripple
  Joint phase{};              ///< of the ripple, rad
  bool delayed = false;       ///< a torque acts one cycle after its readings

  bool change_torque() const;
  bool give_way() const { return arm_stiffness > 0 || rod_stiffness > 0; }
};

inline constexpr double kRipples = 6;             ///< periods per turn of a motor
inline constexpr double kBrakeCloses = 0.02;      ///< closing time of a brake, s; assumed
inline constexpr double kBrakePresliding = 1e-3;  ///< of a closed brake, rad or m; assumed
inline constexpr double kBrakeDamping = 1e-3;     ///< s, by which it comes to rest; assumed
inline constexpr double kSlideGives = 1e-4;       ///< of that of a slide after engage(), m; assumed
inline constexpr int kCompliantSteps = 4;         ///< minimum per control period: rotors oscillate

/// A disturbance of the plant.
struct Event {
  Disturbance kind = Disturbance::payload;
  double begin = 0;                                      ///< s
  double end = std::numeric_limits<double>::infinity();  ///< s; of a contact
  int motor = 0;                                         ///< of friction
  double size = 0;      ///< mass at D, kg; or additional Coulomb friction, N·m or N
  Coordinates force{};  ///< of a contact, of the platform's coordinates, N and N·m
};

/// Dahl friction after a displacement: df/dq = (sgn dq - f)/presliding, exact solution. It depends
/// on the path only, not on time: a motor at rest stays, one that reverses lags. (P. R. Dahl, A
/// solid friction model, Aerospace Corporation TOR-0158, 1968.)
double dahl(double slip, double displacement, double presliding);

/// The true robot and its state: pose, rate, friction, rotors, gears.
class Plant {
 public:
  Plant(const Robot& truth, const Effects& effects, const Pose& start, std::uint64_t seed);

  const Pose& pose() const { return state_.pose; }

  /// Initialises the plant at rest under its own weight.
  Outcome rest();

  /// Applies the brakes requested as bits from kBrakeCloses on; others open. Each rubs with its
  /// motor's largest torque (assumed); without a torque limit it only holds its load.
  void brake(std::uint32_t motors, double period);

  /// Begins a disturbance. A contact lasts until its negative force is added.
  void disturb(const Event& event, double sign = 1);

  /// Closes all brakes of a robot at rest, which carry its weight.
  void engage();

  /// After engage(): applies brakes, as bits, that open and close after delays, s.
  void work_brakes(std::uint32_t motors, double period, double opens = kBrakeCloses,
                   double closes = kBrakeCloses);

  /// Advances one period under constant torque commands.
  /// @return unreachable or singular where the robot leaves its workspace
  Outcome advance(const Joint& torque, double period, int steps);

  /// Encoder readings of the deflected robot; a geared platform angle reads behind its gear.
  Outcome measure(Extended& q_e);

 private:
  /// Adds the motor torques that equal the contacts' force, Jᵀ f.
  void push(const Closure& closure, const DynamicModel& model, Joint& torque) const;

  double brake_torque(int i) const;

  bool springy(int i) const;

  /// Motor angle or slide from a reading, without correction of offset and eccentricity.
  double shaft(int i, double q) const { return q / truth_.chain[i].encoder_gain; }

  /// Torque transmitted to the arms, and the derivatives of the rotors' angles and rates.
  Joint transmitted(const Joint& q, const Joint& rate, const Joint& torque, const Rotors& y,
                    Rotors& dy);

  /// Applies the deflection of arms and (quasi-static) rods as geometry. The torque at an arm's
  /// root, minus the weight of arm and half its rods, equals the rods' tension T times J_q/L.
  Outcome bend(Robot& robot) const;

  const Robot& truth_;
  const int n;    ///< motors
  Robot driven_;  ///< without the inertia of rotors on elastic arms
  Effects effects_;
  PlantState state_;
  Parasitic rest_;  ///< start of the rods' next solution
  Joint rotor_{};   ///< rotor inertia
  Rotors rotors_{};
  Joint slip_{}, rubs_{};      ///< friction and brake, relative to their maxima, -1 to 1
  Coordinates force_{};        ///< of contacts
  bool pushed_ = false;        ///< it is not 0
  Joint closing_{}, brake_{};  ///< s since brakes were requested; their torque
  Joint brake_gives_{};        ///< presliding of brakes, rad or m
  std::uint32_t asked_ = 0;    ///< of work_brakes(): brakes as last requested,
  bool engaged_ = false;       ///< by engage()
  double clock_ = 0;           ///< s,
  Joint opens_{}, closes_{};   ///< and when they follow; 0: they have
  Joint transmitted_{};        ///< torque transmitted to the arms
  std::array<double, kMaxSensors> geared_{};  ///< far sides of geared sensors, as read
  Random random_;
};
}  // namespace truepose
