// Delta printers: statistics, plans and answers, of real printers' files; others: test_klipper.py.
#include <fstream>
#include <iterator>

#include "check.hpp"
#include "truepose/printers.h"
#include "truepose/printers/answer.hpp"

using namespace truepose::printers;

namespace {
/// A real printer's file.
string real(const string& name = "phnxdrgn536") {
  std::ifstream file(DATA "/" + name + ".cfg");
  return {std::istreambuf_iterator<char>(file), {}};
}
}  // namespace

TEST("Student's t and χ² have the tables' quantiles") {
  CHECK_NEAR(student_tails(2.776445, 4), 0.05, 1e-7);
  CHECK_NEAR(student_tails(0.1, 4), 0.92515, 1e-4);
  CHECK_NEAR(student_beyond(0.005, 10), 3.169273, 1e-6);
  CHECK_NEAR(chi2_tail(3.841459, 1), 0.05, 1e-7);
  CHECK_NEAR(chi2_tail(18.307038, 10), 0.05, 1e-7);
  CHECK_NEAR(chi2_tail(23.589351, 9), 0.005, 1e-7);
}

TEST("a reading that is left out does not help to predict itself") {
  const auto off = [&](string_view distance) {
    const Assessment found = assess(replaced(real(), "distance9 = 65.07", distance), {});
    vector<double> values;
    for (const Residuals& way : found.held_out) values.push_back(way.off[16]);
    return values;
  };
  const vector<double> before = off("distance9 = 65.07"), after = off("distance9 = 65.27");
  CHECK(before.size() == 5);
  for (size_t k = 0; k < before.size(); ++k)
    CHECK_NEAR(after[k] - before[k], -0.2 * kMm, before.size() == k + 2 ? 2e-6 : 2e-8);
}

TEST("a height's weight is Klipper's: heights by hand do not count") {
  Readings readings(7, Reading{"height", false, true});
  CHECK_NEAR(klipper_weights(readings)[0], 1, 0);
  readings.resize(19, Reading{"distance", true, false});
  const auto weight = [&] { return pow(klipper_weights(readings)[0], 2); };
  CHECK_NEAR(weight(), 12 / (0.5 * 7), 1e-12);
  readings[0].probed = readings[1].probed = false;
  CHECK_NEAR(weight(), 12 / (0.5 * 5), 1e-12);
}

TEST("where a print is on the bed is no error, and has no σ") {
  const Assessment found = assess(real(), {});
  const Delta& delta = found.printer.delta;
  Vector turned = found.estimate.theta;
  turned.segment<3>(delta.angle()).array() += 0.001;
  const Bed bed = over_the_bed(delta, turned, found.estimate, found.printer.radius);
  for (const Vector3& offset : bed.offset)
    CHECK_NEAR(offset.norm(), 0, 1e-6 * found.printer.radius);
  Estimate loose = found.estimate;  // little is known of a common turn of the towers
  Vector turn = Vector::Zero(loose.theta.size());
  turn.segment<3>(delta.angle()).setConstant(0.01);
  loose.covariance += turn * turn.transpose();
  const Bed same = over_the_bed(delta, found.estimate.theta, loose, found.printer.radius);
  for (size_t k = 0; k < same.points.size(); ++k)
    CHECK_NEAR((same.sigma[k] - found.after.sigma[k]).norm(), 0, 1e-9);
}

TEST("the lines to send are read as the estimate, with equal rods where the firmware has one") {
  for (const Dialect& to : kDialects)
    for (const bool own_rods : {true, false}) {
      const Assessment found = assess(real("fzechert"), {});
      const Delta& delta = found.printer.delta;
      const Vector p = own_rods ? found.estimate.theta : with_equal_rods(found.estimate, delta);
      CHECK(rms(off_by(found.printer, p)) < 1.5 * rms(found.fits[2]));
      string sent;
      for (const string& line : lines_to_send(p, to, own_rods)) sent += line + "\n";
      constexpr const char* probed[] = {"Bed X: 0 Y: 0 Z: 0", "G30 P0 X0 Y0\nbed probe heights: 0",
                                        "PROBE: X0, Y0, Z0", "Z-probe:0 X:0 Y:0"};
      Config config = read(sent + probed[&to - kDialects], 0);
      CHECK(config.kind == to.kind);
      CHECK_NEAR((printer_of(config).theta - p).cwiseAbs().maxCoeff(), 0, 2e-5);
    }
}

