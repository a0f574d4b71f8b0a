// Delta printers: kinematics, fits, judgement and answers, of printers sampled from what is
// assumed.
#include <cstring>
#include <string>

#include "check.hpp"
#include "truepose/printers.h"
#include "truepose/printers/answer.hpp"

using namespace truepose::printers;

namespace {
/// A printer that believes its drawing, how it truly is, and its readings.
struct Made {
  Printer printer;
  Vector truth;  ///< p, κ, b
};

double normal(check::Random& random) {
  double sum = 0;
  for (int k = 0; k < 12; ++k) sum += 0.5 * random();
  return sum;
}

Delta delta_of(bool rotary) {
  return {rotary,
          Vector3::Constant(rotary ? 2 * 180 * kDegree / (3200 * 25.078125) : 0.0125 * kMm)};
}
Vector drawing(bool rotary) {
  const Delta delta = delta_of(rotary);
  Vector p(delta.count());
  p[0] = rotary ? 33.9 * kMm : 160 * kMm;
  p.segment<3>(delta.angle()) = (rotary ? Vector3(30, 150, 270) : Vector3(210, 330, 90)) * kDegree;
  if (rotary) p.segment<4>(1) << 412.9 * kMm, p.segment<3>(delta.angle());
  if (rotary) p.segment<3>(delta.upper()).setConstant(170 * kMm);
  p.segment<3>(delta.rod()).setConstant(rotary ? 320 * kMm : 345 * kMm);
  p.segment<3>(delta.endstop()).setConstant(rotary ? 220 * kMm : 418 * kMm);
  return p;
}

/// Sampled from the assumptions: probed at `heights` points, 12 distances on a print if asked for.
Made made(bool rotary, unsigned seed, int heights = 13, bool distances = true) {
  check::Random random(seed);
  const Assumed assumed;
  Made of;
  of.printer.delta = delta_of(rotary);
  const Delta& delta = of.printer.delta;
  of.printer.options = options(rotary);
  of.printer.theta.setZero(delta.count() + 2);
  of.printer.theta.head(delta.count()) = drawing(rotary);
  of.printer.radius = (rotary ? 50 : 140) * kMm;
  of.truth = of.printer.theta;
  const Vector sigma = assumed.of(delta);
  for (double& each : of.truth) each += sigma[&each - of.truth.data()] * normal(random);
  const Vector p = of.truth.head(delta.count());
  for (const Vector3& at : spread(heights, of.printer.radius)) {
    Reading reading{
        "height" + std::to_string(of.printer.readings.size()), false, true, 16 * kMm, {}};
    const Vector3 touched(at[0], at[1], reading.value + assumed.noise(false) * normal(random));
    reading.at[0] = delta.steps(p, touched).array().round();
    of.printer.readings.push_back(reading);
  }
  for (int k = 0; k < (distances ? 12 : 0); ++k) {
    Reading reading{"distance" + std::to_string(k), true, false, 0, {}};
    const double turn = 30 * kDegree * k, r = (rotary ? 40 : 70) * kMm;
    const Vector3 from(r * std::cos(turn), r * std::sin(turn), 0);
    const Vector3 to(-0.5 * r * std::sin(2 * turn), 0.6 * r * std::cos(3 * turn), 0);
    reading.at[0] = delta.steps(p, from);
    reading.at[1] = delta.steps(p, to);
    reading.value = (1 - of.truth[delta.count()]) * (from - to).norm() +
                    of.truth[delta.count() + 1] + assumed.noise(true) * normal(random);
    of.printer.readings.push_back(reading);
  }
  return of;
}

/// The printer's file, as Klipper would have written it.
std::string text_of(const Printer& printer) {
  const bool rotary = printer.delta.rotary;
  std::string text =
      rotary ? "[printer]\nkinematics: rotary_delta\n" : "[printer]\nkinematics: delta\n";
  for (const char tower : {'a', 'b', 'c'})
    text += format("[stepper_%c]\nmicrosteps: 16\n%s\n", tower,
                   rotary ? "gear_ratio: 107.000:16, 60:16" : "rotation_distance: 40");
  text +=
      format("[delta_calibrate]\nradius: %g\n\n", printer.radius / kMm) + std::string(kSavedHeader);
  for (int k = 0; k < printer.delta.count(); ++k) {
    const Option& of = printer.options[k];
    text += format("#*# [%s]\n#*# %s = %.6f\n", of.section.c_str(), of.option.c_str(),
                   printer.theta[k] / of.scale());
  }
  text += "#*# [delta_calibrate]\n";
  for (const Reading& of : printer.readings) {
    text += format("#*# %s = %.5f\n", of.name.c_str(), of.value / kMm);
    for (int end = 0; end <= of.distance; ++end)
      text +=
          format("#*# %s_pos%s = %.3f,%.3f,%.3f\n", of.name.c_str(),
                 of.distance ? end ? "2" : "1" : "", of.at[end][0], of.at[end][1], of.at[end][2]);
  }
  return text;
}
std::string replaced_in(std::string text, std::string_view from, std::string_view to) {
  const std::size_t at = text.find(from);
  CHECK(at != text.npos);
  return text.replace(at, from.size(), to);
}
}  // namespace

