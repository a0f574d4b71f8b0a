// Batch kinematics for Python, without the interpreter's lock. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "truepose/kernels.hpp"
#include "truepose/kinematics/gyro.hpp"
#include "truepose/offline/assembly.hpp"
#include "truepose/offline/stretch.hpp"

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
  const std::size_t count = q.shape(0), n = q.shape(1);
  Owned<double> x({count, n}), residual({count});
  Owned<int> iterations({count});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    Coordinates pose = row<Coordinates>(guess, i);
    const Joint motors = row<Joint>(q, i);
    const FkmResult result = full ? fkm_full(robot, motors, pose) : fkm(robot, motors, pose);
    if (!result) pose.fill(NAN);
    std::memcpy(x[i], pose.data(), n * sizeof(double));
    outcomes.set(i, {result.status, result.chain});
    *iterations[i] = result.iterations;
    *residual[i] = result.residual;
  });
  return nb::make_tuple(x.release(), outcomes.status.release(), outcomes.chain.release(),
                        iterations.release(), residual.release());
}

/// Poses that close the loops at q, (m, n), and the number of searches that ended at each, (m,).
auto assembly_modes(const Robot& robot, const Joint& q, int starts, std::uint64_t seed) {
  const std::size_t n = dof(robot.mobility);
  std::vector<Pose> pose = random_starts(robot, q, starts, seed);
  std::vector<char> closed(pose.size());
  for_rows(pose.size(), [&](std::size_t i) {
    closed[i] = with_mobility(robot.mobility,
                              [&](auto K) { return closes(search<K()>(robot, q, pose[i])); });
  });
  std::size_t count = 0;
  for (std::size_t i = 0; i < pose.size(); ++i)
    if (closed[i]) pose[count++] = pose[i];
  pose.resize(count);
  const AssemblyModes modes = distinct_modes(robot, std::move(pose));
  Owned<double> x({modes.pose.size(), n});
  Owned<int> seen({modes.pose.size()});
  for (std::size_t k = 0; k < modes.pose.size(); ++k) {
    std::memcpy(x[k], to_coordinates(robot.mobility, modes.pose[k]).data(), n * sizeof(double));
    *seen[k] = modes.seen[k];
  }
  return nb::make_tuple(x.release(), seen.release());
}

auto batch_jacobian(const Robot& robot, const Rows& x, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1);
  Owned<double> values({count, n, n});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    JointMatrix J;
    const Coordinates at = row<Coordinates>(x, i);
    const Outcome outcome = full ? jacobian_full(robot, at, J) : jacobian(robot, at, J);
    outcomes.set(i, outcome);
    write(J, n, n, outcome, values[i]);
  });
  return nb::make_tuple(values.release(), outcomes.status.release(), outcomes.chain.release());
}

/// W, (N, 3, n).
auto batch_gyro(const Robot& robot, const Rows& x) {
  const std::size_t count = x.shape(0), n = x.shape(1);
  Owned<double> values({count, 3, n});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    GyroRows W;
    const Outcome outcome = gyro(robot, row<Coordinates>(x, i), W);
    outcomes.set(i, outcome);
    write(W, 3, n, outcome, values[i]);
  });
  return nb::make_tuple(values.release(), outcomes.status.release(), outcomes.chain.release());
}

