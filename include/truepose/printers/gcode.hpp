// Delta printers with Marlin or RepRapFirmware: M665, M666 and probed heights, and lines to send.
//
// Both firmwares have the same geometry as Klipper (Marlin/src/module/delta.cpp,
// RepRapFirmware/src/Movement/Kinematics/LinearDeltaKinematics.cpp): towers at 210°, 330° and 90°
// plus the trims X, Y, Z of M665. The carriage of tower i at its endstop is sqrt(L² - R²) above the
// nozzle at height E_i in the centre:
//
//     RepRapFirmware: E_i = H + M666's adjustment i;  Marlin: E_i = H - M666's, which is 0 or less.
//
// A probed height z at (x, y) is the nozzle's coordinate, by these settings, where it touches the
// bed.
#pragma once

#include "truepose/printers/printer.hpp"

namespace truepose::printers {
/// Reader of words and numbers from a place in a text on.
struct Scan {
  std::string_view text;
  std::size_t at = 0;

  bool done() const { return at >= text.size(); }
  bool starts_word() const { return at == 0 || !wordy(text[at - 1]); }
  void space() {
    while (!done() && blank(text[at])) ++at;
  }
  bool take(std::string_view word) {
    const bool is = text.substr(at).starts_with(word);
    at += is ? word.size() : 0;
    return is;
  }
  /// A decimal number without exponent.
  bool number(double& value) {
    std::size_t end = at, digits = 0;
    if (end < text.size() && (text[end] == '-' || text[end] == '+')) ++end;
    for (bool point = false; end < text.size() && digits < 40; ++end)
      if (digit(text[end]))
        ++digits;
      else if (text[end] == '.' && !point)
        point = true;
      else
        break;
    if (digits == 0) return false;
    value = number_of(text.substr(at, end - at));
    at = end;
    return true;
  }
};

/// The heights and settings in a session, as far as they are there. mm, degrees.
struct Session {
  std::map<std::string, std::vector<double>> words;  ///< "M665L": last values of each word
  std::map<int, std::pair<double, double>> places;   ///< of G30 P…
  std::vector<Vector3> bed;                          ///< x, y, z of Marlin's answers
  std::map<std::string, double> g33;                 ///< last height by name
  std::vector<double> g32;                           ///< last heights of RepRapFirmware
};

inline Session session_of(std::string_view text) {
  std::string plain;  // without comments
  for (const std::string_view line : lines_of(text))
    (plain += line.substr(0, line.find(';'))) += '\n';
  Session of;
  for (Scan scan{plain}; !scan.done(); ++scan.at) {
    const std::size_t begin = scan.at;
    std::string command;
    for (const char* name : {"M665", "M666", "M92", "G30"})
      if (command.empty() && scan.starts_word() && scan.take(name)) command = name;
    std::map<char, double> own;
    while (!command.empty() && (plain[scan.at] == ' ' || plain[scan.at] == '\t')) {
      while (plain[scan.at] == ' ' || plain[scan.at] == '\t') ++scan.at;
      const char letter = plain[scan.at];
      std::vector<double> values(1);
      if (letter < 'A' || letter > 'Z' || !(++scan.at, scan.number(values[0]))) break;
      while (plain[scan.at] == ':') {
        ++scan.at;
        values.emplace_back();
        if (!scan.number(values.back())) break;
      }
      own[letter] = values[0];
      of.words[command + letter] = values;
    }
    if (command == "G30" && own.contains('P') && own.contains('X') && own.contains('Y'))
      of.places[int(std::clamp(own['P'], -1.0, 1e6))] = {own['X'], own['Y']};
    const auto axis = [&](std::string_view name, double& value) {
      scan.space();
      if (!scan.take(name)) return false;
      scan.space();
      return scan.number(value);
    };
    Vector3 at;
    if (scan.take("Bed ") && axis("X:", at[0]) && axis("Y:", at[1]) && axis("Z:", at[2]))
      of.bed.push_back(at);
    scan.at = begin;
    for (const char* name : {"c:", "x:", "y:", "z:", "yz:", "zx:", "xy:"}) {
      double z = 0;
      if (scan.starts_word() && scan.take(name) && scan.number(z))
        of.g33[std::string(name, std::string_view(name).size() - 1)] = z;
      scan.at = begin;
    }
    if (scan.take("ed probe heights:") && begin > 0 && (plain[begin - 1] | 32) == 'b') {
      std::vector<double> heights;
      for (double z = 0; scan.space(), scan.number(z);) heights.push_back(z);
      if (!heights.empty()) of.g32 = heights;
    }
    scan.at = begin;
  }
  return of;
}

/// A Marlin or RepRapFirmware session as Klipper's configuration; any other text as Klipper's own.
inline Config read(std::string_view text, double probe_radius) {
  if (text.find("M665") == text.npos || text.find("===== Config file =====") != text.npos)
    return parse_config(text);
  Config failed;
  if (text.size() > 100 * kMostBytes) {
    failed.fail(format("more than %d bytes", int(100 * kMostBytes)));
    return failed;
  }
  Session of = session_of(text);
  const auto first = [&](const std::string& word, double otherwise) {
    const auto at = of.words.find(word);
    return at == of.words.end() ? otherwise : at->second[0];
  };
  if (!of.words.contains("M665L") && !of.words.contains("M665R")) return parse_config(text);
  const bool marlin = of.g32.empty();
  if (!marlin) {
    of.bed.clear();
    for (std::size_t k = 0; k < of.g32.size() && of.places.contains(int(k)); ++k)
      of.bed.emplace_back(of.places[int(k)].first, of.places[int(k)].second, of.g32[k]);
    if (of.bed.size() != of.g32.size() || of.places.size() != of.g32.size())
      failed.fail(
          format("%d bed probe heights, but %d places 'G30 P… X… Y…': give bed.g and the "
                 "answer to it",
                 int(of.g32.size()), int(of.places.size())));
  } else if (of.bed.empty() && !of.g33.empty()) {
    if (!(probe_radius > 0))
      failed.fail(
          "G33 does not print where it probes: give the radius of its points "
          "(--probe-radius MM)");
    const std::map<std::string, double> at{{"x", 210}, {"xy", 270}, {"y", 330},
                                           {"yz", 30}, {"z", 90},   {"zx", 150}};
    for (const auto& [name, z] : of.g33) {
      const auto turn = at.find(name);
      const double angle = turn == at.end() ? 0 : turn->second * kDegree;
      const double r = turn == at.end() ? 0 : probe_radius;
      of.bed.emplace_back(r * std::cos(angle), r * std::sin(angle), z);
    }
  }
  for (const auto& [letter, name] : {std::pair("L", "length of the rods"), std::pair("R", "radius"),
                                     std::pair("H", "homed height")})
    if (!of.words.contains(std::string("M665") + letter))
      failed.fail(format("M665 has no %s, the %s (M503 lists it)", letter, name));
  if (!failed.error.empty()) return failed;

  Delta delta;
  Vector p(delta.count());
  p[0] = first("M665R", 0);
  const std::vector<double>& rods = of.words["M665L"];
  for (int i = 0; i < 3; ++i) {
    const char axis = "XYZ"[i], own = "ABC"[i];
    p[delta.rod() + i] = rods[rods.size() >= 3 ? std::size_t(i) : 0] +
                         (marlin ? first(std::string("M665") + own, 0) : 0);
    constexpr double usual[] = {210, 330, 90};
    p[delta.angle() + i] = usual[i] + first(std::string("M665") + axis, 0);
    p[delta.endstop() + i] =
        first("M665H", 0) + (marlin ? -1 : 1) * first(std::string("M666") + axis, 0);
    delta.step[i] = 1 / first(std::string("M92") + axis, 80);  // steps per mm
  }
  const double shortest = p.segment<3>(delta.rod()).minCoeff();
  if (!(shortest > p[0] && p[0] > 0 && delta.step.minCoeff() > 0 && delta.step.allFinite()))
    failed.fail(
        format("rods of %g mm must be longer than the radius, %g mm, and M92's steps "
               "greater than 0",
               shortest, p[0]));
  if (of.bed.size() > kMostReadings)
    failed.fail(format("%d probed heights: at most %d", int(of.bed.size()), kMostReadings));
  if (of.bed.empty())
    failed.fail(
        "no probed heights: Marlin's answers to G33 P3 V0 or G30 X… Y…, or RepRapFirmware's "
        "bed.g with 'G30 P0 X… Y…' and its 'bed probe heights'");
  double reach = 0;
  Vector in_rad = p;
  in_rad.segment<3>(delta.angle()) *= kDegree;
  std::string lines =
      format("[printer]\nkinematics: delta\ndelta_radius: %.17g\n[%s]\n", p[0], kSection);
  for (std::size_t k = 0; k < of.bed.size() && failed.error.empty(); ++k) {
    const Vector3& at = of.bed[k];
    reach = std::max(reach, std::sqrt(at[0] * at[0] + at[1] * at[1]));
    const Vector3 steps = delta.steps(in_rad, at);
    if (!steps.allFinite())
      failed.fail(format("no rod reaches (%g, %g) mm, a probed point", at[0], at[1]));
    lines += format("height%d: 0\nheight%d_pos: %.4f,%.4f,%.4f\n", int(k), int(k), steps[0],
                    steps[1], steps[2]);
  }
  if (!failed.error.empty()) return failed;
  const double bed = marlin ? 0 : first("M665B", 0);
  lines += format("radius: %.17g\n", bed > 0 ? bed : reach);
  for (int i = 0; i < 3; ++i)
    lines += format(
        "[stepper_%c]\nstep_distance: %.17g\narm_length: %.17g\nangle: %.17g\n"
        "position_endstop: %.17g\n",
        kTowers[i], delta.step[i], p[delta.rod() + i], p[delta.angle() + i],
        p[delta.endstop() + i]);
  Config config = parse_config(lines);
  config.kind = marlin ? "marlin" : "rrf";
  return config;
}

/// Parameters as lines to send to Marlin or RepRapFirmware.
inline std::vector<std::string> lines_to_send(const Vector& p, bool marlin) {
  const Delta delta;
  const Vector3 arms = p.segment<3>(delta.rod()) / kMm, ends = p.segment<3>(delta.endstop()) / kMm;
  const Vector3 trims = p.segment<3>(delta.angle()) / kDegree - Vector3(210, 330, 90);
  const double mean = arms.mean(), height = marlin ? ends.minCoeff() : ends.mean();
  const Vector3 own = marlin ? Vector3((height - ends.array()).matrix())
                             : Vector3((ends.array() - height).matrix());
  const Vector3 off = (arms.array() - mean).matrix();
  const std::string rods = marlin ? format("L%.3f A%.3f B%.3f C%.3f", mean, off[0], off[1], off[2])
                                  : format("L%.3f:%.3f:%.3f", arms[0], arms[1], arms[2]);
  return {"M665 " + rods +
              format(" R%.3f H%.3f X%.3f Y%.3f Z%.3f", p[0] / kMm, height, trims[0], trims[1],
                     trims[2]),
          format("M666 X%.3f Y%.3f Z%.3f", own[0] + 0.0, own[1] + 0.0, own[2] + 0.0), "M500"};
}
}  // namespace truepose::printers
