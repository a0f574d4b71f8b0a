// Loops over many poses, in C++ and without the interpreter's lock. No mathematics.
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include <vector>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "instances.hpp"
#include "known.hpp"
#include "truepose/full_linearise.hpp"
#include "truepose/offline/simulate.hpp"
#include "truepose/offline/statics.hpp"

namespace truepose::python {
namespace {

/// The used part of a matrix of fixed capacity, or NaN where there is none.
template <class M>
void write(const M& matrix, std::size_t rows, std::size_t columns, Outcome outcome, double* out) {
  for (std::size_t i = 0; i < rows; ++i)
    for (std::size_t j = 0; j < columns; ++j) *out++ = outcome ? matrix[i][j] : NAN;
}

/// Calls `f(x, out)` for each row of `in` and collects n_out values and the outcome.
template <class In, class Out, class F>
auto map_rows(const Rows& in, std::size_t n_out, F&& f) {
  const std::size_t count = in.shape(0);
  Owned<double> values({count, n_out});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    Out out{};
    const Outcome outcome = f(row<In>(in, i), out, i);
    outcomes.set(i, outcome);
    if (!outcome) out.fill(NAN);
    std::copy_n(out.data(), n_out, values[i]);
  });
  return nb::make_tuple(values.release(), outcomes.status.release(), outcomes.chain.release());
}

// `full` chooses the level of the model: every rod by itself, or the ideal one.

auto batch_ikm(const Robot& robot, const Rows& x, bool full) {
  return map_rows<Joint, Joint>(x, x.shape(1), [&](const Joint& at, Joint& q, std::size_t) {
    return full ? ikm_full(robot, at, q) : ikm(robot, at, q);
  });
}

auto batch_rkm(const Robot& robot, const Rows& x, bool full) {
  return map_rows<Joint, Reading>(x, robot.r, [&](const Joint& at, Reading& r, std::size_t) {
    return full ? rkm_full(robot, at, r) : rkm(robot, at, r);
  });
}

auto batch_parasitic(const Robot& robot, const Rows& x) {
  const std::size_t unknowns = robot.full.kind == FullKind::exists ? robot.full.unknowns : 0;
  const std::size_t n = x.shape(1), rest = unknowns > n ? unknowns - n : 0;
  return map_rows<Joint, Joint>(x, rest, [&](const Joint& at, Joint& turns, std::size_t) {
    return parasitic(robot, at, turns);
  });
}

auto batch_redundant_fkm(const Robot& robot, const Rows& q_e) {
  return map_rows<Extended, Joint>(
      q_e, dof(robot.mobility),
      [&](const Extended& at, Joint& x, std::size_t) { return redundant_fkm(robot, at, x); });
}

auto batch_settle(const Robot& nominal, const Robot& truth, const ControlSettings& control,
                  const Known* known, bool gravity, const Rows& x_d) {
  const StaticsSettings settings{control, gravity};
  return with_mobility(nominal.mobility, [&](auto mobility) {
    return map_rows<Joint, Joint>(x_d, x_d.shape(1), [&](const Joint& at, Joint& x, std::size_t) {
      return settle<mobility()>(nominal, truth, settings, at, x, Weights(nominal, known).view());
    });
  });
}

/// Exact readings (N, n + r) as real encoders give them: with noise, in counts.
auto batch_spoil(const Robot& robot, const Rows& exact, std::uint64_t seed) {
  const std::size_t count = exact.shape(0), width = exact.shape(1);
  Owned<double> values({count, width});
  Random random(seed);
  for (std::size_t i = 0; i < count; ++i) {
    Extended q_e = row<Extended>(exact, i);
    spoil(robot, random, q_e);
    std::memcpy(values[i], q_e.data(), width * sizeof(double));
  }
  return values.release();
}

/// `any_branch`: poses in another working or assembly mode than the robot's are answers too.
auto batch_fkm(const Robot& robot, const Rows& q, const Rows& guess, bool full, bool any_branch) {
  const std::size_t count = q.shape(0), n = q.shape(1);
  Owned<double> x({count, n}), residual({count});
  Owned<int> iterations({count});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    Joint pose = row<Joint>(guess, i);
    const Joint motors = row<Joint>(q, i);
    FkmResult result = full ? fkm_full(robot, motors, pose) : fkm(robot, motors, pose);
    if (any_branch && result.status == Status::branch_lost) result.status = Status::ok;
    if (!result) pose.fill(NAN);
    std::memcpy(x[i], pose.data(), n * sizeof(double));
    outcomes.set(i, {result.status, result.chain});
    *iterations[i] = result.iterations;
    *residual[i] = result.residual;
  });
  return nb::make_tuple(x.release(), outcomes.status.release(), outcomes.chain.release(),
                        iterations.release(), residual.release());
}

