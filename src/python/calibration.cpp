// Estimates, calibrations and bounds for Python: arrays in, arrays out. No mathematics.
#include "calibration/bound.hpp"
#include "calibration/calibrate.hpp"
#include "python/for_rows.hpp"
#include "python/held.hpp"

namespace truepose::python {
namespace {
Links links_or_none(Optional<const Links> links) { return links ? **links : Links{}; }

/// @param nuisances  number of the prior's last parameters that are the ideal level's model error
/// @param registration  first of its unknowns in the prior, or -1
/// @param links  differences measured between rows
/// @param influence  (N, (n + r) × influences) effect of one unit of each on the readings
/// @param referenced  number of last rows, measured in the base frame
auto run_calibration(const Robot& drawn, const Known& prior, int nuisances,
                     const std::vector<double>& mean, const Rows& q_e, const Rows& measured,
                     const Rows& measured_sigma, const Frame& base, const Frame& marker,
                     int registration, Optional<const Links> links, int influences,
                     const Rows& influence, int loss, int iterations, bool full, int referenced,
                     bool rows) {
  RowMatrix x(int(q_e.shape(0)), dof(drawn.mobility));
  CalibrationResult result;
  {
    const nb::gil_scoped_release release;
    const ReadingLog log{x.rows(),
                         q_e.data(),
                         influence.data(),
                         measured.shape(0) ? measured.data() : nullptr,
                         measured_sigma.data(),
                         {base, marker},
                         links_or_none(links),
                         referenced};
    result =
        calibrate(level(full), drawn, prior.view(), mean, log,
                  {influences, nuisances, registration, Loss{loss}, iterations, rows, Signals{}});
  }
  std::vector<int> status;
  for (int i : range(x.rows())) {
    status.push_back(int(result.status[i]));
    Coordinates at;
    at.fill(NAN);
    if (!result.xi.empty() && status[i] == 0) at = to_coordinates(drawn.mobility, result.pose[i]);
    copy_first(x.cols(), at, x[i]);
  }
  const RowMatrix link(int(result.link.size()), 4,
                       reinterpret_cast<const double*>(result.link.data()));
  const auto& [start, found] = std::tie(result.start, result.registration);
  return nb::make_tuple(
      int(result.outcome.status), result.iterations, result.xi, result.covariance, x, result.chi2,
      result.redundancy, result.weight, status, result.cost, start.base, start.marker, found.base,
      found.marker, result.w, link, result.amount,
      nb::make_tuple(result.rows.B, result.rows.y, result.rows.D, result.rows.line));
}

/// @param C, end  as in Columns. @param ordinary  noise, tolerances, correlation, persisting
auto run_weigh(const RowMatrix& B, const std::vector<double>& y, const RowMatrix& D,
               const std::vector<int>& line, const RowMatrix& C, const std::vector<int>& end,
               const RowMatrix& ordinary) {
  const auto* first = reinterpret_cast<const Ordinary*>(ordinary.data());
  const nb::gil_scoped_release release;
  return weigh({B, y, D, line}, {C, end}, {first, first + ordinary.rows()});
}

/// Start of a registration by roughly known poses, NaN without one; see `registered`.
auto run_registered(const Robot& robot, const Frame& base, const Frame& marker, bool moved,
                    bool movable, bool turning, const Rows& x, const Rows& measured) {
  if (measured.shape(0) != x.shape(0) || int(measured.shape(1)) != dof(robot.mobility))
    throw std::invalid_argument("measured: one row of coordinates a pose");
  std::vector<Pose> pose;
  std::vector<Status> status;
  for (std::size_t i = 0; i < x.shape(0); ++i) {
    pose.push_back(to_pose(robot.mobility, row<Coordinates>(x, i)));
    status.push_back(pose[i].D.allFinite() ? Status::ok : Status::not_finite);
  }
  const Registration of =
      registered(robot.mobility, {base, marker}, moved, movable, turning,
                 static_cast<int>(pose.size()), pose.data(), status.data(), measured.data());
  return nb::make_tuple(of.base, of.marker);
}

/// Rows of visits, (M, p), per unit of each parameter, and the visit of each.
/// @param outside, sigma  external measurement of each pose, (N, n), NaN where missing; one row of
///                        sigma is that of all
/// @param base, marker  registration of the measurement
/// @param first  index of its unknowns; -1: known
/// @param influence  as in batch_gain
auto run_rows_of_visits(const Robot& robot, const Known& prior, const Rows& x, const Rows& outside,
                        const Rows& sigma, const Frame& base, const Frame& marker, int first,
                        Optional<const Links> links, bool full, int nuisances,
                        const std::optional<Rows>& influence) {
  VisitRows all;
  Outcome outcome;
  {
    const nb::gil_scoped_release release;
    const Registration registration{base, marker};
    std::vector<Visit> visits;
    for (std::size_t i = 0; i < x.shape(0); ++i) {
      Outside seen;
      if (i < outside.shape(0)) seen = {at_row(outside, i), at_row(sigma, i), &registration, first};
      visits.push_back({to_pose(robot.mobility, row<Coordinates>(x, i)), seen,
                        influences_at(robot, influence, i)});
    }
    outcome = rows_of_visits(level(full), robot, prior.view(), nuisances, visits,
                             links_or_none(links), all, Signals{});
  }
  return answered(outcome, all.B, all.visit);
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
        PoseError here;
        const Outcome outcome = first ? error_at(row<Coordinates>(x, i), i, here) : first;
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
auto batch_observe(Online& online, const Rows& q_e, const std::vector<double>& linearised) {
  const Robot& drawn = online.nominal;
  const std::size_t n = dof(drawn.mobility);
  online.begin(drawn);
  if (!linearised.empty()) online.settings.linearised = linearised.data();
  return batch(
      q_e.shape(0), {{n}},
      [&](std::size_t i, auto& out) {
        online.pose = to_pose(drawn.mobility, drawn.home);
        const Outcome outcome = online.observe(row<Extended>(q_e, i));
        std::copy_n(to_coordinates(drawn.mobility, online.pose).begin(), n, out[0]);
        return outcome;
      },
      kInOrder);
}

/// Measured differences, a row each: kind, two rows of the log, and the rest as in Link.
Links links_of(const RowMatrix& rows, const std::vector<double>& mean, int first) {
  Links links{{}, mean, first};
  for (int i : range(rows.rows())) {
    const auto whole = [&](int k) { return int(rows(i, k)); };
    links.link.push_back({LinkKind{whole(0)},
                          {whole(1), whole(2)},
                          whole(3),
                          whole(4),
                          whole(5),
                          rows(i, 6),
                          rows(i, 7),
                          rows(i, 8)});
  }
  return links;
}
}  // namespace

void bind_calibration(nb::module_& m) {
  nb::class_<Links>(m, "Links");
  m.def("links", &links_of);
  nb::class_<Known>(m, "Knowledge")
      .def(nb::init<const std::vector<int>&, const RowMatrix&, const Extended&>())
      .def_ro("column", &Known::column)
      .def_ro("root", &Known::root)
      .def_ro("sigma", &Known::sigma);
  nb::class_<Online>(m, "Online")
      .def(nb::init<const Robot&, const Known&, const std::vector<double>&, const RowMatrix&,
                    double, bool, const RowMatrix&, const std::vector<int>&,
                    const std::vector<double>&, int, const Coordinates&, const Joint&>())
      .def("observe", &batch_observe)
      .def("resume", &Online::resume)
      .def_prop_ro("memory", &Online::memory)
      .def_ro("lines", &Online::lines)
      .def_ro("left_out", &Online::left_out)
      .def_prop_ro("residual_test", [](const Online& online) { return online.state.test; })
      .def_prop_ro("xi",
                   [](const Online& online) {
                     return std::vector<double>(online.state.xi, online.state.xi + online.width());
                   })
      .def_prop_ro("root",
                   [](const Online& online) {
                     const int p = online.state.count;
                     return RowMatrix(p, p, online.state.root);
                   })
      .def_prop_ro("sigma", [](const Online& online) { return online.state.sigma; })
      .def_prop_ro("recognised", [](Online& online) {
        online.note();
        nb::list all;
        for (const auto& [row, kind, which, log_odds] : online.recognised)
          all.append(nb::make_tuple(row, int(kind), which, log_odds));
        return all;
      });
  nb::class_<ResidualTest>(m, "ResidualTest")
      .def_ro("lines", &ResidualTest::lines)
      .def_ro("stopped", &ResidualTest::stopped)
      .def_ro("suspect", &ResidualTest::suspect);
  m.attr("ITERATIONS") = CalibrationSettings{}.iterations;
  m.def("calibrate", &run_calibration);
  m.def("weigh", &run_weigh);
  m.def("registered", &run_registered);
  m.def("rows_of_visits", &run_rows_of_visits);
  m.def("accuracy", &batch_accuracy);
}
}  // namespace truepose::python
