// Estimates, calibrations and bounds for Python: arrays in, arrays out. No mathematics.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/tuple.h>
#include <nanobind/stl/vector.h>

#include "arrays.hpp"
#include "for_rows.hpp"
#include "instances.hpp"
#include "known.hpp"
#include "online.hpp"
#include "truepose/offline/bound.hpp"
#include "truepose/offline/calibrate.hpp"
#include "truepose/offline/guarded.hpp"

namespace truepose::python {
namespace {

/// Calls f(mobility, model) with both as types. Where the levels are one, the ideal model is both.
template <class F>
auto with_level(const Robot& robot, bool full, F&& f) {
  return with_mobility(robot.mobility, [&](auto mobility) {
    if constexpr (kPaired<mobility()>)
      if (full) return f(mobility, FullModel{});
    return f(mobility, IdealModel{});
  });
}

auto batch_estimate(const Robot& robot, const Known& known, const Rows& q_e, const Rows& guess,
                    bool full) {
  const std::size_t count = q_e.shape(0), n = dof(robot.mobility);
  Owned<double> x({count, n}), covariance({count, n, n}), chi2({count});
  Outcomes outcomes(count);
  with_level(robot, full, [&](auto mobility, auto level) {
    constexpr Mobility K = decltype(mobility)::value;
    using Level = decltype(level);
    const Knowledge knowledge = known.view();
    for_rows(
        count,
        [&](std::size_t i) {
          std::vector<double>& work = scratch(estimate_work(robot, knowledge.count));
          Pose pose = to_pose<K>(row<Joint>(guess, i));
          const Estimate<K> result =
              estimate<K, Level>(robot, knowledge, row<Extended>(q_e, i), pose, work.data());
          outcomes.set(i, result.outcome);
          Joint at = to_coordinates<K>(pose);
          if (!result) at.fill(NAN);
          std::copy_n(at.begin(), n, x[i]);
          for (std::size_t k = 0; k < n * n; ++k)
            covariance[i][k] = result ? result.covariance[k / n][k % n] : NAN;
          *chi2[i] = result ? result.chi2 : NAN;
        },
        kFewRowsPerThread);
  });
  return nb::make_tuple(x.release(), covariance.release(), chi2.release(),
                        outcomes.status.release(), outcomes.chain.release());
}

/// Gain of the fused readings, (N, n, n + r), at poses: how an error of one reading leaks into x.
auto batch_gain(const Robot& robot, const Known& known, const Rows& x, bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1), e = n + robot.r;
  Owned<double> gain({count, n, e}), tej({count, n, e});
  Outcomes outcomes(count);
  with_level(robot, full, [&](auto mobility, auto level) {
    constexpr Mobility K = decltype(mobility)::value;
    using Level = decltype(level);
    const Knowledge knowledge = known.view();
    for_rows(
        count,
        [&](std::size_t i) {
          std::vector<double>& work = scratch(estimate_work(robot, knowledge.count));
          Extended q_e;
          Matrix<kMaxReadings, kDof<K>> H_x;
          ReadingCovariance C;
          Fusion<K> fusion;
          Outcome outcome = Level::template linearise<K>(robot, to_pose<K>(row<Joint>(x, i)), q_e,
                                                         H_x, work.data());
          if (outcome)
            outcome = reading_covariance(robot, knowledge, work.data(),
                                         work.data() + e * parameter_count(robot), C);
          if (outcome) outcome = fuse<K>(robot, knowledge, C, H_x, fusion);
          outcomes.set(i, outcome);
          ExtendedRows M_plus{};
          if (outcome) weighted_tej<K>(robot, H_x, fusion, M_plus);
          for (std::size_t k = 0; k < n * e; ++k) {
            gain[i][k] = outcome ? fusion.gain[k / e][k % e] : NAN;
            tej[i][k] = outcome ? M_plus[k / e][k % e] : NAN;
          }
        },
        kFewRowsPerThread);
  });
  return nb::make_tuple(gain.release(), tej.release(), outcomes.status.release(),
                        outcomes.chain.release());
}

/// What was read less what was expected, (N, n + r), whole turns of a joint left out.
auto batch_innovation(const Robot& robot, const Rows& q_e, const Rows& expected) {
  const std::size_t count = q_e.shape(0), width = q_e.shape(1);
  Owned<double> residual({count, width});
  for_rows(count, [&](std::size_t i) {
    Extended difference{};
    innovation(robot, row<Extended>(q_e, i), row<Extended>(expected, i), difference);
    std::copy_n(difference.begin(), width, residual[i]);
  });
  return residual.release();
}

LineModel model_of(const Robot& robot, bool full, bool guarded) {
  if (guarded)
    return with_mobility(robot.mobility, [](auto mobility) {
      if constexpr (kPaired<mobility()>) return line_model<mobility(), GuardedModel>();
      return line_model<mobility(), IdealModel>();
    });
  return with_level(robot, full, [](auto mobility, auto model) {
    return line_model<mobility(), decltype(model)>();
  });
}

/// @param guarded  the prior with GuardedModel's nuisances behind it, or nothing
/// @param doubt    by how much χ² must fall for the guarded model to be believed; below 0: always
auto run_calibration(const Robot& drawn, const Known& prior, const Known* guarded, int nuisances,
                     double doubt, const std::vector<double>& mean, const Rows& q_e,
                     const Rows& measured, const std::vector<double>& measured_sigma, Loss loss,
                     double tuning, bool full) {
  const std::size_t count = q_e.shape(0), n = dof(drawn.mobility);
  CalibrationResult result;
  bool believed = false;
  {
    nb::gil_scoped_release release;
    ReadingLog log{static_cast<int>(count), q_e.data(), nullptr, {}};
    if (measured.shape(0) > 0) {
      log.measured = measured.data();
      std::copy(measured_sigma.begin(), measured_sigma.end(), log.measured_sigma.begin());
    }
    const LineModel model = model_of(drawn, full, false), guard = model_of(drawn, full, true);
    const Knowledge known = prior.view();
    Signals signals;
    CalibrationSettings settings;
    settings.loss = loss, settings.tuning = tuning;
    settings.poll = [&] { signals(); };
    result = Calibrator(drawn, model, known, mean, log, settings).run();
    if (guarded) {
      const Knowledge all = guarded->view();
      CalibrationSettings with_nuisances = settings;
      with_nuisances.nuisances = nuisances;
      Calibrator calibrator(drawn, guard, all, mean, log, with_nuisances);
      const bool found = bool(result.outcome);
      // A plain model that finds nothing has no say.
      believed = doubt < 0 || !found || !(calibrator.promise(result) < doubt);
      if (believed) result = calibrator.run(found ? &result : nullptr);
    }
  }
  Owned<double> x({count, n}), chi2({count}), weight({count}), xi({result.xi.size()});
  Owned<int> status({count}), redundancy({count});
  std::copy(result.xi.begin(), result.xi.end(), xi[0]);
  for (std::size_t i = 0; i < count; ++i) {
    *status[i] = static_cast<int>(result.status[i]);
    const bool good = !result.xi.empty() && result.status[i] == Status::ok;
    Joint at;
    at.fill(NAN);
    if (good)
      at = with_mobility(drawn.mobility,
                         [&](auto mobility) { return to_coordinates<mobility()>(result.pose[i]); });
    std::copy_n(at.begin(), n, x[i]);
    *chi2[i] = good ? result.chi2[i] : NAN;
    *weight[i] = good ? result.weight[i] : 0;
    *redundancy[i] = good ? result.redundancy[i] : 0;
  }
  return nb::make_tuple(static_cast<int>(result.outcome.status), result.iterations, xi.release(),
                        RowMatrix(result.covariance), x.release(), chi2.release(),
                        redundancy.release(), weight.release(), status.release(), result.cost,
                        believed);
}

/// Root of the posterior covariance after visiting poses, (p, p) lower triangular.
auto run_after_visiting(const Robot& robot, const Known& prior, const Rows& x, bool full,
                        bool guarded) {
  RowMatrix root;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    std::vector<Pose> poses;
    for (std::size_t i = 0; i < x.shape(0); ++i)
      poses.push_back(with_mobility(
          robot.mobility, [&](auto mobility) { return to_pose<mobility()>(row<Joint>(x, i)); }));
    Signals signals;
    outcome = after_visiting(robot, model_of(robot, full, guarded), prior.view(), poses, root,
                             [&] { signals(); });
  }
  return nb::make_tuple(root, static_cast<int>(outcome.status), outcome.chain);
}