auto batch_jacobian(const Robot& robot, const Rows& x, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1);
  Owned<double> values({count, n, n});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    JointMatrix J;
    const Joint at = row<Joint>(x, i);
    const Outcome outcome = full ? jacobian_full(robot, at, J) : jacobian(robot, at, J);
    outcomes.set(i, outcome);
    write(J, n, n, outcome, values[i]);
  });
  return nb::make_tuple(values.release(), outcomes.status.release(), outcomes.chain.release());
}

auto batch_tej(const Robot& robot, const Rows& x, double band) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  Owned<double> m({count, e, n}), plus({count, n, e});
  Outcomes outcomes(count);
  for_rows(count, [&](std::size_t i) {
    ExtendedColumns M;
    ExtendedRows M_plus;
    const Outcome outcome = tej(robot, row<Joint>(x, i), M, M_plus, band);
    outcomes.set(i, outcome);
    write(M, e, n, outcome, m[i]);
    write(M_plus, n, e, outcome, plus[i]);
  });
  return nb::make_tuple(m.release(), plus.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// Type 2 of every pose, then type 1 of each of its chains, (N, 1 + n).
auto batch_conditioning(const Robot& robot, const Rows& x) {
  return map_rows<Joint, std::array<double, 1 + kMaxDof>>(
      x, 1 + x.shape(1), [&](const Joint& at, auto& values, std::size_t) {
        Joint serial{};
        const Outcome outcome = conditioning(robot, at, values[0], serial);
        std::copy(serial.begin(), serial.end(), values.begin() + 1);
        return outcome;
      });
}

/// ∂x/∂q_e of a robot at rest under a law, (N, n, n + r).
auto batch_leakage(const Robot& robot, Law law, const Known* known, const Rows& x) {
  const std::size_t n = x.shape(1), e = n + robot.r;
  Owned<double> leak({x.shape(0), n, e});
  Outcomes outcomes(x.shape(0));
  with_mobility(robot.mobility, [&](auto mobility) {
    for_rows(x.shape(0), [&](std::size_t i) {
      const Weights weights(robot, known);
      ExtendedRows rows{};
      const Outcome outcome =
          leakage<mobility()>(robot, law, row<Joint>(x, i), rows, weights.view());
      outcomes.set(i, outcome);
      for (std::size_t k = 0; k < n * e; ++k) leak[i][k] = outcome ? rows[k / e][k % e] : NAN;
    });
  });
  return nb::make_tuple(leak.release(), outcomes.status.release(), outcomes.chain.release());
}

/// H_x = [J⁻¹; J_r], (N, n + r, n), and H_ξ in the core's own order, (N, n + r, p).
auto batch_linearise(const Robot& robot, const Rows& x, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  const std::size_t p = parameter_count(robot);
  Owned<double> h_x({count, e, n}), h_xi({count, e, p});
  Outcomes outcomes(count);
  with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    for_rows(count, [&](std::size_t i) {
      Extended q_e;
      Matrix<kMaxReadings, kDof<K>> H_x;
      const Pose pose = to_pose<K>(row<Joint>(x, i));
      const Outcome outcome = full ? linearise_full<K>(robot, pose, q_e, H_x, h_xi[i])
                                   : linearise<K>(robot, pose, q_e, H_x, h_xi[i]);
      outcomes.set(i, outcome);
      write(H_x, e, n, outcome, h_x[i]);
      if (!outcome) std::fill_n(h_xi[i], e * p, NAN);
    });
  });
  return nb::make_tuple(h_x.release(), h_xi.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// Points P, B, A and the pivot of every chain at one pose, (n, 4, 3): what a drawing needs.
auto skeleton(const Robot& robot, const Joint& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> points({n, 4, 3});
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    Closure<mobility()> closure;
    const Outcome result = ikm<mobility()>(robot, to_pose<mobility()>(x), closure);
    for (std::size_t i = 0; i < n && result; ++i) {
      const Vec3 P = robot.chain[i].base, B = P + closure.chain[i].p, A = B - closure.chain[i].v;
      const Vec3 C = closure.pose.D + closure.chain[i].lever;
      int k = 0;
      for (const Vec3& point : {P, B, A, C})
        for (int axis = 0; axis < 3; ++axis) points[i][k++] = point[axis];
    }
    return result;
  });
  return nb::make_tuple(points.release(), static_cast<int>(outcome.status), outcome.chain);
}

