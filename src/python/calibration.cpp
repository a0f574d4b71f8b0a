// Estimates, calibrations and bounds for Python: arrays in, arrays out. No mathematics.
#include <nanobind/stl/optional.h>
#include <nanobind/stl/vector.h>

#include "calibration/bound.hpp"
#include "calibration/calibrate.hpp"
#include "python/arrays.hpp"
#include "python/for_rows.hpp"
#include "python/known.hpp"
#include "python/online_calibration.hpp"

namespace truepose::python {
namespace {
/// Influences at pose i: none, or a row of (N, (n + r) × count).
Influences influences_at(const Robot& robot, const std::optional<Rows>& influence, std::size_t i) {
  if (!influence) return {};
  const std::size_t width = influence->shape(1);
  return {static_cast<int>(width) / truepose::readings(robot), influence->data() + i * width};
}

RowMatrix homogeneous(const Frame& frame) {
  RowMatrix T = RowMatrix::identity(4);
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j < 3; ++j) T(i, j) = frame.R(i, j);
    T(i, 3) = frame.t[i];
  }
  return T;
}
Registration registration_from(const RowMatrix& base, const RowMatrix& marker) {
  const auto frame = [](const RowMatrix& T) {
    return Frame{
        {T(0, 3), T(1, 3), T(2, 3)},
        Mat3::of(T(0, 0), T(0, 1), T(0, 2), T(1, 0), T(1, 1), T(1, 2), T(2, 0), T(2, 1), T(2, 2))};
  };
  return {frame(base), frame(marker)};
}

/// @param nuisances  number of the prior's last parameters that are the ideal level's model error
/// @param registration  first of its unknowns in the prior, or -1
/// @param links  differences measured between rows
/// @param influence  (N, (n + r) × influences) effect of one unit of each on the readings
/// @param referenced  number of last rows, measured in the base frame
auto run_calibration(const Robot& drawn, const Known& prior, int nuisances,
                     const std::vector<double>& mean, const Rows& q_e, const Rows& measured,
                     const Rows& measured_sigma, const RowMatrix& base, const RowMatrix& marker,
                     int registration, const Links& links, int influences, const Rows& influence,
                     int loss, double tuning, int iterations, bool full, int referenced) {
  const std::size_t count = q_e.shape(0), n = dof(drawn.mobility);
  CalibrationResult result;
  {
    nb::gil_scoped_release release;
    ReadingLog log;
    log.count = static_cast<int>(count), log.q_e = q_e.data();
    log.registration = registration_from(base, marker), log.links = links;
    log.influence = influence.data(), log.referenced = referenced;
    if (measured.shape(0) > 0) {
      log.measured = measured.data();
      log.measured_sigma = measured_sigma.data();
    }
    const Knowledge known = prior.view();
    Signals signals;
    CalibrationSettings settings;
    settings.influences = influences, settings.nuisances = nuisances,
    settings.registration = registration;
    settings.loss = Loss{loss}, settings.tuning = tuning, settings.iterations = iterations;
    settings.poll = [&] { signals(); };
    result = calibrate(level(full), drawn, known, mean, log, settings);
  }
  Owned<double> x({count, n}), difference({result.link.size(), 4});
  std::vector<int> status(count);
  for (std::size_t i = 0; i < count; ++i) {
    status[i] = static_cast<int>(result.status[i]);
    Coordinates at;
    at.fill(NAN);
    if (!result.xi.empty() && result.status[i] == Status::ok)
      at = to_coordinates(drawn.mobility, result.pose[i]);
    std::copy_n(at.begin(), n, x[i]);
  }
  for (std::size_t k = 0; k < result.link.size(); ++k) {
    const LinkResult& of = result.link[k];
    std::copy_n(std::array{of.residual, of.left_out, of.sigma, of.weight}.begin(), 4,
                difference[k]);
  }
  return nb::make_tuple(static_cast<int>(result.outcome.status), result.iterations,
                        owned(result.xi), result.covariance, x.release(), owned(result.chi2),
                        owned(result.redundancy), owned(result.weight), owned(status), result.cost,
                        homogeneous(result.start.base), homogeneous(result.start.marker),
                        homogeneous(result.registration.base),
                        homogeneous(result.registration.marker), owned(result.w),
                        difference.release(), owned(result.amount));
}