TEST("a nozzle is where its motors bring it, and its slopes are finite differences'") {
  for (const bool rotary : {false, true})
    for (unsigned seed = 1; seed < 6; ++seed) {
      const Made of = made(rotary, seed);
      const Delta& delta = of.printer.delta;
      const Vector p = of.truth.head(delta.count());
      for (const Reading& reading : of.printer.readings) {
        Matrix slopes;
        const Vector3 x = delta.position(p, reading.at[0], &slopes);
        CHECK_NEAR((delta.steps(p, x) - reading.at[0]).norm(), 0, 1e-6);
        CHECK_NEAR((delta.slopes(p, x) - slopes).norm(), 0, 1e-9);
        for (int k = 0; k < delta.count(); ++k) {
          const double h = 1e-6;
          Vector more = p, less = p;
          more[k] += h;
          less[k] -= h;
          const Vector3 slope =
              (delta.position(more, reading.at[0]) - delta.position(less, reading.at[0])) / (2 * h);
          CHECK_NEAR((slopes.col(k) - slope).norm(), 0, 1e-8);
        }
      }
    }
}

TEST("the estimate is the minimum of its own cost, and its σ is that of its slopes") {
  for (const bool rotary : {false, true}) {
    const Made of = made(rotary, 3);
    const Assumed assumed;
    const Prior known =
        prior(of.printer, Config(), assumed, of.printer.theta[of.printer.delta.rod()]);
    const Estimate found = estimate(of.printer.delta, of.printer.readings, known, assumed);
    const auto cost = [&](const Vector& theta) {
      const Vector off = errors(of.printer.delta, theta, of.printer.readings).off;
      double sum = 0;
      for (Eigen::Index k = 0; k < off.size(); ++k)
        sum += std::pow(off[k] / assumed.noise(of.printer.readings[k].distance), 2);
      for (Eigen::Index k = 0; k < theta.size(); ++k)
        if (known.sigma[k] > 0) sum += std::pow((theta[k] - known.mean[k]) / known.sigma[k], 2);
      return sum;
    };
    const double least = cost(found.theta);
    for (Eigen::Index j = 0; j < found.u.size(); ++j) {
      const Vector step = 0.1 * std::sqrt(found.P(j, j)) * found.S.col(j);
      const Vector more = found.theta + step, less = found.theta - step;
      const double slope = (cost(more) - cost(less)) / 0.2,
                   bend = cost(more) + cost(less) - 2 * least;
      CHECK_NEAR(slope, 0, 0.02 * bend / 0.01 + 1e-6);  // a hundredth of its own σ
      CHECK_NEAR(bend / (0.02 * found.P.inverse()(j, j) * found.P(j, j)), 1, 0.02);
    }
  }
}

