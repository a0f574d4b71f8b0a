// Delta printers with Marlin or RepRapFirmware: a session's probing as Klipper's configuration, and
// lines to send.
//
// Both firmwares have the same geometry as Klipper (Marlin/src/module/delta.cpp,
// RepRapFirmware/src/Movement/Kinematics/LinearDeltaKinematics.cpp): towers at 210°, 330° and 90°
// plus the trims X, Y, Z of M665. The carriage of tower i at its endstop is sqrt(L² - R²) above the
// nozzle at height E_i in the centre:
//
//     RepRapFirmware: E_i = H + M666's adjustment i;  Marlin: E_i = H - M666's, which is 0 or less.
//
// A probed height z at (x, y) is the nozzle's coordinate, by these settings, where it touches the
// bed; by RepRapFirmware's tilt A, B in per cent its carriages are z + (A x + B y) / 100 high. A, B
// and C of Marlin's M665 are the rods' trims since 2.0.6; from 1.1.3 to 2.0.5 B is the radius of
// G33's points.
#pragma once

#include "truepose/printers/printer.hpp"
#include "truepose/printers/session.hpp"

namespace truepose::printers {
constexpr double kTrim = 10;  ///< mm: a longer B of Marlin's M665 is a radius, no trim of a rod

/// The first word of the settings that is not read, as a refusal; empty if there is none.
inline string unread(const Words& words, bool marlin) {
  bool known = true;  // whether this M665 is Marlin's, whose A, B, C are trims
  for (const auto& [word, values] : words) {
    const Command* of = command_of(word.substr(0, word.find(' ')));
    const char letter = word.back();
    const bool tower = letter == 'A' || letter == 'B' || letter == 'C';
    const bool is_radius = marlin && word == "M665 B" && values[0] > kTrim;
    bool used = of->used.find(letter) != of->used.npos && values.size() == 1;
    if (tower && of->name == "M665") used = marlin ? fabs(values[0]) <= kTrim : letter == 'B';
    if (tower && of->name == "M666") used = !marlin;
    if (word == "M665 L") used = values.size() == 1 || values.size() == 3;
    if (used || is_radius || of->idle == "*" || of->idle.find(letter) != of->idle.npos ||
        (marlin && word == "M206 Z"))
      continue;
    known = known && of->name != "M665";
    if (values.size() != 1 || values[0] != of->neutral)
      return word + format(
                        "%g is not read: firmwares differ in it, or it is no setting of a delta "
                        "printer with three towers. Set it to %g, probe again",
                        values[0], of->neutral);
  }
  for (const char* word : {"M665 A", "M665 B", "M665 C"})
    if (const auto at = words.find(word);
        !known && marlin && at != words.end() && at->second[0] != 0)
      return word + format(
                        "%g: is no rod's trim where M665 has D to K or other letters that "
                        "Marlin's has not. Set it to 0, probe again",
                        at->second[0]);
  return {};
}

/// The value of a word of the settings.
inline double value_of(const Words& words, const string& word, double otherwise = 0) {
  const auto at = words.find(word);
  return at == words.end() ? otherwise : at->second[0];
}

/// The parameters that settings are, and the steps per mm. mm, degrees.
inline Vector parameters_of(const Words& words, bool marlin, Delta& delta) {
  Vector p(delta.count());
  p[0] = value_of(words, "M665 R");
  const auto L = words.find("M665 L");
  for (int i = 0; i < 3; ++i) {
    const char axis = "XYZ"[i];
    const double trim = marlin ? value_of(words, string("M665 ") + "ABC"[i]) : 0;
    p[delta.rod() + i] =
        L->second[L->second.size() == 3 ? size_t(i) : 0] + (fabs(trim) <= kTrim ? trim : 0);
    p[delta.angle() + i] = kTurns[i] + value_of(words, string("M665 ") + axis);
    p[delta.endstop() + i] =
        value_of(words, "M665 H") + (marlin ? -1 : 1) * value_of(words, string("M666 ") + axis);
    delta.step[i] = 1 / value_of(words, string("M92 ") + axis, 80);
  }
  return p;
}

/// Why a probing cannot be used, empty if it can; its points, x, y, z in mm, are set.
inline string points_of(const Probing& of, double probe_radius, vector<Vector3>& points) {
  for (const auto& [word, by] : of.lost)
    if (!word.starts_with("M92"))
      return by + " changed " + word +
             ", which was not printed before this probing: send M503 (RepRapFirmware: M665, M666), "
             "probe again";
  for (const auto& [letter, name] :
       {pair("L", "length of the rods"), pair("R", "radius"), pair("H", "homed height")})
    if (!of.words.contains(string("M665 ") + letter))
      return format("M665 has no %s, the %s (M503 lists it)", letter, name);
  const bool marlin = of.by != "G32";
  if (string said = unread(of.words, marlin); !said.empty()) return said;
  const double A = value_of(of.words, "M666 A") / 100, B = value_of(of.words, "M666 B") / 100;
  const char* probe = marlin ? "M851 " : "G31 ";
  double dx = value_of(of.words, string(probe) + "X");
  double dy = value_of(of.words, string(probe) + "Y");
  const auto option = [&](char letter, double otherwise) {
    const auto at = of.options.find(letter);
    return at == of.options.end() ? otherwise : at->second;
  };
  points = of.bed;
  for (size_t k = 0; k < of.g32.size(); ++k) {
    if (of.places.size() != of.g32.size() || !of.places.contains(int(k)))
      return format(
          "%d bed probe heights, but %d places 'G30 P… X… Y…': give bed.g and the answer to it",
          int(of.g32.size()), int(of.places.size()));
    points.emplace_back(of.places.at(int(k)).first, of.places.at(int(k)).second, of.g32[k]);
  }
  if (!of.g33.empty()) {
    const bool shifted = option('O', 0) != 0;
    if (option('P', 3) > 3)
      return format("G33 P%g: its heights are means of several points; send G33 P3 V0",
                    option('P', 3));
    if (shifted && !of.words.contains("M851 X"))
      return "G33 O: the probe's offset (M851 X… Y…) is missing";
    if (!shifted) dx = dy = 0;  // the nozzle is at these points
    const double B_radius = value_of(of.words, "M665 B");
    const bool by_B = B_radius > kTrim && !shifted && option('R', 0) == 0;
    const double radius = probe_radius > 0 ? probe_radius
                          : of.radius > 0  ? of.radius
                          : by_B           ? B_radius
                                           : 0;
    if (!(radius > 0))
      return "G33 of this firmware does not print where it probes: give the radius of its points "
             "(--probe-radius MM)";
    const map<string, double> at{{"x", 210}, {"xy", 270}, {"y", 330},
                                 {"yz", 30}, {"z", 90},   {"zx", 150}};
    for (const auto& [name, z] : of.g33) {
      const auto turn = at.find(name);
      const double angle = turn == at.end() ? 0 : turn->second * kDegree;
      const double r = turn == at.end() ? 0 : radius;
      points.emplace_back(r * cos(angle), r * sin(angle), z);
    }
  }
  for (Vector3& at : points) {
    at -= Vector3(dx, dy, 0);
    at[2] += marlin ? 0 : A * at[0] + B * at[1];
  }
  return {};
}

/// A Marlin or RepRapFirmware session as Klipper's configuration; any other text as Klipper's own.
inline Config read(string_view text, double probe_radius) {
  if ((text.find("M665") == text.npos && text.find("delta radius") == text.npos) ||
      text.find("===== Config file =====") != text.npos)
    return parse_config(text);
  Config failed;
  if (text.size() > 100 * kMostBytes) {
    failed.fail(format("more than %d bytes", int(100 * kMostBytes)));
    return failed;
  }
  const Session session(text);
  if (!session.seen) return parse_config(text);
  if (session.probings.empty())
    failed.fail(
        "no probed heights: Marlin's answers to G33 P3 V0 or G30 X… Y…, or RepRapFirmware's "
        "bed.g with 'G30 P0 X… Y…' and its 'bed probe heights'");
  // The last probing of several points whose settings are known.
  const Probing* of = nullptr;
  vector<Vector3> bed;
  string why;
  int number = int(session.probings.size());
  for (const int fewest : {kFewest, 1})
    for (int k = int(session.probings.size()); k-- > 0 && !of;) {
      const Probing& each = session.probings[k];
      if (each.points() < fewest) continue;
      vector<Vector3> points;
      const string said = points_of(each, probe_radius, points);
      if (why.empty()) why = said;
      if (!said.empty()) continue;
      of = &each;
      bed = points;
      number = k + 1;
    }
  if (!of) failed.fail(why);
  if (!failed.error.empty()) return failed;

  const bool marlin = of->by != "G32";
  Delta delta, later;
  const Vector p = parameters_of(of->words, marlin, delta);
  Words at_end = session.words;
  at_end.insert(of->words.begin(), of->words.end());
  const bool known = unread(at_end, marlin).empty() &&
                     std::none_of(of->words.begin(), of->words.end(), [&](const auto& word) {
                       return session.lost.contains(word.first);
                     });
  if (!known) at_end = of->words;
  const Vector now = parameters_of(at_end, marlin, later);
  for (const Vector& each : {p, now})
    if (const double shortest = each.segment<3>(delta.rod()).minCoeff();
        !(shortest > each[0] && each[0] > 0 && delta.step.minCoeff() > 0 &&
          delta.step.allFinite() && later.step.minCoeff() > 0 && later.step.allFinite()))
      failed.fail(
          format("rods of %g mm must be longer than the radius, %g mm, and M92's steps "
                 "greater than 0",
                 shortest, each[0]));
  if (bed.size() > kMostReadings)
    failed.fail(format("%d probed heights: at most %d", int(bed.size()), kMostReadings));
  double reach = 0;
  Vector in_rad = p;
  in_rad.segment<3>(delta.angle()) *= kDegree;
  string lines =
      format("[printer]\nkinematics: delta\ndelta_radius: %.17g\n[%s]\n", now[0], kSection);
  for (size_t k = 0; k < bed.size() && failed.error.empty(); ++k) {
    const Vector3& at = bed[k];
    reach = max(reach, sqrt(at[0] * at[0] + at[1] * at[1]));
    const Vector3 steps = delta.steps(in_rad, at);
    if (!steps.allFinite())
      failed.fail(format("no rod reaches (%g, %g) mm, a probed point", at[0], at[1]));
    lines += format("height%d: 0\nheight%d_pos: %.4f,%.4f,%.4f\n", int(k), int(k), steps[0],
                    steps[1], steps[2]);
  }
  if (!failed.error.empty()) return failed;
  const double radius = marlin ? 0 : value_of(of->words, "M665 B");
  lines += format("radius: %.17g\n", radius > 0 ? radius : reach);
  for (int i = 0; i < 3; ++i)
    lines += format(
        "[stepper_%c]\nstep_distance: %.17g\narm_length: %.17g\nangle: %.17g\n"
        "position_endstop: %.17g\n",
        "abc"[i], later.step[i], now[later.rod() + i], now[later.angle() + i],
        now[later.endstop() + i]);
  Config config = parse_config(lines);
  config.kind = marlin ? "marlin" : "rrf";
  const vector<double>& rods = of->words.at("M665 L");
  config.own_rods = rods.size() == 3;
  for (const char* word : {"M665 A", "M665 B", "M665 C"})
    config.own_rods = config.own_rods || (marlin && of->words.contains(word) &&
                                          fabs(value_of(of->words, word)) <= kTrim);
  if (session.probings.size() > 1)
    config.notes.push_back(
        format("%d probings: number %d is used, %d heights, with M665 R%g H%g, in force then%s%s",
               int(session.probings.size()), number, int(bed.size()), value_of(of->words, "M665 R"),
               value_of(of->words, "M665 H"), why.empty() ? "" : "; not the last: ", why.c_str()));
  if (!known)
    config.notes.push_back(
        "the settings were changed after this probing and not printed: 'the file's parameters' "
        "are those in force while it was taken");
  else if ((now - p).cwiseAbs().maxCoeff() > 0)
    config.notes.push_back(
        "the settings were changed after this probing: 'the file's parameters' are the later ones");
  if (value_of(at_end, "M851 Z") != value_of(of->words, "M851 Z"))
    config.notes.push_back(
        format("M851 Z was changed from %g to %g after this probing: its heights, and so the homed "
               "height, are by the former",
               value_of(of->words, "M851 Z"), value_of(at_end, "M851 Z")));
  if (!of->g33.empty() && !of->options.contains('P'))
    config.notes.push_back(
        "G33's P is not in the text: from P4 on its heights are means of "
        "several points; send G33 P3 V0");
  return config;
}

/// Parameters as lines to send to Marlin or RepRapFirmware; `own_rods`: a length for each tower.
inline vector<string> lines_to_send(const Vector& p, bool marlin, bool own_rods = true) {
  const Delta delta;
  const Vector3 arms = p.segment<3>(delta.rod()) / kMm, ends = p.segment<3>(delta.endstop()) / kMm;
  const Vector3 trims = p.segment<3>(delta.angle()) / kDegree - Vector3(kTurns);
  const double mean = arms.mean(), height = marlin ? ends.minCoeff() : ends.mean();
  const Vector3 own = marlin ? Vector3((height - ends.array()).matrix())
                             : Vector3((ends.array() - height).matrix());
  const Vector3 off = (arms.array() - mean).matrix();
  const string rods = !own_rods ? format("L%.3f", mean)
                      : marlin  ? format("L%.3f A%.3f B%.3f C%.3f", mean, off[0], off[1], off[2])
                                : format("L%.3f:%.3f:%.3f", arms[0], arms[1], arms[2]);
  return {"M665 " + rods +
              format(" R%.3f H%.3f X%.3f Y%.3f Z%.3f", p[0] / kMm, height, trims[0], trims[1],
                     trims[2]),
          format("M666 X%.3f Y%.3f Z%.3f", own[0] + 0.0, own[1] + 0.0, own[2] + 0.0) +
              (marlin ? "" : " A0 B0"),
          "M500"};
}
}  // namespace truepose::printers