/// Covariance of x̂ at every pose, (N, n, n); less the error at `touched` if that is one pose.
auto batch_accuracy(const Robot& robot, const Known& known, const Rows& x, const Rows& touched,
                    bool full) {
  const std::size_t count = x.shape(0), n = x.shape(1);
  Owned<double> covariance({count, n, n});
  Outcomes outcomes(count);
  with_level(robot, full, [&](auto mobility, auto level) {
    constexpr Mobility K = decltype(mobility)::value;
    using Level = decltype(level);
    const Knowledge knowledge = known.view();
    PoseError there;
    Outcome first;
    const bool touch = touched.shape(0) > 0;
    if (touch)
      first = pose_error<K, Level>(robot, knowledge, to_pose<K>(row<Joint>(touched, 0)), scratch(0),
                                   there);
    for_rows(
        count,
        [&](std::size_t i) {
          Outcome outcome = first;
          PoseError here;
          if (outcome)
            outcome = pose_error<K, Level>(robot, knowledge, to_pose<K>(row<Joint>(x, i)),
                                           scratch(0), here);
          outcomes.set(i, outcome);
          RowMatrix P;
          if (!outcome) {
            P.setConstant(n, n, NAN);
          } else {
            P = here.by_noise;
            if (touch) {
              here.by_geometry -= there.by_geometry;
              P += there.by_noise;
            }
            P.noalias() += here.by_geometry * here.by_geometry.transpose();
          }
          std::copy_n(P.data(), n * n, covariance[i]);
        },
        kFewRowsPerThread);
  });
  return nb::make_tuple(covariance.release(), outcomes.status.release(), outcomes.chain.release());
}