/// H_x = [J⁻¹; J_r], (N, n + r, n), and H_ξ in the core's own order, (N, n + r, p).
auto batch_linearise(const Robot& robot, const Rows& x, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  const std::size_t p = parameter_count(robot);
  Owned<double> h_x({count, e, n}), h_xi({count, e, p});
  Outcomes outcomes(count);
  const Kernels model = kernels(robot.mobility, full);
  const bool exists = !full || robot.full.own() || robot.full.kind == FullKind::same;
  for_rows(count, [&](std::size_t i) {
    Extended q_e;
    PoseRows H_x;
    Parasitic rest;
    const Pose pose = to_pose(robot.mobility, row<Coordinates>(x, i));
    const Outcome outcome = exists ? model.linearise(robot, pose, q_e, H_x, h_xi[i], rest)
                                   : Outcome{Status::no_full_level, -1};
    outcomes.set(i, outcome);
    write(H_x, e, n, outcome, h_x[i]);
    if (!outcome) std::fill_n(h_xi[i], e * p, NAN);
  });
  return nb::make_tuple(h_x.release(), h_xi.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// Under load: readings, (N, n + r), their derivatives by every chain's compliance, (N, n + r, n),
/// and the tension of every chain, (N, n).
/// @param force    on the platform's reference point, (N, 3)
/// @param tension  measured, (N, n), NaN where missing
auto batch_under_load(const Robot& robot, const Rows& x, const Joint& compliance, const Rows& force,
                      const Rows& tension, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  Owned<double> q_e({count, e}), by({count, e, n}), pulled({count, n});
  Outcomes outcomes(count);
  const Kernels model = kernels(robot.mobility, full);
  for_rows(count, [&](std::size_t i) {
    Load load;
    load.force = Vec3(force(i, 0), force(i, 1), force(i, 2));
    std::copy_n(tension.data() + i * n, n, load.tension.begin());
    UnderLoad at;
    at.q_e.fill(NAN), at.tension.fill(NAN);
    const Pose pose = to_pose(robot.mobility, row<Coordinates>(x, i));
    const Outcome outcome = under_load(robot, model, full, pose, compliance, load,
                                       scratch(e * parameter_count(robot)).data(), at);
    outcomes.set(i, outcome);
    std::copy_n(at.q_e.begin(), e, q_e[i]);
    std::copy_n(at.tension.begin(), n, pulled[i]);
    write(at.by_compliance, e, n, outcome, by[i]);
  });
  return nb::make_tuple(q_e.release(), by.release(), pulled.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// Points P, B, A and c of every chain at one pose, (n, 4, 3), for drawings.
auto skeleton(const Robot& robot, const Coordinates& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> points({n, 4, 3});
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    Closure<mobility()> closure;
    const Outcome result = ikm<mobility()>(robot, to_pose<mobility()>(x), closure);
    for (std::size_t i = 0; i < n && result; ++i) {
      const Vec3 P = robot.chain[i].base(), B = P + closure.chain[i].p, A = B - closure.chain[i].v;
      const Vec3 C = closure.placed().D + closure.chain[i].lever;
      int k = 0;
      for (const Vec3& point : {P, B, A, C})
        for (int axis = 0; axis < 3; ++axis) points[i][k++] = point[axis];
    }
    return result;
  });
  return nb::make_tuple(points.release(), static_cast<int>(outcome.status), outcome.chain);
}

/// J_x at a pose, (n, n).
auto rod_rows(const Robot& robot, const Coordinates& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> rows({n, n});
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    const Outcome result = ikm<K>(robot, to_pose<K>(x), closure);
    std::array<double, kDof<K>> row{};
    for (int i = 0; i < kDof<K>; ++i) {
      if (result) jx_row<K>(closure.carried, closure.chain[i].v, closure.chain[i].lever, row);
      std::memcpy(rows[i], row.data(), sizeof row);
    }
    return result;
  });
  return nb::make_tuple(rows.release(), static_cast<int>(outcome.status));
}

/// The same at home for every rod, (rods, freedoms); requires robot.full.
auto full_rod_rows(const Robot& robot) {
  const std::size_t rods = robot.full.rods, unknowns = robot.full.unknowns;
  Owned<double> result({rods, unknowns});
  Matrix<kMaxRods, kMaxUnknowns> rows{};
  const bool together = bars_together(robot, robot.full.bars);
  Outcome outcome;
  if (robot.mobility == Mobility::translation)
    outcome = full_rows<Mobility::translation>(robot, together, rows);
  if (robot.mobility == Mobility::schoenflies)
    outcome = full_rows<Mobility::schoenflies>(robot, together, rows);
  if (!outcome) throw nb::value_error(describe(outcome.status));
  for (std::size_t rod = 0; rod < rods; ++rod)
    std::memcpy(result[rod], rows[rod].data(), unknowns * sizeof(double));
  return result.release();
}

double rod_shortfall(const Robot& robot, const Coordinates& x, int chain) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    const Pose pose = placed<mobility()>(robot, to_pose<mobility()>(x));
    const Chain& of = robot.chain.at(chain);
    return shortfall(of, pose.D + pose.R * of.pivot() + of.anchor() - of.base());
  });
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
