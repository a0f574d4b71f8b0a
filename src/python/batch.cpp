// Batch kinematics for Python, without the interpreter's lock. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include "control/command.hpp"
#include "mechanism/gyro.hpp"
#include "python/arrays.hpp"
#include "python/for_rows.hpp"
#include "simulation/assembly.hpp"
#include "simulation/stretch.hpp"

namespace truepose::python {
namespace {
// `full` selects the level of the model: full or ideal.

/// `own_mode`: only poses of the robot's own assembly mode, as valid for commands.
auto batch_ikm(const Robot& robot, const Rows& x, bool full, bool own_mode) {
  using Model = Outcome (*)(const Robot&, const Coordinates&, Joint&);
  const Model model = own_mode ? (full ? Model(&command_full) : Model(&command))
                      : full   ? Model(&ikm_full)
                               : Model(&ikm);
  return map_rows<Coordinates, Joint>(
      x, x.shape(1),
      [&](const Coordinates& at, Joint& q, std::size_t) { return model(robot, at, q); });
}

auto batch_rkm(const Robot& robot, const Rows& x, bool full) {
  return map_rows<Coordinates, Reading>(x, robot.r,
                                        [&](const Coordinates& at, Reading& r, std::size_t) {
                                          return full ? rkm_full(robot, at, r) : rkm(robot, at, r);
                                        });
}

auto batch_parasitic(const Robot& robot, const Rows& x) {
  const std::size_t n = x.shape(1), rest = robot.full.own() ? 6 - n + robot.full.bars : 0;
  return map_rows<Coordinates, Coordinates>(
      x, rest, [&](const Coordinates& at, Coordinates& turns, std::size_t) {
        return parasitic(robot, at, turns);
      });
}

auto batch_fkm(const Robot& robot, const Rows& q, const Rows& guess, bool full) {
  return map_rows<Joint, Coordinates>(
      q, q.shape(1), [&](const Joint& motors, Coordinates& x, std::size_t i) -> Outcome {
        x = row<Coordinates>(guess, i);
        return full ? fkm_full(robot, motors, x) : fkm(robot, motors, x);
      });
}

/// Poses that close the loops at q, (m, n), and the number of searches that ended at each, (m,).
auto assembly_modes(const Robot& robot, const Joint& q, int starts, std::uint64_t seed) {
  std::vector<Pose> pose = random_starts(robot, q, starts, seed);
  std::vector<char> closed(pose.size());
  for_rows(pose.size(), [&](std::size_t i) { closed[i] = closes(search(robot, q, pose[i])); });
  std::vector<Pose> found;
  for (std::size_t i = 0; i < pose.size(); ++i)
    if (closed[i]) found.push_back(pose[i]);
  const std::vector<AssemblyMode> modes = distinct_modes(robot, std::move(found));
  const std::size_t n = dof(robot.mobility), count = modes.size();
  Owned<double> x({count, n});
  Owned<int> seen({count});
  for (std::size_t k = 0; k < count; ++k) {
    std::copy_n(to_coordinates(robot.mobility, modes[k].pose).begin(), n, x[k]);
    *seen[k] = modes[k].seen;
  }
  return together(x, seen);
}

auto batch_jacobian(const Robot& robot, const Rows& x, bool full) {
  const std::size_t n = x.shape(1);
  return batch(x.shape(0), {{n, n}}, [&](std::size_t i, auto& out) {
    JointMatrix J;
    const Coordinates at = row<Coordinates>(x, i);
    const Outcome outcome = full ? jacobian_full(robot, at, J) : jacobian(robot, at, J);
    write(J, n, n, out[0]);
    return outcome;
  });
}

/// W, (N, 3, n).
auto batch_gyro(const Robot& robot, const Rows& x) {
  const std::size_t n = x.shape(1);
  return batch(x.shape(0), {{3, n}}, [&](std::size_t i, auto& out) {
    GyroRows W;
    const Outcome outcome = gyro(robot, row<Coordinates>(x, i), W);
    write(W, 3, n, out[0]);
    return outcome;
  });
}

/// H_x = [J⁻¹; J_r], (N, n + r, n), and H_ξ in the core's own order, (N, n + r, p).
auto batch_linearise(const Robot& robot, const Rows& x, bool full) {
  const std::size_t n = x.shape(1), e = n + robot.r, p = parameter_count(robot);
  const bool exists = !full || robot.full.own() || robot.full.kind == FullKind::same;
  return batch(x.shape(0), {{e, n}, {e, p}}, [&](std::size_t i, auto& out) -> Outcome {
    if (!exists) return {Status::no_full_level, -1};
    Extended q_e;
    PoseRows H_x;
    Parasitic rest;
    const Pose pose = to_pose(robot.mobility, row<Coordinates>(x, i));
    const Outcome outcome = linearise(level(full), robot, pose, q_e, H_x, out[1], rest);
    write(H_x, e, n, out[0]);
    return outcome;
  });
}

/// Under load: readings, (N, n + r), their derivatives by the compliances of every chain and then
/// of every arm, (N, n + r, 2 n), and the tension of every chain, (N, n).
/// @param force    on the platform's reference point, (N, 3)
/// @param tension  measured, (N, n), NaN where missing
auto batch_under_load(const Robot& robot, const Rows& x, const Joint& compliance, const Joint& arms,
                      const Rows& force, const Rows& tension, bool full) {
  const std::size_t n = x.shape(1), e = n + robot.r;
  return batch(x.shape(0), {{e}, {e, 2 * n}, {n}}, [&](std::size_t i, auto& out) {
    Load load{Vec3(force(i, 0), force(i, 1), force(i, 2)), row<Joint>(tension, i)};
    UnderLoad at;
    const Pose pose = to_pose(robot.mobility, row<Coordinates>(x, i));
    const Outcome outcome = under_load(level(full), robot, pose, compliance, arms, load,
                                       scratch(e * parameter_count(robot)).data(), at);
    std::copy_n(at.q_e.begin(), e, out[0]);
    for (std::size_t c = 0; c < e; ++c)
      for (std::size_t k = 0; k < n; ++k) {
        out[1][2 * n * c + k] = at.by_compliance[c][k];
        out[1][2 * n * c + n + k] = c == k ? at.by_arm[k] : 0;
      }
    std::copy_n(at.tension.begin(), n, out[2]);
    return outcome;
  });
}

/// Points P, B, A and c of every chain at one pose, (n, 4, 3), for drawings.
auto skeleton(const Robot& robot, const Coordinates& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> points({n, 4, 3});
  Closure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  for (std::size_t i = 0; i < n && outcome; ++i) {
    const Vec3 P = robot.chain[i].base, B = P + closure.chain[i].p, A = B - closure.chain[i].v;
    const Vec3 C = closure.placed().D + closure.chain[i].lever;
    int k = 0;
    for (const Vec3& point : {P, B, A, C})
      for (int axis = 0; axis < 3; ++axis) points[i][k++] = point[axis];
  }
  return answered(outcome, points.release());
}

/// J_x at a pose, (n, n).
auto rod_rows(const Robot& robot, const Coordinates& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> rows({n, n});
  Closure closure;
  const Outcome outcome = ikm(robot, to_pose(robot.mobility, x), closure);
  for (std::size_t i = 0; i < n; ++i) {
    std::fill_n(rows[i], n, 0.0);
    if (outcome) jx_row(closure.carried, closure.chain[i].v, closure.chain[i].lever, rows[i]);
  }
  return nb::make_tuple(rows.release(), static_cast<int>(outcome.status));
}

/// The same at home for every rod, (rods, freedoms); requires robot.full.
auto full_rod_rows(const Robot& robot) {
  const std::size_t rods = robot.full.rods, unknowns = robot.full.unknowns;
  Owned<double> result({rods, unknowns});
  std::array<engine::Row, engine::kClosures> rows;
  const Outcome outcome = full_rows(robot, rows);
  if (!outcome) throw nb::value_error(describe(outcome.status));
  for (std::size_t rod = 0; rod < rods; ++rod)
    std::memcpy(result[rod], rows[rod].data(), unknowns * sizeof(double));
  return result.release();
}

double rod_shortfall(const Robot& robot, const Coordinates& x, int chain) {
  const Pose pose = placed(robot, to_pose(robot.mobility, x));
  const Chain& of = robot.chain.at(chain);
  return shortfall(of, pose.D + pose.R * of.pivot + of.anchor - of.base);
}
}  // namespace

void bind_batch(nb::module_& m) {
  m.def("ikm", &batch_ikm, nb::arg("robot"), nb::arg("x"), nb::arg("full"),
        nb::arg("own_mode") = false);
  m.def("rkm", &batch_rkm);
  m.def("fkm", &batch_fkm);
  m.def("assembly_modes", &assembly_modes);
  m.def("parasitic", &batch_parasitic);
  m.def("jacobian", &batch_jacobian);
  m.def("gyro", &batch_gyro);
  m.def("linearise", &batch_linearise);
  m.def("under_load", &batch_under_load);
  m.def("skeleton", &skeleton);
  m.def("rod_rows", &rod_rows);
  m.def("full_rod_rows", &full_rod_rows);
  m.def("shortfall", &rod_shortfall);
  m.def("stop", [](int more) { stopping += more; });
}
}  // namespace truepose::python