TEST("sampled printers are within their stated σ") {
  for (const bool rotary : {false, true})
    for (const bool distances : {false, true}) {
      const long count = check::sample_size(25);
      long inside = 0, all = 0;
      double chi2 = 0;
      for (long k = 0; k < count; ++k) {
        const Made of = made(rotary, unsigned(100 + k), 13, distances);
        const Assumed assumed;
        const Prior known =
            prior(of.printer, Config(), assumed, of.printer.theta[of.printer.delta.rod()]);
        const Estimate found = estimate(of.printer.delta, of.printer.readings, known, assumed);
        const Vector off = found.u - found.S.colPivHouseholderQr().solve(of.truth - known.mean);
        for (Eigen::Index j = 0; j < off.size(); ++j) {
          inside += std::fabs(off[j]) < 1.96 * std::sqrt(found.P(j, j));
          ++all;
        }
        chi2 += off.dot(found.P.inverse() * off);
      }
      CHECK_NEAR(double(inside) / double(all), 0.95, 0.04);
      CHECK_NEAR(chi2 / double(all), 1, 0.3);
    }
}

TEST("Student's t and χ² have the tables' quantiles") {
  CHECK_NEAR(student_tails(2.776445, 4), 0.05, 1e-7);
  CHECK_NEAR(student_tails(0.1, 4), 0.92515, 1e-4);
  CHECK_NEAR(student_beyond(0.005, 10), 3.169273, 1e-6);
  CHECK_NEAR(chi2_tail(3.841459, 1), 0.05, 1e-7);
  CHECK_NEAR(chi2_tail(18.307038, 10), 0.05, 1e-7);
  CHECK_NEAR(chi2_tail(23.589351, 9), 0.005, 1e-7);
}

TEST("one wrong height of many is the outlier, and correct ones are not rejected") {
  for (const unsigned seed : {1u, 2u, 3u, 4u})
    for (const double off : {0.0, 0.35 * kMm}) {
      Made of = made(false, seed, 25);
      of.printer.readings[9].value += off;
      const Assessment found = assess(text_of(of.printer), {});
      CHECK(found.config.error.empty());
      CHECK(found.judged.wrong == (off > 0 ? 9 : -1));
      CHECK(found.rely == (off == 0));
      CHECK(found.verdict.starts_with("Do not rely") == (off > 0));
    }
}

TEST("a reading that is left out does not help to predict itself") {
  Made of = made(false, 6);
  const auto off = [&] {
    const Assessment found = assess(text_of(of.printer), {});
    std::vector<double> values;
    for (const Residuals& way : found.held_out) values.push_back(way.off[16]);
    return values;
  };
  const std::vector<double> before = off();
  of.printer.readings[16].value += 0.2 * kMm;
  const std::vector<double> after = off();
  CHECK(before.size() == 5);
  for (std::size_t k = 0; k < before.size(); ++k)
    CHECK_NEAR(after[k] - before[k], -0.2 * kMm, before.size() == k + 2 ? 2e-6 : 2e-8);
}

TEST("what is written is read again, and the same readings never count twice") {
  for (const bool rotary : {false, true}) {
    const std::string text =
        "#keep: me\r\n" + replaced_in(text_of(made(rotary, 5).printer), "\n", "\r\n");
    const Assessment first = assess(text, {});
    const std::string written =
        rewritten(first.config, changes_of(first), nominal_to_keep(first.prior, first.printer));
    CHECK(written.starts_with("#keep: me"));
    const Assessment again = assess(written, {});
    CHECK(again.config.error.empty());
    CHECK_NEAR(
        (again.printer.theta - first.estimate.theta).head(first.printer.delta.count()).norm(), 0,
        1e-8);
    CHECK_NEAR(again.prior.arm, first.prior.arm, 1e-9);
    CHECK_NEAR((again.estimate.theta - first.estimate.theta).norm(), 0, 1e-6);
    CHECK(again.verdict.starts_with("Keep the file's parameters"));
  }
}

TEST("a height's weight is Klipper's: heights by hand do not count") {
  Readings readings = made(false, 1, 7).printer.readings;
  const auto weight = [&] { return std::pow(klipper_weights(readings)[0], 2); };
  CHECK_NEAR(weight(), 12 / (0.5 * 7), 1e-12);
  CHECK_NEAR(klipper_weights(heights_only(readings))[0], 1, 0);
  readings[0].probed = readings[1].probed = false;
  CHECK_NEAR(weight(), 12 / (0.5 * 5), 1e-12);
}