/// Rows of visits, (M, p), per unit of each parameter, and the visit of each.
/// @param outside, sigma  external measurement of each pose, (N, n), NaN where missing
/// @param base, marker  registration of the measurement
/// @param first  index of its unknowns; -1: known
/// @param influence  as in batch_gain
auto run_rows_of_visits(const Robot& robot, const Known& prior, const Rows& x, const Rows& outside,
                        const Rows& sigma, const RowMatrix& base, const RowMatrix& marker,
                        int first, const Links& links, bool full, int nuisances,
                        const std::optional<Rows>& influence) {
  VisitRows all;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    const Registration registration = registration_from(base, marker);
    std::vector<Visit> visits;
    for (std::size_t i = 0; i < x.shape(0); ++i) {
      const std::size_t at = i * x.shape(1);
      Outside seen;
      if (i < outside.shape(0))
        seen = {outside.data() + at, sigma.data() + at, &registration, first};
      visits.push_back({to_pose(robot.mobility, row<Coordinates>(x, i)), seen,
                        influences_at(robot, influence, i)});
    }
    Signals signals;
    outcome = rows_of_visits(level(full), robot, prior.view(), nuisances, visits, links, all,
                             [&] { signals(); });
  }
  return answered(outcome, all.B, all.visit);
}

/// Root of the posterior covariance after readings at poses, (p, p) lower triangular.
/// @param known  further poses, each known to `sigma`
/// @param links  differences to be measured between poses
/// @param influence  as in batch_gain, for `x` and then `known`
auto run_after_visiting(const Robot& robot, const Known& prior, const Rows& x, const Rows& known,
                        const std::vector<double>& sigma, const Links& links, bool full,
                        int nuisances, const std::optional<Rows>& influence) {
  RowMatrix root;
  Outcome outcome;
  {
    nb::gil_scoped_release release;
    std::vector<Visit> visits;
    const auto visit = [&](const Rows& rows, std::size_t i, Outside outside) {
      visits.push_back({to_pose(robot.mobility, row<Coordinates>(rows, i)), outside,
                        influences_at(robot, influence, visits.size())});
    };
    for (std::size_t i = 0; i < x.shape(0); ++i) visit(x, i, {});
    for (std::size_t i = 0; i < known.shape(0); ++i)
      visit(known, i, {known.data() + i * known.shape(1), sigma.data()});
    Signals signals;
    outcome = after_visiting(level(full), robot, prior.view(), nuisances, visits, links, root,
                             [&] { signals(); });
  }
  return answered(outcome, root);
}

/// Covariance of x̂ at every pose, (N, n, n); relative to the pose `reference` if given.
/// @param influence  as in batch_gain, for `x` and then `reference`
auto batch_accuracy(const Robot& robot, const Known& known, const Rows& x, const Rows& reference,
                    bool full, const std::optional<Rows>& influence) {
  const std::size_t count = x.shape(0), n = x.shape(1);
  const Knowledge knowledge = known.view();
  const auto error_at = [&](const Coordinates& at, std::size_t i, PoseError& error) {
    return pose_error(level(full), robot, knowledge, to_pose(robot.mobility, at),
                      influences_at(robot, influence, i), scratch(0), error);
  };
  PoseError there;
  Outcome first;
  const bool relative = reference.shape(0) > 0;
  if (relative) first = error_at(row<Coordinates>(reference, 0), count, there);
  return batch(
      count, {{n, n}},
      [&](std::size_t i, auto& out) {
        if (!first) return first;
        PoseError here;
        const Outcome outcome = error_at(row<Coordinates>(x, i), i, here);
        if (!outcome) return outcome;
        if (relative) {
          here.by_geometry = sum(here.by_geometry, there.by_geometry, -1);
          here.by_noise = sum(here.by_noise, there.by_noise);
        }
        std::ranges::copy(plus_gram(here.by_noise, transposed(here.by_geometry)), out[0]);
        return outcome;
      },
      kFewRowsPerThread);
}

