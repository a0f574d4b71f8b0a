// Calibration in C does what the core's does, and refuses what it cannot use.
#include "../../src/c/calibrate.cpp"
#include "../../src/c/load.cpp"
#include "mechanisms.hpp"

using namespace mechanisms;

namespace {
constexpr Mobility K = Mobility::planar_translation;

/// A five-bar with two sensors and a log of one whose parameters differ, a motor of its first row
/// not read.
struct Bench {
  static constexpr int kRows = 12, kReadings = 4;
  Mechanism mechanism = five_bar();
  Robot robot = (mechanism.robot.r = 2, mechanism.robot);
  Prior prior{robot};
  const Knowledge& known = prior.known();
  int p = known.count;
  std::vector<double> mean, readings, measured;
  std::vector<double> value = std::vector<double>(p), covariance = std::vector<double>(p * p);
  std::vector<double> x = std::vector<double>(kRows * 2), chi2 = std::vector<double>(kRows);
  std::vector<std::int32_t> status = std::vector<std::int32_t>(kRows);
  truepose_model model;
  truepose_knowledge table = c::converted<truepose_knowledge>(known);
  truepose_log log{};
  truepose_calibration fit{};

  Bench() {
    truepose_description description;
    c::describe(robot, description);
    CHECK(truepose_load(&model, sizeof model, &description).status == 0);
    std::copy(known.sigma.begin(), known.sigma.end(), table.sigma);
    std::vector<double> xi(parameter_count(robot));
    CHECK(drawn_parameters(robot, xi.data()));
    check::Random random(7);
    for (int k = 0; k < p; ++k) {
      xi[known.column[k]] += known.root[k * p + k] * random();
      mean.push_back(xi[known.column[k]]);
      xi[known.column[k]] += known.root[k * p + k] * random();
    }
    Robot truth = robot;
    CHECK(set_parameters(robot, xi.data(), truth));
    for (int k = 0; k < kRows; ++k) {
      const Coordinates at = random_pose(mechanism, random);
      Extended read{};
      CHECK(extended(Level::ideal, truth, to_pose(K, at), read));
      for (int i = 0; i < kReadings; ++i) readings.push_back(read[i] + 1e-5 * random());
      for (int i = 0; i < 2; ++i) measured.push_back(at[i] + 2e-5 * random());
    }
    readings[0] = NAN;
    log.rows = kRows, log.readings = readings.data();
    log.measured_sigma[0] = log.measured_sigma[1] = 2e-5;
    fit = {{}, 0, 0, 0, 0, value.data(), covariance.data(), x.data(), chi2.data(), status.data()};
  }
  Status run() {
    return Status(truepose_calibrate(&model, &table, mean.data(), &log, &fit).status);
  }
};
}  // namespace

TEST("a calibration in C has the core's parameters, covariance, poses and status") {
  for (const bool tracked : {false, true}) {
    for (const int loss : {TRUEPOSE_LOSS_STUDENT, TRUEPOSE_LOSS_SQUARES}) {
      Bench bench;
      bench.log.loss = loss;
      bench.log.measured = tracked ? bench.measured.data() : nullptr;
      CHECK(bench.run() == Status::ok);
      std::vector<double> xi(parameter_count(bench.robot)), sigma(Bench::kRows * 2, 2e-5);
      CHECK(drawn_parameters(bench.robot, xi.data()));
      for (int k = 0; k < bench.p; ++k) xi[bench.known.column[k]] = bench.mean[k];
      ReadingLog log;
      log.count = Bench::kRows, log.q_e = bench.readings.data();
      log.measured = bench.log.measured, log.measured_sigma = sigma.data();
      CalibrationSettings settings;
      settings.loss = static_cast<Loss>(loss);
      const CalibrationResult core =
          calibrate(Level::ideal, bench.robot, bench.known, xi, log, settings);
      CHECK(core.outcome);
      for (int k = 0; k < bench.p; ++k) CHECK(bench.value[k] == core.xi[bench.known.column[k]]);
      CHECK(std::equal(bench.covariance.begin(), bench.covariance.end(), core.covariance.data()));
      CHECK(bench.fit.used == Bench::kRows - 1 && bench.fit.iterations == core.iterations);
      CHECK(bench.status[0] != 0 && std::isnan(bench.x[0]) && bench.status[1] == 0);
      CHECK(bench.x[2] == core.pose[1].D[0] && bench.chi2[1] == core.chi2[1]);
      double chi2 = 0;
      int redundancy = 0;
      for (int k = 1; k < Bench::kRows; ++k) chi2 += core.chi2[k], redundancy += core.redundancy[k];
      CHECK_NEAR(bench.fit.rms, std::sqrt(chi2 / redundancy), 1e-12);
    }
  }
}

TEST("a calibration in C refuses logs and knowledge that it cannot use, and changes nothing") {
  const auto refused = [](Status expected, auto&& spoil) {
    Bench bench;
    spoil(bench);
    CHECK(bench.run() == expected && bench.fit.used == 0 && bench.value[0] == 0);
  };
  refused(Status::no_such_part, [](Bench& of) { of.log.rows = 0; });
  refused(Status::no_such_part, [](Bench& of) { of.log.loss = 3; });
  refused(Status::no_such_part, [](Bench& of) { of.table.count = 0; });
  refused(Status::no_such_value, [](Bench& of) { of.table.sigma[3] = 0; });
  refused(Status::no_such_value, [](Bench& of) {
    of.log.measured = of.measured.data();
    of.log.measured_sigma[1] = NAN;
  });
  refused(Status::unfinished, [](Bench& of) { of.model = {}; });
  refused(Status::unreachable, [](Bench& of) {
    for (int k = 0; k < Bench::kRows; ++k) of.readings[k * Bench::kReadings] = NAN;
  });
  refused(Status::not_measured, [](Bench& of) {  // the motors alone
    for (int k = 0; k < Bench::kRows * Bench::kReadings; ++k)
      if (k % Bench::kReadings > 1) of.readings[k] = NAN;
  });
}

TEST("a model with other parameters in C is the core's robot, and an invalid column is named") {
  Bench bench;
  CHECK(bench.run() == Status::ok);
  truepose_model changed;
  const auto with = [&](int count, const std::int32_t* column, std::size_t size) {
    return truepose_with_parameters(&bench.model, count, column, bench.value.data(), &changed,
                                    size);
  };
  CHECK(with(bench.p, bench.known.column, sizeof changed).status == 0);
  std::vector<double> xi(parameter_count(bench.robot));
  CHECK(drawn_parameters(bench.robot, xi.data()));
  for (int k = 0; k < bench.p; ++k) xi[bench.known.column[k]] = bench.value[k];
  Robot core = bench.robot;
  CHECK(set_parameters(bench.robot, xi.data(), core));
  const Robot& made = c::Model::of(&changed)->robot;
  for (int i = 0; i < 2; ++i) {
    CHECK(made.chain[i].rod == core.chain[i].rod);
    for (int j = 0; j < 3; ++j) CHECK(made.chain[i].axis[j] == core.chain[i].axis[j]);
    CHECK(made.sensor[i].offset == core.sensor[i].offset && made.sensor[i].offset != 0);
  }
  const std::int32_t wrong[] = {0, parameter_count(bench.robot)};
  const truepose_outcome outcome = with(2, wrong, sizeof changed);
  CHECK(Status(outcome.status) == Status::no_such_part && outcome.part == 1);
  CHECK(Status(with(1, wrong, 8).status) == Status::too_small);
}