TEST("where a print is on the bed is no error, and has no σ") {
  const Made of = made(false, 1);
  const Assessment found = assess(text_of(of.printer), {});
  Vector turned = found.estimate.theta;
  turned.segment<3>(found.printer.delta.angle()).array() += 0.001;
  const Bed bed = over_the_bed(found.printer.delta, turned, found.estimate, found.printer.radius);
  for (const Vector3& offset : bed.offset)
    CHECK_NEAR(offset.norm(), 0, 1e-6 * found.printer.radius);
  Estimate loose = found.estimate;  // little is known of a common turn of the towers
  Vector turn = Vector::Zero(loose.theta.size());
  turn.segment<3>(found.printer.delta.angle()).setConstant(0.01);
  loose.covariance += turn * turn.transpose();
  const Bed same =
      over_the_bed(found.printer.delta, found.estimate.theta, loose, found.printer.radius);
  for (std::size_t k = 0; k < same.points.size(); ++k)
    CHECK_NEAR((same.sigma[k] - found.after.sigma[k]).norm(), 0, 1e-9);
}

TEST("a value of the file itself counts more than the saved one, and a note says so") {
  const std::string text = text_of(made(false, 1).printer);
  const Assessment found =
      assess(replaced_in(text, "[stepper_b]\n", "[stepper_b]\nangle: 330.1\n"), {});
  CHECK_NEAR(found.printer.theta[2] / kDegree, 330.1, 1e-12);
  CHECK(found.notes.size() == 1);
  CHECK(
      found.notes.front() ==
      "[stepper_b] angle stands twice: 330.1 counts, as in Klipper, and not the saved 330.000000");
}

TEST("the lines to send level a Marlin or RepRapFirmware printer") {
  for (const bool marlin : {true, false}) {
    const Made of = made(false, 8, 7, false);
    const Delta& delta = of.printer.delta;
    const Vector truth = of.truth.head(delta.count());
    std::string text, heights;
    for (const std::string& line : lines_to_send(of.printer.theta, marlin))
      text += "echo: " + line + " ; mine\n";
    int number = 0;
    for (const Vector3& at : spread(13, 100 * kMm)) {
      const Vector3 seen = delta.position(of.printer.theta, delta.steps(truth, at)) / kMm;
      text += marlin ? format("Recv: Bed X: %.5f Y: %.5f Z: %.5f\n", seen[0], seen[1], seen[2])
                     : format("G30 P%d X%.5f Y%.5f Z-99999\n", number++, seen[0], seen[1]);
      heights += format(" %.5f", seen[2]);
    }
    if (!marlin) text += "G32 bed probe heights:" + heights + ", mean 0.0\n";
    const Assessment found = assess(text, {});
    CHECK(found.config.kind == (marlin ? "marlin" : "rrf"));
    for (const Reading& reading : found.printer.readings)  // stable positions are the true ones
      CHECK_NEAR(found.printer.delta.position(truth, reading.at[0])[2], 0, 2e-6);
    std::string sent;
    for (const std::string& line : lines_to_send(found.estimate.theta, marlin)) sent += line + "\n";
    Config config =
        read(sent + (marlin ? "Bed X: 0 Y: 0 Z: 0" : "G30 P0 X0 Y0\nbed probe heights: 0"), 0);
    CHECK_NEAR((printer_of(config).theta - found.estimate.theta).cwiseAbs().maxCoeff(), 0, 2e-5);
  }
}

TEST("a plan promises what the estimate then states") {
  const Made of = made(false, 2, 7);
  Request request;
  request.next = 6;
  const Assessment found = assess(text_of(of.printer), request);
  Printer more = found.printer;
  for (std::size_t k = 1; k < found.plan.size(); ++k) {
    const Planned& planned = found.plan[k];
    Reading reading{"planned", planned.distance, !planned.distance, 0, {}};
    for (int end = 0; end < 2; ++end)
      reading.at[end] = more.delta.steps(found.estimate.theta, planned.at[end]);
    reading.value = 0;
    reading.value = errors(more.delta, found.estimate.theta, {reading}).off[0] * planned.distance;
    more.readings.push_back(reading);
    CHECK((planned.sigma.norm() < found.plan[k - 1].sigma.norm()));
  }
  const Estimate then = estimate(more.delta, more.readings, found.prior, found.found_noise);
  const std::vector<Planned> promised = next_readings(more, then, found.found_noise, 0, 0);
  for (int i = 0; i < 3; ++i)
    CHECK_NEAR(promised[0].sigma[i] / found.plan.back().sigma[i], 1, 0.02);
}

