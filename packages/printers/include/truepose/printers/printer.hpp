// A delta printer from its configuration: parameters, step distances, saved readings.
//
// A *stable position*, Klipper's term, is the number of steps of each motor down from its endstop;
// it identifies a pose of the machine for any parameters. m, rad.
#pragma once

#include "truepose/printers/config.hpp"
#include "truepose/printers/delta.hpp"

namespace truepose::printers {
constexpr char kTowers[] = "abc";
constexpr double kApart = 5 * kMm;  ///< largest plausible difference between arms
constexpr int kFewest = 3;          ///< heights that Klipper accepts
constexpr int kMostReadings = 999;  ///< of each kind, in Klipper
constexpr char kTakeOut[] = "take it out and number those behind it on";
constexpr char kSection[] = "delta_calibrate";

/// Place and unit of a parameter in the file.
struct Option {
  std::string name, section, option;
  bool angle = false;
  double scale() const { return angle ? kDegree : kMm; }
};

/// The parameters of a kind of printer in the order of p, by their names in Klipper's log.
inline std::vector<Option> options(bool rotary) {
  std::vector<Option> result;
  if (rotary)
    for (const char* name : {"shoulder_radius", "shoulder_height"})
      result.push_back({name, "printer", name});
  else
    result.push_back({"radius", "printer", "delta_radius"});
  const auto each = [&](const char* name, const char* option) {
    for (int i = 0; i < 3; ++i)
      result.push_back({std::string(name) + "_" + kTowers[i], std::string("stepper_") + kTowers[i],
                        option, std::string_view(name) == "angle"});
  };
  each("angle", "angle");
  if (rotary) {
    each("upper_arm", "upper_arm_length");
    each("lower_arm", "lower_arm_length");
  } else {
    each("arm", "arm_length");
  }
  each("endstop", "position_endstop");
  return result;
}

/// A height of the bed at a stable position, or a distance between the nozzle's positions at two.
struct Reading {
  std::string name;
  bool distance = false, probed = false;
  double value = 0;
  Vector3 at[2] = {Vector3::Zero(), Vector3::Zero()};
};
using Readings = std::vector<Reading>;  ///< heights first

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
  Vector p;
  Readings readings;
  double radius = 0;  ///< of the printed or probed bed
  std::vector<std::string> notes;
};

/// A message if the arms differ implausibly, else empty.
inline std::string unlike_arms(const Delta& delta, const Vector& p) {
  const auto arms = p.segment<3>(delta.rod()).array() / kMm;
  const double apart = arms.maxCoeff() - arms.minCoeff();
  if (!(apart > kApart / kMm)) return {};
  return format(
      "arms of %.1f, %.1f, %.1f mm differ by %.0f mm: no printer's rods do. A criterion "
      "moved them along a combination that its readings do not determine",
      arms[0], arms[1], arms[2], apart);
}

/// Notes on each missing number among the readings of a kind, or of all.
inline std::vector<std::string> gaps(const Config& config, std::vector<std::string> stems) {
  std::vector<std::string> notes;
  for (const std::string& stem : stems) {
    int last = -1;
    for (int k = 0; k <= kMostReadings; ++k)
      if (config.has(kSection, stem + std::to_string(k))) last = k;
    for (int k = 0; k < last; ++k)
      if (!config.has(kSection, stem + std::to_string(k))) {
        notes.push_back(stem + std::to_string(k) +
                        " is missing: as in Klipper none behind it counts, " + stem +
                        std::to_string(last) + " neither");
        break;
      }
  }
  return notes;
}

