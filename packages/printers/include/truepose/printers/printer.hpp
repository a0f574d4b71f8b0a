// A delta printer from its configuration: parameters, step distances, saved readings.
//
// A *stable position*, Klipper's term, is the number of steps of each motor down from its endstop;
// it identifies a pose of the machine for any parameters. m, rad.
#pragma once

#include "truepose/printers.h"
#include "truepose/printers/config.hpp"
#include "truepose/printers/delta.hpp"

namespace truepose::printers {
/// Of the towers, degrees, unless the file says otherwise: linear, rotary.
constexpr double kTurns[][3] = {{210, 330, 90}, {30, 150, 270}};
constexpr double kApart = 5 * kMm;     ///< largest plausible difference between arms
constexpr double kManual = 0.1 * kMm;  ///< heights probed by hand are 0, or the paper's thickness
constexpr int kFewest = 3;             ///< heights that Klipper accepts
constexpr int kMostReadings = 999;     ///< of each kind, in Klipper
constexpr char kTakeOut[] = "take it out and number those behind it on";
constexpr char kSection[] = "delta_calibrate";

/// Name, unit and usual value of each assumed σ, in the order of truepose/printers.h.
constexpr struct {
  const char *name, *unit;
  double scale, usual;
} kSigma[] = {
    {"arm", "mm", kMm, 0.5},        // of each rod or arm from nominal
    {"angle", "°", kDegree, 0.25},  // of towers a and b against c: 0.7 mm on 160
    {"radius", "mm", kMm, 5},       // includes the nacelle's own radius; no nominal value
    {"endstop", "mm", kMm, 2},      // and height of a rotary delta's shoulders
    {"height", "mm", kMm, 0.04},    // of probe and flatness of the bed; re-estimated
    {"distance", "mm", kMm, 0.04},  // of a calliper on a print; re-estimated
    {"shrinkage", "%", 0.01, 0.2},  // κ
    {"width", "mm", kMm, 0.05},     // b: remaining error of the pillars' widths
};

/// A parameter's name, place in the file, and which assumed σ it has.
struct Option {
  string name;
  Place place;
  int kind;
  bool angle() const { return kind == TRUEPOSE_PRINTER_ANGLE; }
  double scale() const { return kSigma[kind].scale; }
};

/// The parameters of a kind of printer in the order of theta, by their names in Klipper's log; then
/// κ and b, which are in no file.
inline vector<Option> options(bool rotary) {
  vector<Option> result;
  const auto common = [&](const char* name, const char* option, int kind) {
    result.push_back({name, {"printer", option}, kind});
  };
  const auto each = [&](const string& name, const char* option, int kind) {
    for (const char tower : {'a', 'b', 'c'})
      result.push_back({name + "_" + tower, {string("stepper_") + tower, option}, kind});
  };
  if (rotary) {
    common("shoulder_radius", "shoulder_radius", TRUEPOSE_PRINTER_ARM);
    common("shoulder_height", "shoulder_height", TRUEPOSE_PRINTER_ENDSTOP);
  } else {
    common("radius", "delta_radius", TRUEPOSE_PRINTER_RADIUS);
  }
  each("angle", "angle", TRUEPOSE_PRINTER_ANGLE);
  if (rotary) each("upper_arm", "upper_arm_length", TRUEPOSE_PRINTER_ARM);
  each(rotary ? "lower_arm" : "arm", rotary ? "lower_arm_length" : "arm_length",
       TRUEPOSE_PRINTER_ARM);
  each("endstop", "position_endstop", TRUEPOSE_PRINTER_ENDSTOP);
  for (const int kind : {TRUEPOSE_PRINTER_SHRINKAGE, TRUEPOSE_PRINTER_WIDTH})
    common(kSigma[kind].name, "", kind);
  return result;
}

/// Assumed σ of build and measurements, the same for all printers; m, rad, κ without unit.
struct Assumed {
  double sigma[TRUEPOSE_PRINTER_SIGMAS];  ///< in the order of truepose/printers.h

