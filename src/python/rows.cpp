// Functions over rows of arrays for Python: one table, without the interpreter's lock.
#include <cmath>
#include <string>

#include "calibration/bound.hpp"
#include "calibration/calibrate.hpp"
#include "control/command.hpp"
#include "control/fastest.hpp"
#include "control/trajectory.hpp"
#include "mechanism/angles_of.hpp"
#include "mechanism/gyro.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"
#include "simulation/plant.hpp"
#include "simulation/statics.hpp"
#include "simulation/stretch.hpp"

namespace truepose::python {
namespace {
/// What all rows of a call have in common.
struct Common {
  const Robot* robot = nullptr;
  const Known* known = nullptr;
  int n = 0, m = 0, e = 0;     ///< freedoms, motors, readings
  Level level = Level::ideal;  ///< the first flag
};

/// Arguments of a function over rows, of each kind in Python's order. None counts as not given.
struct Call : Common {
  std::vector<Rows> in;  ///< (N, width); one row where Python gives a vector
  std::vector<bool> flag;
  std::vector<double> number;
  std::vector<Shape> shapes;  ///< of the results' rows
};

/// One row of a call.
struct Row : Common {
  const Call& call;
  std::size_t i;
  const std::vector<double*>& out;

  template <class Vector>
  Vector of(std::size_t k) const {
    const Rows& rows = call.in[k];
    return row<Vector>(rows, rows.shape(0) == 1 ? 0 : i);
  }
  Coordinates x(std::size_t k = 0) const { return of<Coordinates>(k); }
  Pose pose(std::size_t k = 0) const { return to_pose(robot->mobility, x(k)); }
  Mat3 rotation(std::size_t k) const { return of<Mat3>(k).transpose(); }
  double* work() const { return scratch(estimate_work(*robot, known->view().count)).data(); }
  /// Writes the results: numbers, vectors, whole matrices, or the used parts of those; a pointer
  /// is of one that is already there.
  template <class... Values>
  Outcome give(Outcome outcome, const Values&... values) const {
    std::size_t m = 0;
    (write(m++, values), ...);
    return outcome;
  }
  template <class Values>
  void write(std::size_t m, const Values& values) const {
    const Shape& shape = call.shapes[m];
    double* to = out[m];
    if constexpr (std::is_same_v<Values, double>) {
      *to = values;
    } else if constexpr (requires { values[0][0]; }) {
      for (std::size_t line = 0; line < shape[0]; ++line)
        to = std::copy_n(values[line].begin(), shape[1], to);
    } else if constexpr (!std::is_pointer_v<Values>) {
      std::copy_n(values.data(), numbers(shape), to);
    }
  }
};

/// How many of a row's arrays and numbers the parameters so far have taken.
struct Taken {
  std::size_t in = 0, number = 0;
};

/// What a parameter of type P of a core function is at a row: the robot, the level, the next
/// array's row, as a pose of it, the next number, or room for a result.
template <class P, class T = std::remove_cvref_t<P>>
decltype(auto) argument(const Row& r, Taken& taken) {
  if constexpr (std::is_same_v<T, Robot>)
    return *r.robot;
  else if constexpr (std::is_same_v<T, Level>)
    return Level{r.level};
  else if constexpr (std::is_same_v<P, T&>)
    return T{};
  else if constexpr (std::is_same_v<T, double>)
    return double{r.call.number[taken.number++]};
  else if constexpr (std::is_same_v<T, Pose>)
    return r.pose(taken.in++);
  else
    return r.of<T>(taken.in++);
}

/// A core function by its parameters' types: constant ones are taken, the others are its results.
template <auto f>
Outcome of(const Row& r) {
  return [&]<class R, class... P>(R (*)(P...)) {
    Taken taken;
    std::tuple<decltype(argument<P>(r, taken))...> all{argument<P>(r, taken)...};
    Outcome outcome;
    if constexpr (std::is_void_v<R>)
      std::apply(f, all);
    else
      outcome = std::apply(f, all);
    std::size_t m = 0;
    const auto write = [&]<class Each>(const std::remove_reference_t<Each>& value) {
      if constexpr (!std::is_const_v<std::remove_reference_t<Each>> && std::is_reference_v<Each>)
        r.write(m++, value);
    };
    std::apply([&](const auto&... each) { (write.template operator()<P>(each), ...); }, all);
    return outcome;
  }(+f);
}

/// The function for both levels, of several of one name.
template <class X, class Result>
constexpr auto at_level(Outcome (*f)(Level, const Robot&, const X&, Result&)) {
  return f;
}

/// A function. `shapes` of its results' rows, a word each: n freedoms, m motors, e readings, r
/// sensors, p parameters, d = 2 m, h hidden motions, b bodies, l closures, g of a
/// registration; - a number.
struct RowFunction {
  const char* name;
  const char* shapes;
  Outcome (*at)(const Row&);
  std::size_t rows_per_thread = kRowsPerThread;
  std::size_t over = 0;  ///< which array's rows they are
};

const RowFunction kFunctions[] = {
    // Kinematics: (robot, x, full)
    {"ikm", "m",
     [](const Row& r) {
       const bool own_mode = r.call.flag.size() > 1 && r.call.flag[1];  // as valid for commands
       Joint q{};
       return r.give(
           own_mode ? command(r.level, *r.robot, r.x(), q) : ikm(r.level, *r.robot, r.x(), q), q);
     }},
    {"rkm", "r", of<at_level(rkm)>},
    {"fkm", "n",
     of<[](Level level, const Robot& robot, const Joint& q, const Coordinates& guess,
           Coordinates& x) {
       x = guess;
       return fkm(level, robot, q, x);
     }>},
    {"parasitic", "h", of<parasitic>},
    {"jacobian", "nm", of<at_level(jacobian)>},
    {"gyro", "3n", of<gyro>},
    {"redundant_fkm", "n",
     of<static_cast<Outcome (*)(const Robot&, const Extended&, Coordinates&)>(redundant_fkm)>},
    {"tej", "em me",
     of<[](const Robot& robot, const Coordinates& x, double band, ExtendedColumns& M,
           ExtendedRows& M_plus) { return tej(robot, x, M, M_plus, band); }>},
    {"conditioning", "- m", of<conditioning>},  // type 2, then type 1 of each chain
    {"linearise", "en ep",                      // H_x = [J⁻¹; J_r], and H_ξ in the core's own order
     [](const Row& r) {
       Extended q_e;
       PoseRows H_x;
       return r.give(linearise(r.level, *r.robot, r.pose(), q_e, H_x, r.out[1]), H_x, r.out[1]);
     }},
    // (robot, x, compliance, arms, force (N, 3), measured tension (N, m) or NaN, full): readings,
    // their derivatives by the compliances of every chain and then of every arm, tensions
    {"under_load", "e ed m",
     [](const Row& r) {
       const Load load{r.of<Vec3>(3), r.of<Joint>(4)};
       double* H_xi = scratch(r.e * parameter_count(*r.robot)).data();
       UnderLoad at;
       return r.give(
           under_load(r.level, *r.robot, r.pose(), r.of<Joint>(1), r.of<Joint>(2), load, H_xi, at),
           at.q_e, at.by_compliance, at.tension);
     }},
    {"skeleton", "m43",  // points P, B, A and c of every chain, for drawings
     [](const Row& r) {
       Closure closure;
       const Outcome outcome = ikm(*r.robot, r.pose(), closure);
       double* to = r.out[0];
       for (int k = 0; k < r.m && outcome; ++k) {
         const Vec3 P = r.robot->chain[k].base, B = P + closure.chain[k].p;
         for (const Vec3& point :
              {P, B, B - closure.chain[k].v, closure.placed().D + closure.chain[k].lever})
           to = std::copy_n(point.data(), 3, to);
       }
       return outcome;
     }},
    {"bodies", "b43 l23",  // of a mechanism: origin and axes of its bodies, ends of its closures
     [](const Row& r) {
       FullClosure closure;
       const Outcome outcome = ikm(*r.robot, r.pose(), closure);
       const engine::Mechanism& m = closure.built.mechanism;
       double *body = r.out[0], *end = r.out[1];
       for (int b = 0; b < m.bodies && outcome; ++b) {
         body = std::copy_n(closure.at.frame[b].p.data(), 3, body);
         body = std::copy_n(closure.at.frame[b].R.data(), 9, body);
       }
       for (int i = 0; i < m.closures && outcome; ++i)
         for (const Vec3& point : {closure.at.A[i], closure.at.B[i]})
           end = std::copy_n(point.data(), 3, end);
       return Outcome{outcome};
     }},
    {"fastest", "e", of<fastest>},
    // Orientations
    {"rotations", "33",
     of<[](const Vec3& vector, Mat3& columns) { columns = exp_so3(vector).transpose(); }>},
    {"rotation_vectors", "3",
     of<[](const Mat3& columns, Vec3& vector) { vector = log_so3(columns.transpose()); }>},
    {"frames", "44",  // (robot, x, tilt (N, 3): rotation not in x; with a θ, about x, y)
     [](const Row& r) {
       Pose pose;
       const Outcome outcome = placed(*r.robot, r.pose(), pose);
       Vec3 turn = r.of<Vec3>(1);
       if (turns_about_z(r.robot->mobility)) turn = tilt_keeping(pose.theta, turn.x(), turn.y());
       const Mat3 R = exp_so3(turn) * pose.R;
       for (int k = 0; k < 16; ++k) {
         const int line = k / 4, column = k % 4;
         r.out[0][k] = line == 3 ? column == 3 : column == 3 ? pose.D[line] : R(line, column);
       }
       return outcome;
     }},
    {"coordinates", "n",  // next to home
     of<[](const Robot& robot, const Vec3& D, const Mat3& columns, Coordinates& x) {
       x.fill(NAN);
       x = coordinates_of(robot, {D, columns.transpose(), 0}, x);
     }>},
    // Dynamics
    {"mass_matrix", "nn", of<mass_matrix>},
    {"inverse_dynamics", "m",
     of<static_cast<Outcome (*)(const Robot&, const Pose&, const Coordinates&, const Coordinates&,
                                Joint&)>(inverse_dynamics)>},
    {"acceleration", "n", of<forward_dynamics>},
    {"setpoint", "n n n",  // of a straight quintic move
     of<[](const Robot& robot, const Coordinates& from, const Coordinates& to, double duration,
           double time, Coordinates& x, Coordinates& rate, Coordinates& acceleration) {
       const Setpoint at = quintic(robot.mobility, from, to, duration, time);
       x = at.x, rate = at.rate, acceleration = at.acceleration;
     }>},
    {"advance", "n n",  // of the reduced model
     of<[](const Robot& robot, const Pose& x, const Coordinates& rate, const Joint& torque,
           double duration, double steps, Coordinates& to, Coordinates& fast) {
       PlantState state{x, rate};
       const Outcome outcome = advance(robot, torque, duration, static_cast<int>(steps), state);
       to = to_coordinates(robot.mobility, state.pose), fast = state.rate;
       return outcome;
     }>},
    // Readings and what is known: (robot, known, …)
    {"innovation", "e",
     of<static_cast<void (*)(const Robot&, const Extended&, const Extended&, Extended&)>(
         innovation)>},  // q_e less expected, without whole turns of a joint
    {"leakage", "ne",    // (robot, law, known, x): ∂x/∂q_e of the steady-state pose
     [](const Row& r) {
       const Weights weights(*r.robot, r.known);
       PoseColumns leak{};
       const Law law{static_cast<int>(r.call.number[0])};
       return r.give(leakage(*r.robot, law, r.x(), leak, weights), leak);
     }},
    {"estimate", "n nn -",  // (robot, known, q_e, guess, full)
     [](const Row& r) {
       Pose pose = r.pose(1);
       const Estimate found =
           estimate(r.level, *r.robot, r.known->view(), r.of<Extended>(0), pose, r.work());
       return r.give(found.outcome, to_coordinates(r.robot->mobility, pose), found.covariance,
                     found.chi2);
     },
     kFewRowsPerThread},
    // (robot, known, x, full, influence (N, e × count)), whose amounts are the last entries of the
    // knowledge: sensitivity of x to each reading's error; weighted TEJ
    {"gain", "ne me",
     [](const Row& r) {
       double* work = r.work();
       Fused fusion;
       const Rows* influence = r.call.in.size() > 1 ? &r.call.in[1] : nullptr;
       return r.give(fused(r.level, *r.robot, r.known->view(), r.pose(),
                           influences_at(*r.robot, influence, r.i), work,
                           work + r.e * parameter_count(*r.robot), fusion),
                     fusion.gain, fusion.tej);
     },
     kFewRowsPerThread},
    // (robot, base, marker, x, measured): expected tracker coordinates, measured minus expected,
    // derivatives by twist and registration, the factor on σ of θ
    {"seen", "n n nn ng -",
     [](const Row& r) {
       const Mobility mobility = r.robot->mobility;
       const Registration by{frame_of(r.call.in[0].data()), frame_of(r.call.in[1].data())};
       const Seen at = seen(mobility, by, r.pose(2));
       const double theta = std::atan2(at.Q(1, 0), at.Q(0, 0));
       return r.give({}, to_coordinates(mobility, {at.p, at.Q, theta}),
                     innovation(mobility, at, r.x(3).data()), at.H_x, at.H, at.blunt);
     },
     kRowsPerThread, 2},
};

nb::tuple call(const RowFunction& function, const nb::args& args) {
  Call with;
  for (nb::handle given : args) {
    if (given.is_none()) continue;
    if (nb::isinstance<Robot>(given)) {
      with.robot = nb::inst_ptr<Robot>(given);
    } else if (nb::isinstance<Known>(given)) {
      with.known = nb::inst_ptr<Known>(given);
    } else if (PyBool_Check(given.ptr())) {
      with.flag.push_back(given.is(nb::handle(Py_True)));
    } else if (PyFloat_Check(given.ptr()) || PyLong_Check(given.ptr())) {
      with.number.push_back(nb::cast<double>(given));
    } else {
      nb::object array = numpy("ascontiguousarray")(given, "double");
      if (nb::cast<int>(array.attr("ndim")) == 1) array = array.attr("reshape")(1, -1);
      with.in.push_back(nb::cast<Rows>(array));
    }
  }
  with.level = level(!with.flag.empty() && with.flag[0]);
  std::string letters = "g";
  std::vector<int> extents = {kRegistration};
  if (with.robot) {
    const Robot& robot = *with.robot;
    const int n = with.n = dof(robot.mobility), m = with.m = robot.motors;
    with.e = readings(robot);
    letters += "nmerpdhbl";
    extents.insert(extents.end(),
                   {n, m, with.e, robot.r, robot.finished ? parameter_count(robot) : 0, 2 * m,
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
      with.in.at(function.over).shape(0), with.shapes,
      [&](std::size_t i, const std::vector<double*>& out) {
        return function.at({with, with, i, out});
      },
      function.rows_per_thread);
}
}  // namespace

void bind_rows(nb::module_& m) {
  for (const RowFunction& function : kFunctions) {
    const std::string signature = std::string("def ") + function.name + "(*args) -> tuple";
    m.def(
        function.name, [&function](const nb::args& args) { return call(function, args); },
        nb::sig(signature.c_str()));
  }
}
}  // namespace truepose::python