inline Readings readings_of(Config& config) {
  Readings readings;
  for (const char* stem : {"manual_height", "height", "distance"})
    for (int k = 0; k < kMostReadings && config.error.empty(); ++k) {
      Reading of{stem + std::to_string(k)};
      if (!config.has(kSection, of.name)) break;
      of.distance = stem[0] == 'd';
      of.probed = stem[0] == 'h';
      of.value = kMm * config.number(kSection, of.name, of.distance ? 0 : -kLargest);
      for (int end = 0; end <= of.distance; ++end) {
        const std::string option = of.name + (of.distance ? end ? "_pos2" : "_pos1" : "_pos");
        const auto parts = config.parts(config.word(kSection, option), ',');
        if (parts.size() != 3)
          config.fail(kSection, option, "must be 3 numbers with commas between");
        for (std::size_t i = 0; i < 3 && parts.size() == 3; ++i)
          of.at[end][Eigen::Index(i)] = config.checked(kSection, option, parts[i]);
      }
      readings.push_back(of);
    }
  // A repeated stable position would count twice.
  using Ends = std::array<std::array<double, 3>, 2>;
  std::map<Ends, std::string> seen;
  for (const Reading& of : readings) {
    Ends ends;
    for (std::size_t k = 0; k < 2; ++k)
      for (std::size_t i = 0; i < 3; ++i) ends[k][i] = of.at[of.distance ? k : 0][Eigen::Index(i)];
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
inline double step_of(Config& config, const std::string& section, bool rotary) {
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
inline std::string probe_of(const Config& config) {
  for (const char* name :
       {"probe", "bltouch", "smart_effector", "probe_eddy_current", "beacon", "cartographer"})
    if (config.values.contains(name)) return name;
  return {};
}

/// The printer of a configuration. Config::error has section, option, value and what is allowed.
inline Printer printer_of(Config& config) {
  Printer printer;
  Delta& delta = printer.delta;
  const std::string kinematics = config.word("printer", "kinematics");
  delta.rotary = kinematics == "rotary_delta";
  if (config.error.empty() && !delta.rotary && kinematics != "delta")
    config.fail("[printer] kinematics: unknown kinematics '" + one_line(kinematics) +
                "' (choices: delta, rotary_delta)");
  const std::vector<Option> all = options(delta.rotary);
  printer.p.resize(delta.count());
  for (int k = 0; k < delta.count(); ++k) {
    const Option& of = all[std::size_t(k)];
    const std::string first = of.section == "printer" ? of.section : "stepper_a";
    const std::string section =
        config.has(of.section, of.option) || of.angle ? of.section : first;  // as in Klipper
    constexpr double usual[] = {210, 330, 90};
    double value = 0;
    if (of.angle && !config.has(of.section, of.option)) {
      value = usual[k - delta.angle()];
      if (delta.rotary)
        config.fail(of.section, of.option,
                    "is missing (Klipper takes 30, 150, 270 for the three): write it");
    } else {
      value = config.number(section, of.option, of.angle ? -kLargest : 0);
    }
    printer.p[k] = of.scale() * value;
  }
  for (int i = 0; i < 3 && !delta.rotary; ++i) {
    const double arm = printer.p[delta.rod() + i] / kMm, radius = printer.p[0] / kMm;
    const std::string own = std::string("stepper_") + kTowers[i];
    if (arm <= radius)
      config.fail(config.has(own, "arm_length") ? own : "stepper_a", "arm_length",
                  format("an arm of %g mm must be longer than delta_radius = %g mm; are both mm?",
                         arm, radius));
  }
  for (int i = 0; i < 3; ++i)
    delta.step[i] = step_of(config, std::string("stepper_") + kTowers[i], delta.rotary);
  for (int i = 0; i < 3; ++i)
    if (std::isnan(delta.homed(printer.p, i)))
      config.fail(std::string("stepper_") + kTowers[i], "position_endstop",
                  "the arm does not reach the middle there");
  printer.readings = readings_of(config);
  printer.radius = delta.rotary ? printer.p[delta.upper()] / 2 : 0.8 * printer.p[0];
  if (config.has(kSection, "radius"))
    printer.radius = kMm * config.number(kSection, "radius", 0);
  else if (config.has("printer", "print_radius"))
    printer.radius = kMm * config.number("printer", "print_radius", 0);

  std::vector<std::string>& notes = printer.notes = config.notes;
  if (!config.included.empty()) {
    std::string names;
    for (std::size_t k = 0; k < config.included.size() && k < 5; ++k)
      names += (k ? ", " : "") + one_line(config.included[k]);
    notes.push_back("included files are not read: " + names +
                    (config.included.size() > 5 ? ", …" : ""));
  }
  if (const int line = config.broken())
    notes.push_back(
        format("line %d stands in what SAVE_CONFIG wrote and is no part of it: Klipper "
               "reads none of that block then",
               line));
  std::vector<Place> relevant;
  for (const Option& of : all) relevant.emplace_back(of.section, of.option);
  if (const auto of = config.saved.find(kSection); of != config.saved.end())
    for (const auto& [option, _] : of->second) relevant.emplace_back(kSection, option);
  for (const auto& [section, option] : relevant)
    if (const std::string* saved = config.twice(section, option))
      notes.push_back("[" + section + "] " + option +
                      " stands twice: " + one_line(config.word(section, option)) +
                      " counts, as in Klipper, and not the saved " + one_line(*saved));
  for (std::string& note : gaps(config, {"manual_height", "height", "distance"}))
    notes.push_back(std::move(note));
  return printer;
}
}  // namespace truepose::printers
