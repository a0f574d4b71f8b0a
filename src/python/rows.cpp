// Functions over rows of arrays for Python: one table, without the interpreter's lock.
#include <string>

#include "calibration/bound.hpp"
#include "calibration/calibrate.hpp"
#include "control/command.hpp"
#include "control/fastest.hpp"
#include "mechanism/angles_of.hpp"
#include "mechanism/gyro.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "simulation/plant.hpp"
#include "simulation/statics.hpp"
#include "simulation/stretch.hpp"

namespace truepose::python {
namespace {
/// Arguments of a function over rows, of each kind in Python's order. None counts as not given.
struct Call {
  const Robot* robot = nullptr;
  const Known* known = nullptr;
  std::vector<Rows> in;        ///< (N, width); one row where Python gives a vector
  std::vector<double> number;  ///< flags too; 0 where Python gives no more
  std::vector<Shape> shapes;   ///< of the results' rows
};

/// One row of a call, and how many of its arrays, numbers and results are already taken.
struct Row {
  const Call& call;
  std::size_t i;
  const Results& out;
  std::size_t in = 0, number = 0, results = 0;

  template <class Vector>
  Vector next() {
    return row<Vector>(call.in[in++], i);
  }

  /// Writes a number, a vector, a matrix, or the used parts of those.
  template <class Value>
  void write(const Value& value) {
    const Shape& shape = call.shapes[results];
    double* to = out[results++];
    if constexpr (requires { double{*value[0].begin()}; })
      for (std::size_t line = 0; line < shape[0]; ++line)
        to = std::copy_n(value[line].begin(), shape[1], to);
    else
      std::copy_n(reinterpret_cast<const double*>(&value), numbers(shape), to);
  }
  void write(const Mat3& R) { write(std::array{R.transpose()}); }
  void write(const Frame& frame) { write(numbers_of(frame)); }
};

/// What a parameter of type P of a core function is at a row: what all rows have in common, the
/// next number, the next array's row, as a pose, rotation or frame of it, or room for a result.
template <class P, class T = std::remove_cvref_t<P>>
decltype(auto) argument(Row& r) {
  if constexpr (std::is_same_v<T, Robot>)
    return *r.call.robot;
  else if constexpr (std::is_same_v<T, Knowledge>)
    return r.call.known->view();
  else if constexpr (std::is_same_v<T, double*>)
    return T{r.out[r.results++]};
  else if constexpr (std::is_same_v<P, T&>)
    return T{};
  else if constexpr (std::is_enum_v<T> || std::is_arithmetic_v<T>)
    return static_cast<T>(r.number < r.call.number.size() ? r.call.number[r.number++] : 0);
  else if constexpr (std::is_same_v<T, Pose>)
    return to_pose(r.call.robot->mobility, r.next<Coordinates>());
  else if constexpr (std::is_same_v<T, Mat3>)
    return r.next<Mat3>().transpose();
  else if constexpr (std::is_same_v<T, Frame>)
    return frame_of(r.next<std::array<double, 16>>().data());
  else if constexpr (std::is_same_v<T, Influences>)
    return r.in < r.call.in.size() ? influences_at(*r.call.robot, r.call.in[r.in++], r.i) : T{};
  else
    return r.next<T>();
}

/// A core function by its parameters' types. Those it writes to are its results, and so are what it
/// returns, and the rest of a tuple with an outcome.
template <auto f>
Outcome of(Row r) {
  return [&]<class R, class... P>(R (*)(P...)) {
    std::tuple<decltype(argument<P>(r))...> all{argument<P>(r)...};
    Outcome outcome;
    const auto write = [&](Outcome returned, const auto&... results) {
      outcome = returned;
      (r.write(results), ...);
    };
    if constexpr (requires(R returned) { std::get<Outcome>(returned); })
      std::apply(write, std::apply(f, all));
    else if constexpr (std::is_convertible_v<R, Outcome>)
      outcome = std::apply(f, all);
    else if constexpr (std::is_void_v<R>)
      std::apply(f, all);
    else
      r.write(std::apply(f, all));
    const auto each = [&]<class Each>(const std::remove_reference_t<Each>& value) {
      if constexpr (std::is_same_v<Each, std::remove_cvref_t<Each>&>) r.write(value);
    };
    std::apply([&](const auto&... value) { (each.template operator()<P>(value), ...); }, all);
    return outcome;
  }(+f);
}

/// The function for both levels, of several of one name.
template <class X, class Result>
constexpr auto at_level(Outcome (*f)(Level, const Robot&, const X&, Result&)) {
  return f;
}

/// A function. `shapes` of its results' rows, a word each: n freedoms, m motors, e readings,
/// p parameters, d = 2 m, h hidden motions, b bodies, l closures, g of a registration; - a number.
struct RowFunction {
  const char* name;
  const char* shapes;
  Outcome (*at)(Row);
  std::size_t rows_per_thread = kRowsPerThread;
};

const RowFunction kFunctions[] = {
    // Kinematics: (robot, x, full)
    {"ikm", "m",  // own_mode: as valid for commands
     of<[](Level level, const Robot& robot, Coordinates x, bool own_mode, Joint& q) {
       return own_mode ? command(level, robot, x, q) : ikm(level, robot, x, q);
     }>},
    {"extended", "e", of<[](Level level, const Robot& robot, Pose x, Extended& q_e) {
       return extended(level, robot, x, q_e);
     }>},
    {"fkm", "n",
     of<[](Level level, const Robot& robot, const Joint& q, const Coordinates& near,
           Coordinates& x) {
       x = near;
       return fkm(level, robot, q, x);
     }>},
    {"parasitic", "h", of<parasitic>},
    {"jacobian", "nm", of<at_level(jacobian)>},
    {"gyro", "3n", of<gyro>},
    {"redundant_fkm", "n",
     of<static_cast<Outcome (*)(const Robot&, const Extended&, Coordinates&)>(redundant_fkm)>},
    {"tej", "em me",
     of<[](const Robot& robot, Coordinates x, double band, ExtendedColumns& M,
           ExtendedRows& M_plus) { return tej(robot, x, M, M_plus, band); }>},
    {"conditioning", "- m", of<conditioning>},  // type 2, then type 1 of each chain
    {"linearise", "ep en",                      // H_ξ in the core's own order, H_x = [J⁻¹; J_r]
     of<[](Level level, const Robot& robot, Pose x, double* H_xi, PoseRows& H_x) {
       Extended q_e;
       return linearise(level, robot, x, q_e, H_x, H_xi);
     }>},
    // (robot, x, compliance, arms, force (N, 3), measured tension (N, m) or NaN, full): readings,
    // their derivatives by the compliances of every chain and then of every arm, tensions
    {"under_load", "e ed m",
     of<[](Level level, const Robot& robot, Pose x, Joint compliance, Joint arms, Vec3 force,
           Joint tension) {
       double* H_xi = scratch(readings(robot) * parameter_count(robot)).data();
       UnderLoad at;
       const Outcome outcome =
           under_load(level, robot, x, compliance, arms, {force, tension}, H_xi, at);
       return std::tuple(outcome, at.q_e, at.by_compliance, at.tension);
     }>},
    {"skeleton", "m43",  // points P, B, A and c of every chain, for drawings
     of<[](const Robot& robot, Pose x) {
       Closure at;
       const Outcome outcome = ikm(robot, x, at);
       std::array<std::array<Vec3, 4>, kMaxChains> points;
       for (int k : range(at.motors)) {
         const Vec3 P = robot.chain[k].base, B = P + at.chain[k].p;
         points[k] = {P, B, B - at.chain[k].v, at.placed().D + at.chain[k].lever};
       }
       return std::tuple(outcome, points);
     }>},
    {"bodies", "b43 l3 l3",  // of a mechanism: origin and axes of its bodies, ends of its closures
     of<[](const Robot& robot, Pose x) {
       FullClosure closure;
       const Outcome outcome = ikm(robot, x, closure);
       std::array<std::array<Vec3, 4>, engine::kBodies> bodies;
       for (int b : range(engine::kBodies)) {
         const auto& [p, R, twist] = closure.at.frame[b];
         bodies[b] = {p, R.col(0), R.col(1), R.col(2)};
       }
       return std::tuple(outcome, bodies, closure.at.A, closure.at.B);
     }>},
    {"fastest", "e", of<fastest>},
    // Orientations
    {"rotations", "33", of<exp_so3>},
    {"rotation_vectors", "3", of<log_so3>},
    {"frames", "44",  // (robot, x, tilt (N, 3): rotation not in x; with a θ, about x, y)
     of<[](const Robot& robot, Pose x, Vec3 tilt) {
       const Outcome outcome = placed(robot, x, x);
       if (turns_about_z(robot.mobility)) tilt = tilt_keeping(x.theta, tilt.x(), tilt.y());
       return std::tuple(outcome, Frame{x.D, exp_so3(tilt) * x.R});
     }>},
    {"coordinates", "n",  // next to home
     of<[](const Robot& robot, Vec3 D, Mat3 R) {
       Coordinates unknown;
       unknown.fill(NAN);
       return coordinates_of(robot, {D, R, 0}, unknown);
     }>},
    // Dynamics
    {"mass_matrix", "nn", of<mass_matrix>},
    {"inverse_dynamics", "m",
     of<static_cast<Outcome (*)(const Robot&, const Pose&, const Coordinates&, const Coordinates&,
                                Joint&)>(inverse_dynamics)>},
    {"acceleration", "n", of<forward_dynamics>},
    {"advance", "n n",  // of the reduced model
     of<[](const Robot& robot, Pose x, Coordinates rate, Joint torque, double duration, int steps) {
       PlantState state{x, rate};
       const Outcome outcome = advance(robot, torque, duration, steps, state);
       return std::tuple(outcome, to_coordinates(robot.mobility, state.pose), state.rate);
     }>},
    // Readings and what is known: (robot, known, …)
    {"innovation", "e",
     of<static_cast<void (*)(const Robot&, const Extended&, const Extended&, Extended&)>(
         innovation)>},  // q_e less expected, without whole turns of a joint
    {"readings", "e",    // exact readings of a mechanism at a pose with these motors and arms
     of<[](const Robot& robot, Frame at, decltype(FullPose::psi) psi, double theta, Joint motor,
           Joint arm, Extended& q_e) {
       return read_standing(robot, {{at.t, at.R, theta}, psi}, motor, arm, q_e);
     }>},
    {"leakage", "ne",  // (robot, law, known, x): ∂x/∂q_e of the steady-state pose
     [](Row r) {
       PoseColumns leak{};
       const Law law = argument<Law>(r);
       const Outcome outcome = leakage(*r.call.robot, law, r.next<Coordinates>(), leak,
                                       Weights(*r.call.robot, r.call.known));
       r.write(leak);
       return outcome;
     }},
    {"estimate", "n nn -",  // (robot, known, q_e, guess, full)
     of<[](Level level, const Robot& robot, const Knowledge& known, Extended q_e, Pose x) {
       double* work = scratch(estimate_work(robot, known.count)).data();
       const Estimate found = estimate(level, robot, known, q_e, x, work);
       return std::tuple(found.outcome, to_coordinates(robot.mobility, x), found.covariance,
                         found.chi2);
     }>,
     kFewRowsPerThread},
    // (robot, known, x, full, influence (N, e × count)), whose amounts are the last entries of the
    // knowledge: sensitivity of x to each reading's error; weighted TEJ
    {"gain", "ne me",
     of<[](Level level, const Robot& robot, const Knowledge& known, Pose x, Influences acting) {
       double* work = scratch(estimate_work(robot, known.count)).data();
       Fused at;
       const Outcome outcome = fused(level, robot, known, x, acting, work,
                                     work + readings(robot) * parameter_count(robot), at);
       return std::tuple(outcome, at.gain, at.tej);
     }>,
     kFewRowsPerThread},
    // (robot, base, marker, x, measured): expected tracker coordinates, measured minus expected,
    // derivatives by twist and registration, the factor on σ of θ
    {"seen", "n n nn ng -",
     of<[](const Robot& robot, Frame base, Frame marker, Pose x, Coordinates measured) {
       const Mobility mobility = robot.mobility;
       const Seen at = seen(mobility, {base, marker}, x);
       const double theta = atan2(at.Q(1, 0), at.Q(0, 0));
       return std::tuple(Outcome{}, to_coordinates(mobility, {at.p, at.Q, theta}),
                         innovation(mobility, at, measured.data()), at.H_x, at.H, at.blunt);
     }>},
};

nb::tuple call(const RowFunction& function, const nb::args& args) {
  Call with;
  std::size_t count = 1;
  for (nb::handle given : args) {
    if (given.is_none()) continue;
    if (nb::isinstance<Robot>(given)) {
      with.robot = nb::inst_ptr<Robot>(given);
    } else if (nb::isinstance<Known>(given)) {
      with.known = nb::inst_ptr<Known>(given);
    } else if (PyFloat_Check(given.ptr()) || PyLong_Check(given.ptr())) {
      with.number.push_back(nb::cast<double>(given));
    } else {
      nb::object array = numpy("ascontiguousarray")(given, "double");
      if (nb::cast<int>(array.attr("ndim")) == 1) array = array.attr("reshape")(1, -1);
      with.in.push_back(nb::cast<Rows>(array));
      if (count == 1) count = with.in.back().shape(0);
    }
  }
  std::string letters = "g";
  std::vector<int> extents = {kRegistration};
  if (with.robot) {
    const Robot& robot = *with.robot;
    const int n = dof(robot.mobility), m = robot.motors;
    letters += "nmepdhbl";
    extents.insert(extents.end(),
                   {n, m, readings(robot), robot.finished ? parameter_count(robot) : 0, 2 * m,
                    robot.full.own() ? 6 - n + robot.full.bars : 0, robot.mechanism.bodies,
                    robot.mechanism.closures});
  }
  with.shapes.resize(1);
  for (const char letter : std::string(function.shapes)) {
    const std::size_t known = letters.find(letter);
    if (letter == ' ')
      with.shapes.emplace_back();
    else if (letter != '-')
      with.shapes.back().push_back(known < letters.size() ? extents[known] : letter - '0');
  }
  return batch(
      count, with.shapes,
      [&](std::size_t i, const Results& out) { return function.at({with, i, out}); },
      function.rows_per_thread);
}
}  // namespace

void bind_rows(nb::module_& m) {
  for (const RowFunction& function : kFunctions)
    m.def(function.name, [&function](const nb::args& args) { return call(function, args); });
}
}  // namespace truepose::python