TEST("a step distance that is wrong by a factor is named") {
  const std::string text =
      replaced_in(text_of(made(false, 4, 7, false).printer), "microsteps: 16", "microsteps: 8");
  CHECK(assess(text, {}).config.error.starts_with(
      "[delta_calibrate] stepper_a: its step is 2 times the true one"));
}

TEST("steps of all motors that were changed after the calibration are named") {
  const Made of = made(false, 4, 7, false);
  Printer as_true = of.printer;
  as_true.theta = of.truth;
  std::string text = text_of(as_true);
  CHECK(assess(text, {}).config.error.empty());
  Printer moved = as_true;  // endstops that were all moved alike are no such change
  moved.theta.segment<3>(moved.delta.endstop()).array() += 5 * kMm;
  CHECK(assess(text_of(moved), {}).config.error.empty());
  for (const char* turn : {"20", "32", "60", "80"}) {
    text = text_of(as_true);
    for (int i = 0; i < 3; ++i)
      text = replaced_in(text, "rotation_distance: 40\n", format("rotation_distance: %s \n", turn));
    CHECK(assess(text, {}).config.error.starts_with("[delta_calibrate] the steps of all motors"));
  }
}

TEST("equal rods in the lines of a firmware with one length fit the readings as well") {
  const Made of = made(false, 8, 13, false);
  const Assessment found = assess(text_of(of.printer), {});
  const Delta& delta = found.printer.delta;
  const Vector p = with_equal_rods(found.estimate, delta);
  CHECK_NEAR(p[delta.rod()], p[delta.rod() + 2], 1e-12);
  CHECK(rms(errors(delta, p, found.printer.readings).off) < 1.5 * rms(found.fits[2].off));
}

TEST(
    "any text is a printer or one line, and the answer fits the caller's memory or says its size") {
  check::Random random(1);
  const std::string whole = text_of(made(false, 1, 7).printer);
  const std::string log =
      "Stats 1.0: <b>a</b>\n===== Config file =====\n" + whole + "=======================\nStats\n";
  std::vector<std::string> texts{"",
                                 "[",
                                 "#*#",
                                 "\xff\xfe",
                                 "M665 L",
                                 "===== Config file =====\n",
                                 log,
                                 log.substr(0, 700),
                                 "M665 L200 R100\nBed X: 0 Y: 0 Z: 0",
                                 "M665 L90 R100 H200\nBed X: 0 Y: 0 Z: 0",
                                 "M665 L200 R100 H200\nBed probe heights: 0.1 0.2",
                                 "G33\n.Height:\nM665 L200:1 R100 H200\n x:1 x:1\nM502\nc:0",
                                 "M665L200 R100 H2 A B:\nG30 P\nEndstop adjustments X,\nG31 X",
                                 std::string(2000000, 'x'),
                                 std::string(10000000, '\n') + log};
  const long count = check::sample_size(60);
  for (long k = 0; k < count; ++k) {
    std::string text = whole;
    const auto any = [&](std::size_t size) {
      return std::size_t(0.4999999 * (random() + 1) * double(size));
    };
    constexpr const char* words[] = {"[printer]", "#*#", "-", "9e99",         "nan",
                                     "\n",        "0",   ",", "rotary_delta", "\xc3"};
    text.replace(any(text.size()), any(4), words[any(10)]);
    texts.push_back(text);
  }
  long refused = 0;
  for (const std::string& text : texts) {
    std::vector<char> json(1);
    const int size = truepose_printer(text.data(), text.size(), nullptr, json.data(), json.size());
    json.assign(std::size_t(size) + 1, '@');
    CHECK(truepose_printer(text.data(), text.size(), nullptr, json.data(), std::size_t(size)) ==
          size);
    const std::string said(json.data(), std::size_t(size));
    CHECK(json.back() == '@' && said.front() == '{' && said.back() == '}');
    CHECK(said.find_first_of("\n<") == said.npos);
    refused += said.starts_with("{\"error\":");
  }
  CHECK(refused > 10 && refused < long(texts.size()) - 5);
}