/// Lines of a log, one after another, which need not be neighbours.
/// @param linearised  ξ to linearise about, or nothing: ξ̂ itself
auto batch_observe(Online& online, const Rows& q_e, const Row& linearised) {
  const Robot& drawn = online.drawn();
  const std::size_t count = q_e.shape(0), n = dof(drawn.mobility);
  Owned<double> x({count, n});
  Outcomes outcomes(count);
  with_level(drawn, online.full(), [&](auto mobility, auto model) {
    constexpr Mobility K = decltype(mobility)::value;
    Lesson lesson(online, drawn);
    Learner& learner = lesson.learner;
    const std::vector<double> about(linearised.data(), linearised.data() + linearised.shape(0));
    if (!about.empty()) learner.settings.linearised = about.data();
    for_rows_in_order(count, [&](std::size_t i) {
      learner.pose = to_pose<K>(drawn.home);
      const Outcome outcome =
          observe<K, decltype(model)>(drawn, learner.settings, row<Extended>(q_e, i), learner.state,
                                      learner.robot, learner.pose, learner.work);
      learner.lines += bool(outcome);
      outcomes.set(i, outcome);
      Joint at = to_coordinates<K>(learner.pose);
      if (!outcome) at.fill(NAN);
      std::copy_n(at.begin(), n, x[i]);
    });
  });
  return nb::make_tuple(x.release(), outcomes.status.release(), outcomes.chain.release());
}

}  // namespace

void bind_calibration(nb::module_& m) {
  using namespace nb::literals;
  nb::enum_<Loss>(m, "Loss")
      .value("squares", Loss::squares)
      .value("huber", Loss::huber)
      .value("student", Loss::student);
  nb::class_<Known>(m, "Knowledge")
      .def(nb::init<std::vector<int>, RowMatrix, const std::vector<double>&>());
  nb::class_<Online>(m, "Online")
      .def(nb::init<const Robot&, const Known&, std::vector<double>, RowMatrix, double, bool>())
      .def("observe", &batch_observe)
      .def("resume", &Online::resume)
      .def_prop_ro("due", &Online::due)
      .def_prop_ro("lines", &Online::lines)
      .def_prop_ro("xi", &Online::xi)
      .def_prop_ro("root", &Online::root);
  m.def("estimate", &batch_estimate);
  m.def("gain", &batch_gain);
  m.def("innovation", &batch_innovation);
  m.def("calibrate", &run_calibration, "drawn"_a, "prior"_a, "guarded"_a.none(), "nuisances"_a,
        "doubt"_a, "mean"_a, "q_e"_a, "measured"_a, "measured_sigma"_a, "loss"_a, "tuning"_a,
        "full"_a);
  m.def("after_visiting", &run_after_visiting);
  m.def("accuracy", &batch_accuracy);
}

}  // namespace truepose::python