TEST("a plan promises what the estimate then states") {
  Request request;
  request.next = 6;
  const Assessment found = assess(real(), request);
  Printer more = found.printer;
  for (size_t k = 1; k < found.plan.size(); ++k) {
    const Planned& planned = found.plan[k];
    Reading reading{"planned", planned.distance, !planned.distance, 0, {}};
    for (int end = 0; end < 2; ++end)
      reading.at[end] = more.delta.steps(found.estimate.theta, planned.at[end]);
    reading.value = errors(more.delta, found.estimate.theta, {reading}).off[0];
    more.readings.push_back(reading);
    CHECK(planned.sigma.norm() < found.plan[k - 1].sigma.norm());
  }
  const Estimate then = estimate(more.delta, more.readings, found.prior, found.found_noise);
  const vector<Planned> promised = next_readings(more, then, found.found_noise, 0, 0);
  for (int i = 0; i < 3; ++i)
    CHECK_NEAR(promised[0].sigma[i] / found.plan.back().sigma[i], 1, 0.02);
}

TEST(
    "any text is a printer or one line, and the answer fits the caller's memory or says its size") {
  check::Random random(1);
  const string whole = real(), start = "===== Config file =====\n",
               end = "=======================\n";
  const string log = "Stats 1.0: <b>a</b>\n" + start + whole + end + "Stats\n";
  vector<string> texts{real("cupsster"),
                       real("danorder-v400"),
                       "",
                       "[",
                       "#*#",
                       "\xff\xfe",
                       "M665 L",
                       start,
                       log,
                       log.substr(0, 700),
                       "M665 L200 R100\nBed X: 0 Y: 0 Z: 0",
                       "M665 L90 R100 H200\nBed X: 0 Y: 0 Z: 0",
                       "M665 L200 R100 H200\nBed probe heights: 0.1 0.2",
                       "G33\n.Height:\nM665 L200:1 R100 H200\n x:1 x:1\nM502\nc:0",
                       "M665L200 R100 H2 A B:\nG30 P\nEndstop adjustments X,\nG31 X",
                       "M665 L200 R100 H200\nheight map file\nx\n1,2,3,4,5,6,7,8\n0,1,x,\n1,1",
                       "arm_radius 100\narm_length 200\nM665 Z200\nG29.1\nX1 Y Z2\nX:1 A: B:",
                       "EPR:3 881 200\nEPR:\nEPR:3\nM206 X\nZ-probe:1 X:1 zCorr:1",
                       string(2000000, 'x'),
                       string(10000000, '\n') + log};
  const long count = check::sample_size(60);
  for (long k = 0; k < count; ++k) {
    string text = whole;
    const auto any = [&](size_t size) { return size_t(0.4999999 * (random() + 1) * double(size)); };
    constexpr const char* words[] = {"[printer]", "#*#", "-", "9e99",         "nan",
                                     "\n",        "0",   ",", "rotary_delta", "\xc3"};
    text.replace(any(text.size()), any(4), words[any(10)]);
    texts.push_back(text);
  }
  long refused = 0;
  for (const string& text : texts) {
    vector<char> json(1);
    const int size = truepose_printer(text.data(), text.size(), nullptr, json.data(), json.size());
    json.assign(size_t(size) + 1, '@');
    CHECK(truepose_printer(text.data(), text.size(), nullptr, json.data(), size_t(size)) == size);
    const string said(json.data(), size_t(size));
    CHECK(json.back() == '@' && said.front() == '{' && said.back() == '}');
    CHECK(said.find_first_of("\n<") == said.npos);
    refused += said.starts_with("{\"error\":");
  }
  CHECK(refused > 10 && refused < long(texts.size()) - 5);
}
