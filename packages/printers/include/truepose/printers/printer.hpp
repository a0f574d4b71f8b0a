// A delta printer from its configuration: parameters, step distances, saved readings.
//
// A *stable position*, Klipper's term, is the number of steps of each motor down from its endstop;
// it identifies a pose of the machine for any parameters. m, rad.
#pragma once

#include "truepose/printers.h"
#include "truepose/printers/config.hpp"
#include "truepose/printers/delta.hpp"

namespace truepose::printers {
constexpr double kTurns[] = {210, 330, 90};  ///< of the towers, degrees
constexpr double kApart = 5 * kMm;           ///< largest plausible difference between arms
constexpr int kFewest = 3;                   ///< heights that Klipper accepts
constexpr int kMostReadings = 999;           ///< of each kind, in Klipper
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

/// Place of a parameter in the file, and which assumed σ it has.
struct Option {
  string name, section, option;
  int kind;
  bool angle() const { return kind == TRUEPOSE_PRINTER_ANGLE; }
  double scale() const { return kSigma[kind].scale; }
};

/// The parameters of a kind of printer in the order of theta, by their names in Klipper's log; then
/// κ and b, which are in no file.
inline vector<Option> options(bool rotary) {
  vector<Option> result;
  if (rotary)
    result = {{"shoulder_radius", "printer", "shoulder_radius", TRUEPOSE_PRINTER_ARM},
              {"shoulder_height", "printer", "shoulder_height", TRUEPOSE_PRINTER_ENDSTOP}};
  else
    result = {{"radius", "printer", "delta_radius", TRUEPOSE_PRINTER_RADIUS}};
  const auto each = [&](const char* name, const char* option, int kind) {
    for (const char tower : {'a', 'b', 'c'})
      result.push_back({string(name) + "_" + tower, string("stepper_") + tower, option, kind});
  };
  each("angle", "angle", TRUEPOSE_PRINTER_ANGLE);
  if (rotary) each("upper_arm", "upper_arm_length", TRUEPOSE_PRINTER_ARM);
  each(rotary ? "lower_arm" : "arm", rotary ? "lower_arm_length" : "arm_length",
       TRUEPOSE_PRINTER_ARM);
  each("endstop", "position_endstop", TRUEPOSE_PRINTER_ENDSTOP);
  for (const int kind : {TRUEPOSE_PRINTER_SHRINKAGE, TRUEPOSE_PRINTER_WIDTH})
    result.push_back({kSigma[kind].name, "", "", kind});
  return result;
}

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
  Vector theta;  ///< p, then κ and b, which are 0
  Readings readings;
  double radius = 0;  ///< of the printed or probed bed
  vector<string> notes;
};

/// A message if the arms differ implausibly, else empty.
inline string unlike_arms(const Delta& delta, const Vector& p) {
  const auto arms = p.segment<3>(delta.rod()).array() / kMm;
  const double apart = arms.maxCoeff() - arms.minCoeff();
  if (!(apart > kApart / kMm)) return {};
  return format(
      "arms of %.1f, %.1f, %.1f mm differ by %.0f mm: no printer's rods do. A criterion "
      "moved them along a combination that its readings do not determine",
      arms[0], arms[1], arms[2], apart);
}

/// Notes on each missing number among the readings of a kind, or of all.
inline vector<string> gaps(const Config& config, vector<string> stems) {
  vector<string> notes;
  for (const string& stem : stems) {
    int last = -1;
    for (int k = 0; k <= kMostReadings; ++k)
      if (config.has(kSection, stem + to_string(k))) last = k;
    for (int k = 0; k < last; ++k)
      if (!config.has(kSection, stem + to_string(k))) {
        notes.push_back(stem + to_string(k) + " is missing: as in Klipper none behind it counts, " +
                        stem + to_string(last) + " neither");
        break;
      }
  }
  return notes;
}

inline Readings readings_of(Config& config) {
  Readings readings;
  for (const char* stem : {"manual_height", "height", "distance"})
    for (int k = 0; k < kMostReadings && config.error.empty(); ++k) {
      Reading of{stem + to_string(k)};
      if (!config.has(kSection, of.name)) break;
      of.distance = stem[0] == 'd';
      of.probed = stem[0] == 'h';
      of.value = kMm * config.number(kSection, of.name, of.distance ? 0 : -kLargest);
      for (int end = 0; end <= of.distance; ++end) {
        const string option = of.name + (of.distance ? end ? "_pos2" : "_pos1" : "_pos");
        const auto parts = config.parts(config.word(kSection, option), ',');
        if (parts.size() != 3)
          config.fail(kSection, option, "must be 3 numbers with commas between");
        for (size_t i = 0; i < 3 && parts.size() == 3; ++i)
          of.at[end][i] = config.checked(kSection, option, parts[i]);
      }
      readings.push_back(of);
    }
  // A repeated stable position would count twice.
  using Ends = std::array<std::array<double, 3>, 2>;
  map<Ends, string> seen;
  for (const Reading& of : readings) {
    Ends ends;
    for (size_t k = 0; k < 2; ++k)
      for (size_t i = 0; i < 3; ++i) ends[k][i] = of.at[of.distance ? k : 0][i];
    if (ends[1] < ends[0]) std::swap(ends[0], ends[1]);
    const auto [first, is_new] = seen.try_emplace(ends, of.name);
    if (of.distance && ends[0] == ends[1])
      config.fail(
          format("[%s] %s: from a point to itself: %s", kSection, of.name.c_str(), kTakeOut));
    else if (!is_new)
      config.fail(format("[%s] %s: at the same place as %s, digit for digit: %s", kSection,
                         of.name.c_str(), first->second.c_str(), kTakeOut));
  }
  return readings;
}