  /// Those given, in the units of kSigma, where they are above 0.
  Assumed(const double* given = nullptr) {
    for (int k = 0; k < TRUEPOSE_PRINTER_SIGMAS; ++k)
      sigma[k] = kSigma[k].scale * (given && given[k] > 0 ? given[k] : kSigma[k].usual);
  }
  /// σ of theta; 0: fixed.
  Vector of(const Delta& delta) const {
    Vector all(delta.count() + 2);
    for (int k = 0; const Option& option : options(delta.rotary)) all[k++] = sigma[option.kind];
    all[delta.angle() + 2] = 0;  // tower c defines the axes of x and y
    return all;
  }
  double noise(bool distance) const { return sigma[TRUEPOSE_PRINTER_HEIGHT + distance]; }
  string text() const {
    string all;
    for (int k = 0; k < TRUEPOSE_PRINTER_SIGMAS; ++k)
      all += format("%s%s %g%s%s", k ? ", " : "", kSigma[k].name, sigma[k] / kSigma[k].scale,
                    k == TRUEPOSE_PRINTER_ANGLE ? "" : " ", kSigma[k].unit);
    return all;
  }
};

/// A height of the bed at a stable position, or a distance between the nozzle's positions at two.
struct Reading {
  string name;
  bool distance = false, probed = false;
  double value = 0;
  Vector3 at[2] = {Vector3::Zero(), Vector3::Zero()};
};
using Readings = vector<Reading>;  ///< heights first

inline int heights_of(const Readings& readings) {
  return int(std::count_if(readings.begin(), readings.end(),
                           [](const Reading& of) { return !of.distance; }));
}
inline Readings heights_only(const Readings& readings) {
  return Readings(readings.begin(), readings.begin() + heights_of(readings));
}

/// A printer as described by its file.
struct Printer {
  Delta delta;
  vector<Option> options;
  Vector theta;     ///< p, then κ and b, which are 0
  Vector nominal;   ///< of parameters that the file keeps as comments, else NaN
  double arm = 0;   ///< nominal length of the arms (of a rotary delta, the lower ones), m
  string arm_said;  ///< source of that length
  Assumed assumed;
  Readings readings;
  double radius = 0;  ///< of the printed or probed bed
  vector<string> gaps, notes;
};

inline double median(vector<double> values) {
  if (values.empty()) return kNaN;
  const size_t half = values.size() / 2;
  std::sort(values.begin(), values.end());
  return values.size() % 2 ? values[half] : 0.5 * (values[half - 1] + values[half]);
}

/// Set the nominal values, which stand in comments. Those of a rotary delta have a prefix:
/// SAVE_CONFIG itself comments out roughly set options, such as endstops.
constexpr char kNominal[] = "drawn_";
inline void read_nominal(const Config& config, Printer& printer) {
  const Delta& delta = printer.delta;
  printer.nominal.setConstant(delta.count(), kNaN);
  Vector3 rods = printer.theta.segment<3>(delta.rod());
  std::sort(rods.begin(), rods.end());
  double was = kNaN;
  bool by_hand = false;
  for (int k = delta.count(); k-- > 0;) {
    const Option& of = printer.options[k];
    const auto commented = [&](const string& option) {
      const auto at = config.off.find({of.place.first, option});
      const double share =
          at == config.off.end() ? kNaN : of.scale() * at->second / printer.theta[k];
      return share > 0.5 && share < 2 ? share * printer.theta[k] : kNaN;  // plausible ones
    };
    printer.nominal[k] = commented(kNominal + of.place.second);
    if (k < delta.rod() || k >= delta.endstop()) continue;
    const auto saved = config.saved.find(of.place);
    by_hand = by_hand || (config.has(of.place) && (saved == config.saved.end() ||
                                                   saved->second != config.values.at(of.place)));
    const double value = commented(of.place.second);
    if (isnan(value)) continue;
    was = value;
    const double now = printer.theta[k] / kMm;
    printer.arm_said =
        "[" + of.place.first + "] " + of.place.second + " before " +
        (fabs(now - value / kMm) < 1e-6 ? string("it was replaced")
                                        : format("SAVE_CONFIG's %.7g replaced it", now));
  }
  if (!by_hand && !isnan(was)) {
    printer.arm = was;
    return;
  }
  printer.arm = rods[1];
  printer.arm_said = (rods[0] == rods[2] ? string("the file, which has one for all")
                                         : "the middle one of the file's: --arm says better") +
                     (isnan(was) ? "" : format("; the commented %.7g does not count", was / kMm));
}

/// A message if the arms differ implausibly, else empty.
inline string unlike_arms(const Delta& delta, const Vector& p) {
  const Vector3 arms = p.segment<3>(delta.rod()) / kMm;
  const double apart = arms.maxCoeff() - arms.minCoeff();
  if (!(apart > kApart / kMm)) return {};
  return format(
      "arms of %.1f, %.1f, %.1f mm differ by %.0f mm: no printer's rods do. A criterion "
      "moved them along a combination that its readings do not determine",
      arms[0], arms[1], arms[2], apart);
}

/// Set the readings, and a note on each missing number.
inline void read_readings(Config& config, Printer& printer) {
  Readings& readings = printer.readings;
  for (const char* stem : {"manual_height", "height", "distance"}) {
    const auto place = [&](int k, const char* more = "") {
      return Place(kSection, stem + to_string(k) + more);
    };
    int count = 0, last = 0;
    while (config.has(place(count))) ++count;
    for (int k = count; k <= kMostReadings; ++k)
      if (config.has(place(k))) last = k;
    if (last)
      printer.gaps.push_back(place(count).second + " is missing: as in Klipper none behind it " +
                             "counts, " + place(last).second + " neither");
    for (int k = 0; k < min(count, kMostReadings); ++k) {
      Reading of{place(k).second, stem[0] == 'd', stem[0] == 'h'};
      if (of.probed && size_t(k) < config.names.size()) of.name = config.names[size_t(k)];
      of.value = kMm * config.number(place(k), of.distance ? 0 : -kLargest);
      for (int end = 0; end <= of.distance; ++end) {
        const Place at = place(k, !of.distance ? "_pos" : end ? "_pos2" : "_pos1");
        const vector<string> parts = parts_of(config.word(at), ',');
        if (parts.size() != 3) config.fail(at, "must be 3 numbers with commas between");
        for (size_t i = 0; i < 3 && config.error.empty(); ++i)
          of.at[end][i] = config.checked(at, parts[i]);
      }
      for (const Reading& other : readings)  // would count twice
        if (other.distance == of.distance &&
            ((other.at[0] == of.at[0] && other.at[1] == of.at[1]) ||
             (other.at[0] == of.at[1] && other.at[1] == of.at[0])))
          config.fail(place(k),
                      "at the same place as " + other.name + ", digit for digit: " + kTakeOut);
      if (of.distance && of.at[0] == of.at[1])
        config.fail(place(k), string("from a point to itself: ") + kTakeOut);
      if (!config.error.empty()) return;
      readings.push_back(of);
    }
  }
}

/// The motion of one step: m, or rad of a rotary delta's arm.
inline double step_of(Config& config, const string& section, bool rotary) {
  const Place ratio(section, "gear_ratio"), rotation(section, "rotation_distance"),
      step(section, "step_distance");
  const double unit = rotary ? 2 * 180 * kDegree : kMm;
  if (config.has(step) && !config.has(ratio) && !config.has(rotation))
    return (rotary ? 1 : kMm) * config.number(step, 0);  // Klipper before 2021
  double turn = unit * (rotary ? 1 : config.number(rotation, 0));
  for (const char* option : {"full_steps_per_rotation", "microsteps"}) {
    const Place place(section, option);
    const bool usual = option[0] == 'f' && !config.has(place);
    const double count = usual ? 200 : config.number(place, 0);
    if (count != std::floor(count)) config.fail(place, "must be a whole number");
    turn /= count;
  }
  if (rotary || config.has(ratio))
    for (const string& gears : parts_of(config.word(ratio), ',')) {
      const vector<string> of = parts_of(gears, ':');
      if (of.size() != 2) config.fail(ratio, "must be pairs of numbers, as 80:16, 2:1");
      if (config.error.empty())
        turn *= config.checked(ratio, of[1], 0) / config.checked(ratio, of[0], 0);
    }
  return turn;
}

/// The printer of a configuration. Config::error has section, option, value and what is allowed.
inline Printer printer_of(Config& config) {
  Printer printer;
  Delta& delta = printer.delta;
  const string kinematics = config.word({"printer", "kinematics"});
  delta.rotary = kinematics == "rotary_delta";
  if (!delta.rotary && kinematics != "delta")
    config.fail("[printer] kinematics: unknown kinematics '" + one_line(kinematics) +
                "' (choices: delta, rotary_delta)");
  printer.options = options(delta.rotary);
  printer.theta.setZero(delta.count() + 2);
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = printer.options[k];
    Place place = of.place;
    if (!config.has(place) && place.first != "printer") place.first = "stepper_a";  // as in Klipper
    printer.theta[k] =
        of.scale() * (of.angle() && !config.has(of.place) ? kTurns[delta.rotary][k - delta.angle()]
                      : of.angle()                        ? config.number(of.place)
                                                          : config.number(place, 0));
  }
  for (int i = 0; i < 3; ++i) {
    const Place& end = printer.options[delta.endstop() + i].place;
    delta.step[i] = step_of(config, end.first, delta.rotary);
    if (isnan(delta.homed(printer.theta, i)))
      config.fail(end,
                  format("the arm of %g mm does not reach the middle there; are all lengths mm?",
                         printer.theta[delta.rod() + i] / kMm));
  }
  read_nominal(config, printer);
  read_readings(config, printer);
  printer.radius = delta.rotary ? printer.theta[delta.upper()] / 2 : 0.8 * printer.theta[0];
  for (const Place& place : {Place("printer", "print_radius"), Place(kSection, "radius")})
    if (config.has(place)) printer.radius = kMm * config.number(place, 0);

  vector<string>& notes = printer.notes = config.notes;
  notes.insert(notes.end(), printer.gaps.begin(), printer.gaps.end());
  vector<double> probed;
  bool manual = true;
  for (const Reading& each : printer.readings)
    if (each.probed) {
      probed.push_back(each.value / kMm);
      manual = manual && fabs(each.value) <= kManual;
    }
  for (const char* probe :
       {"probe", "bltouch", "smart_effector", "probe_eddy_current", "beacon", "cartographer"})
    if (const Place place(probe, "z_offset"); config.has(place) && !manual) {
      const double z = config.number(place), middle = median(probed);
      if (fabs(z - middle) > 0.5)
        notes.push_back(
            format("[%s] z_offset = %.6g mm, but the heights were probed at %.6g mm: it was "
                   "changed since; z = 0 is off by that much for these readings",
                   probe, z, middle));
    }
  return printer;
}
}  // namespace truepose::printers