/// J_x at a pose, (n, n): what its rods hold of the nacelle.
auto rod_rows(const Robot& robot, const Joint& x) {
  const std::size_t n = dof(robot.mobility);
  Owned<double> rows({n, n});
  const Outcome outcome = with_mobility(robot.mobility, [&](auto mobility) {
    constexpr Mobility K = mobility();
    Closure<K> closure;
    const Outcome result = ikm<K>(robot, to_pose<K>(x), closure);
    std::array<double, kDof<K>> row{};
    for (int i = 0; i < kDof<K>; ++i) {
      if (result) jx_row<K>(closure.chain[i].v, closure.chain[i].lever, row);
      std::memcpy(rows[i], row.data(), sizeof row);
    }
    return result;
  });
  return nb::make_tuple(rows.release(), static_cast<int>(outcome.status));
}

/// The same at home for every rod by itself, (rods, freedoms); robot.full must have counted them.
auto full_rod_rows(const Robot& robot) {
  const std::size_t rods = robot.full.rods, unknowns = robot.full.unknowns;
  Owned<double> result({rods, unknowns});
  Matrix<kMaxRods, kMaxUnknowns> rows{};
  const bool together = bars_together(robot, robot.full.bars);
  if (robot.mobility == Mobility::translation)
    full_rows<Mobility::translation>(robot, together, rows);
  if (robot.mobility == Mobility::schoenflies)
    full_rows<Mobility::schoenflies>(robot, together, rows);
  for (std::size_t rod = 0; rod < rods; ++rod)
    std::memcpy(result[rod], rows[rod].data(), unknowns * sizeof(double));
  return result.release();
}

double rod_shortfall(const Robot& robot, const Joint& x, int chain) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    const Pose pose = to_pose<mobility()>(x);
    const Chain& of = robot.chain.at(chain);
    return shortfall(of, pose.D + pose.R * of.pivot + of.anchor - of.base);
  });
}

auto run_simulation(const Robot& nominal, const Robot& truth, const ControlSettings& settings,
                    const Known* known, const Joint& from, const Joint& to, double duration,
                    double hold, int steps, const Joint& start, std::uint64_t seed) {
  const Weights weights(nominal, known);
  const std::size_t n = dof(nominal.mobility), e = n + nominal.r;
  std::vector<Sample> log;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    log.reserve(static_cast<std::size_t>((duration + hold) / settings.period) + 2);
    outcome = with_mobility(nominal.mobility, [&](auto mobility) {
      return simulate<mobility()>(
          nominal, truth, settings, Run{from, to, duration, hold, steps, seed}, start,
          [&](const Sample& sample) { log.push_back(sample); }, weights.view());
    });
  }
  const std::size_t count = log.size();
  Owned<double> time({count}), x_d({count, n}), x({count, n}), q_e({count, e}), error({count, n}),
      torque({count, n});
  Owned<bool> near_singular({count});
  for (std::size_t i = 0; i < count; ++i) {
    *time[i] = log[i].time;
    std::memcpy(x_d[i], log[i].x_d.data(), n * sizeof(double));
    std::memcpy(x[i], log[i].x.data(), n * sizeof(double));
    std::memcpy(q_e[i], log[i].q_e.data(), e * sizeof(double));
    std::memcpy(error[i], log[i].error.data(), n * sizeof(double));
    std::memcpy(torque[i], log[i].torque.data(), n * sizeof(double));
    *near_singular[i] = log[i].status == Status::near_singular;
  }
  return nb::make_tuple(static_cast<int>(outcome.status), outcome.chain, time.release(),
                        x_d.release(), x.release(), q_e.release(), error.release(),
                        torque.release(), near_singular.release());
}

}  // namespace

void bind_batch(nb::module_& m) {
  using namespace nb::literals;
  m.def("ikm", &batch_ikm);
  m.def("rkm", &batch_rkm);
  m.def("fkm", &batch_fkm);
  m.def("parasitic", &batch_parasitic);
  m.def("redundant_fkm", &batch_redundant_fkm);
  m.def("jacobian", &batch_jacobian);
  m.def("tej", &batch_tej);
  m.def("conditioning", &batch_conditioning);
  m.def("settle", &batch_settle, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(),
        "gravity"_a, "x_d"_a);
  m.def("leakage", &batch_leakage, "robot"_a, "law"_a, "known"_a.none(), "x"_a);
  m.def("linearise", &batch_linearise);
  m.def("skeleton", &skeleton);
  m.def("simulate", &run_simulation, "nominal"_a, "truth"_a, "settings"_a, "known"_a.none(),
        "start"_a, "end"_a, "duration"_a, "hold"_a, "steps"_a, "at_rest"_a, "seed"_a);
  m.def("spoil", &batch_spoil);
  m.def("rod_rows", &rod_rows);
  m.def("full_rod_rows", &full_rod_rows);
  m.def("shortfall", &rod_shortfall);
}

}  // namespace truepose::python