/// The motion of one step: m, or rad of a rotary delta's arm.
inline double step_of(Config& config, const string& section, bool rotary) {
  const bool geared = config.has(section, "gear_ratio");
  const double unit = rotary ? 1 : kMm;
  if (config.has(section, "step_distance") && !geared && !config.has(section, "rotation_distance"))
    return unit * config.number(section, "step_distance", 0);  // Klipper before 2021
  const double turn = rotary ? 2 * 180 * kDegree : config.number(section, "rotation_distance", 0);
  if (rotary && !geared) config.word(section, "gear_ratio");
  double steps = 1;
  for (const char* option : {"full_steps_per_rotation", "microsteps"}) {
    const double count = option[0] == 'f' ? config.number_or(section, option, 200, 0)
                                          : config.number(section, option, 0);
    if (count != std::floor(count)) config.fail(section, option, "must be a whole number");
    steps *= count;
  }
  return unit * turn / (steps * (geared ? config.ratio(section, "gear_ratio") : 1));
}

/// The probe's section, empty without a probe.
inline string probe_of(const Config& config) {
  for (const char* name :
       {"probe", "bltouch", "smart_effector", "probe_eddy_current", "beacon", "cartographer"})
    if (config.values.contains(name)) return name;
  return {};
}

/// The printer of a configuration. Config::error has section, option, value and what is allowed.
inline Printer printer_of(Config& config) {
  Printer printer;
  Delta& delta = printer.delta;
  const string kinematics = config.word("printer", "kinematics");
  delta.rotary = kinematics == "rotary_delta";
  if (config.error.empty() && !delta.rotary && kinematics != "delta")
    config.fail("[printer] kinematics: unknown kinematics '" + one_line(kinematics) +
                "' (choices: delta, rotary_delta)");
  printer.options = options(delta.rotary);
  printer.theta.setZero(delta.count() + 2);
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = printer.options[k];
    const string first = of.section == "printer" ? of.section : "stepper_a";
    const string section =
        config.has(of.section, of.option) || of.angle() ? of.section : first;  // as in Klipper
    double value = 0;
    if (of.angle() && !config.has(of.section, of.option)) {
      value = kTurns[k - delta.angle()];
      if (delta.rotary)
        config.fail(of.section, of.option,
                    "is missing (Klipper takes 30, 150, 270 for the three): write it");
    } else {
      value = config.number(section, of.option, of.angle() ? -kLargest : 0);
    }
    printer.theta[k] = of.scale() * value;
  }
  for (int i = 0; i < 3 && !delta.rotary; ++i) {
    const double arm = printer.theta[delta.rod() + i] / kMm, radius = printer.theta[0] / kMm;
    const string own = string("stepper_") + "abc"[i];
    if (arm <= radius)
      config.fail(config.has(own, "arm_length") ? own : "stepper_a", "arm_length",
                  format("an arm of %g mm must be longer than delta_radius = %g mm; are both mm?",
                         arm, radius));
  }
  for (int i = 0; i < 3; ++i)
    delta.step[i] = step_of(config, string("stepper_") + "abc"[i], delta.rotary);
  for (int i = 0; i < 3; ++i)
    if (isnan(delta.homed(printer.theta, i)))
      config.fail(string("stepper_") + "abc"[i], "position_endstop",
                  "the arm does not reach the middle there");
  printer.readings = readings_of(config);
  printer.radius = delta.rotary ? printer.theta[delta.upper()] / 2 : 0.8 * printer.theta[0];
  if (config.has(kSection, "radius"))
    printer.radius = kMm * config.number(kSection, "radius", 0);
  else if (config.has("printer", "print_radius"))
    printer.radius = kMm * config.number("printer", "print_radius", 0);

  vector<string>& notes = printer.notes = config.notes;
  if (!config.included.empty()) notes.push_back("included files are not read: " + config.files());
  if (const int line = config.broken())
    notes.push_back(
        format("line %d stands in what SAVE_CONFIG wrote and is no part of it: Klipper "
               "reads none of that block then",
               line));
  vector<Place> relevant;
  for (const Option& of : printer.options) relevant.emplace_back(of.section, of.option);
  if (const auto of = config.saved.find(kSection); of != config.saved.end())
    for (const auto& [option, _] : of->second) relevant.emplace_back(kSection, option);
  for (const auto& [section, option] : relevant)
    if (const string* saved = config.twice(section, option))
      notes.push_back("[" + section + "] " + option +
                      " stands twice: " + one_line(config.word(section, option)) +
                      " counts, as in Klipper, and not the saved " + one_line(*saved));
  for (string& note : gaps(config, {"manual_height", "height", "distance"}))
    notes.push_back(std::move(note));
  return printer;
}
}  // namespace truepose::printers