/// Processes rows of a log in sequence; they need not be neighbours.
/// @param linearised  ξ of the linearisation; none: ξ̂ itself
auto batch_observe(Online& online, const Rows& q_e, const Row& linearised) {
  const Robot& drawn = online.drawn();
  const std::size_t count = q_e.shape(0), n = dof(drawn.mobility);
  Owned<double> x({count, n});
  Outcomes outcomes(count);
  OnlineCalibrator& learner = online.begin(drawn);
  const std::vector<double> about(linearised.data(), linearised.data() + linearised.shape(0));
  if (!about.empty()) learner.settings.linearised = about.data();
  for_rows_in_order(count, [&](std::size_t i) {
    learner.pose = to_pose(drawn.mobility, drawn.home);
    const Outcome outcome =
        observe(level(online.full()), drawn, learner.settings, row<Extended>(q_e, i), learner.state,
                learner.robot, learner.pose, learner.work);
    ++(outcome.status == Status::ok ? learner.lines : learner.left_out);
    outcomes.set(i, outcome);
    Coordinates at = to_coordinates(drawn.mobility, learner.pose);
    if (!outcome) at.fill(NAN);
    std::copy_n(at.begin(), n, x[i]);
  });
  return together(x, outcomes.status, outcomes.chain);
}
}  // namespace

void bind_calibration(nb::module_& m) {
  using namespace nb::literals;
  nb::class_<Links>(m, "Links")
      .def(
          "__init__",
          [](Links* links, std::vector<double> mean, int first) {
            new (links) Links{{}, std::move(mean), first};
          },
          "mean"_a, "first"_a)
      .def(
          "add",
          [](Links& links, int kind, const std::array<int, 2>& line, int tool, int shape, int axis,
             double times, double measured, double sigma) {
            links.link.push_back({LinkKind{kind}, line, tool, shape, axis, times, measured, sigma});
          },
          "kind"_a, "line"_a, "tool"_a, "shape"_a, "axis"_a, "times"_a, "measured"_a, "sigma"_a);
  nb::class_<Known>(m, "Knowledge")
      .def(nb::init<std::vector<int>, RowMatrix, const std::vector<double>&>())
      .def_ro("column", &Known::column)
      .def_ro("root", &Known::root)
      .def_ro("sigma", &Known::sigma);
  nb::class_<Online>(m, "Online")
      .def(nb::init<const Robot&, const Known&, std::vector<double>, RowMatrix, double, bool>())
      .def("observe", &batch_observe)
      .def("resume", &Online::resume)
      .def_prop_ro("memory", &Online::memory)
      .def_prop_ro("lines", [](const Online& online) { return online.learner().lines; })
      .def_prop_ro("left_out", [](const Online& online) { return online.learner().left_out; })
      .def_prop_ro("stopped_after", [](const Online& online) { return online.doubt().lines; })
      .def_prop_ro("stopped", [](const Online& online) { return online.doubt().stopped; })
      .def_prop_ro("suspect", [](const Online& online) { return online.doubt().suspect; })
      .def_prop_ro("xi", &Online::xi)
      .def_prop_ro("root", &Online::root);
  m.attr("ITERATIONS") = CalibrationSettings{}.iterations;
  m.def("calibrate", &run_calibration);
  m.def("rows_of_visits", &run_rows_of_visits, "robot"_a, "prior"_a, "x"_a, "outside"_a, "sigma"_a,
        "base"_a, "marker"_a, "first"_a, "links"_a, "full"_a, "nuisances"_a,
        "influence"_a = nb::none());
  m.def("after_visiting", &run_after_visiting, "robot"_a, "prior"_a, "x"_a, "known"_a, "sigma"_a,
        "links"_a, "full"_a, "nuisances"_a, "influence"_a = nb::none());
  m.def("accuracy", &batch_accuracy, "robot"_a, "known"_a, "x"_a, "reference"_a, "full"_a,
        "influence"_a = nb::none());
}
}  // namespace truepose::python
