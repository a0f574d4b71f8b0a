// Session of a Marlin or RepRapFirmware printer, read in order: settings, and probings under them.
//
// A probing belongs to the settings in force when it was taken. M665, M666 and the like set them,
// sent or printed; so do the lines of G33 (".Height: … Radius: …") and the answers of
// RepRapFirmware's M665 and M666. G33 without V0 and G32 with calibration change them, M501 and
// M502 load others: these are unknown until they are printed. (Marlin/src/gcode/calibrate/G33.cpp,
// RepRapFirmware/src/Movement/Kinematics/LinearDeltaKinematics.cpp)
#pragma once

#include "truepose/printers/config.hpp"
#include "truepose/printers/delta.hpp"

namespace truepose::printers {
/// Reader of words and numbers from a place in a text on.
struct Scan {
  string_view text;
  size_t at = 0;

  bool done() const { return at >= text.size(); }
  bool starts_word() const { return at == 0 || !wordy(text[at - 1]); }
  void space() {
    while (!done() && blank(text[at])) ++at;
  }
  bool take(string_view word) {
    const bool is = text.substr(at).starts_with(word);
    at += is ? word.size() : 0;
    return is;
  }
  /// A decimal number without exponent; `unit` is one of its last digit.
  bool number(double& value, double* unit = nullptr) {
    size_t end = at, digits = 0;
    double last = 1;
    if (end < text.size() && (text[end] == '-' || text[end] == '+')) ++end;
    for (bool point = false; end < text.size() && digits < 40; ++end)
      if (digit(text[end])) {
        ++digits;
        last *= point ? 0.1 : 1;
      } else if (text[end] == '.' && !point) {
        point = true;
      } else {
        break;
      }
    if (digits == 0) return false;
    value = number_of(text.substr(at, end - at));
    at = end;
    if (unit) *unit = last;
    return true;
  }
  /// Numbers with ':' between; empty if there is none.
  vector<double> numbers(double* unit = nullptr) {
    vector<double> values;
    double value = 0;
    while (number(value, unit)) {
      values.push_back(value);
      if (!take(":")) break;
    }
    return values;
  }
};

using Words = map<string, vector<double>>;  ///< "M665 L": values. mm, degrees

/// A command that sets where the nozzle is, its words that are used, and those without influence on
/// heights and geometry, "*" all others: steps cancel, Marlin's H includes M206 Z.
struct Command {
  string_view name, used, idle;
  double neutral = 0;  ///< value at which any other word has no influence
};
constexpr Command kCommands[] = {
    {"M665", "LRHXYZABC", "S"}, {"M666", "XYZAB", ""}, {"M92", "XYZ", "*"}, {"M851", "XYZ", ""},
    {"G31", "XYZ", "*"},        {"M206", "", ""},      {"M290", "", "R"},   {"M556", "", "SP"},
    {"M579", "", "P", 1},       {"M669", "", "ST", 3}, {"M852", "", ""},    {"G30", "", "*"},
    {"G33", "", "*"},           {"M501", "", "*"},     {"M502", "", "*"},
};
inline const Command* command_of(string_view name) {
  const auto at = std::find_if(std::begin(kCommands), std::end(kCommands),
                               [&](const Command& each) { return each.name == name; });
  return at == std::end(kCommands) ? nullptr : at;
}

/// Heights that were probed one after the other with the same settings.
struct Probing {
  string by;                              ///< "G30", "G33" or "G32"
  vector<Vector3> bed;                    ///< x, y, z of Marlin's G30
  map<string, double> g33;                ///< height by name
  vector<double> g32;                     ///< of RepRapFirmware
  map<int, pair<double, double>> places;  ///< of its G30 P…
  map<char, double> options;              ///< of the command G33
  double radius = 0;                      ///< of G33's points, as printed; 0: not
  Words words;                            ///< the settings
  map<string, string> lost;               ///< unknown ones, and what changed them
  int state = 0;                          ///< number of the settings

  int points() const { return int(bed.size() + g33.size() + g32.size()); }
};

/// State of the printer along a session.
class Session {
 public:
  vector<Probing> probings;
  Words words;               ///< at the end
  map<string, string> lost;  ///< at the end
  bool seen = false;         ///< M665's L or R is there

  explicit Session(string_view text) {
    for (const string_view whole : lines_of(text)) line(string(whole.substr(0, whole.find(';'))));
    settle();
    for (Probing& each : probings) {
      // Printed for the first time later, and not changed before: already in force.
      for (const auto& [word, values] : first_)
        if (!each.lost.contains(word)) each.words.try_emplace(word, values);
      if (each.places.size() != each.g32.size()) each.places = places_;
    }
  }

 private:
  Words first_;  ///< of words that were printed before they were changed
  map<int, pair<double, double>> places_;
  map<char, double> options_;
  double radius_ = 0;
  int state_ = 0;
  bool calibrating_ = false;  ///< G33 was sent without V0, and its result is not printed yet

  void set(const string& word, vector<double> values, double unit, bool sent) {
    seen = seen || word == "M665 L" || word == "M665 R";
    const auto now = words.find(word);
    if (now == words.end()) {
      if (!sent && !lost.contains(word))
        first_.try_emplace(word, values);
      else
        ++state_;
    } else {
      // What is printed is rounded: the exact value stays.
      bool same = now->second.size() == values.size();
      for (size_t k = 0; same && k < values.size(); ++k)
        same = fabs(values[k] - now->second[k]) <= (sent ? 0 : 0.501 * unit);
      if (same) return;
      ++state_;
    }
    words[word] = std::move(values);
    lost.erase(word);
  }
  void lose(const string& word, const string& by) {
    words.erase(word);
    lost[word] = by;
    ++state_;
  }
  /// G33 P1 changes the height alone, P2 and T no angles.
  void calibrated(const string& by) {
    calibrating_ = false;
    const bool g33 = by == "G33";
    const auto P = options_.find('P');
    const double points = g33 && P != options_.end() ? P->second : 3;
    lose("M665 H", by);
    if (points == 1) return;
    for (const char* word : {"M665 R", "M666 X", "M666 Y", "M666 Z"}) lose(word, by);
    if (points >= 3 && !(g33 && options_.contains('T')))
      for (const char* word : {"M665 X", "M665 Y", "M665 Z"}) lose(word, by);
  }
  void settle() {
    if (calibrating_) calibrated("G33");
  }
  Probing& probing(const string& by, bool anew = false) {
    if (anew || probings.empty() || probings.back().by != by || probings.back().state != state_)
      probings.push_back({by, {}, {}, {}, places_, options_, radius_, words, lost, state_});
    return probings.back();
  }

  void command(const string& name, Scan& scan, bool sent) {
    map<char, double> own;
    if (name != "G33") settle();
    for (;;) {
      scan.space();
      if (scan.done() || scan.text[scan.at] < 'A' || scan.text[scan.at] > 'Z') break;
      const char letter = scan.text[scan.at++];
      double unit = 1;
      vector<double> values = scan.numbers(&unit);
      if (values.empty() && name != "G33") break;
      own[letter] = values.empty() ? 1 : values[0];
      if (name != "G30" && name != "G33") set(name + " " + letter, values, unit, sent);
    }
    if (name == "G30" && own.contains('P') && own.contains('X') && own.contains('Y')) {
      const int number = int(std::clamp(own['P'], -1.0, 1e6));
      if (number == 0) places_.clear();
      places_[number] = {own['X'], own['Y']};
    } else if (name == "G33") {
      settle();
      calibrating_ = !own.contains('V') || own['V'] != 0;
      options_ = own;
      radius_ = 0;
      if (!probings.empty()) probings.back().state = -1;  // the next one is another
    } else if (name == "M501" || name == "M502") {
      for (const Words known = words; const auto& [word, _] : known)
        if (word.starts_with("M665") || word.starts_with("M666") || word.starts_with("M851"))
          lose(word, name);
    }
  }

  void line(const string& text) {
    const auto has = [&](string_view word) { return text.find(word) != text.npos; };
    const auto after = [&](string_view word, auto&& take) {
      if (const size_t at = text.find(word); at != text.npos) {
        Scan scan{text, at + word.size()};
        scan.space();
        double unit = 1;
        if (const vector<double> values = scan.numbers(&unit); !values.empty()) take(values, unit);
      }
    };
    const auto printed = [&](string_view label, const string& word) {
      after(label, [&](const auto& values, double unit) { set(word, values, unit, false); });
    };
    const bool sent = has("Send:") || has("SENDING:") || text.starts_with('>');
    if (has("nknown command")) return;
    if (has("Iteration :") || has("No convergence") || has("Calibration OK")) calibrated("G33");
    if (has(" factors using "))
      after("Calibrated ", [&](const auto& factors, double) {
        calibrated("G32");
        if (factors[0] == 7 || factors[0] == 9) lose("M665 L", "G32");
        if (factors[0] >= 8) lose("M666 A", "G32"), lose("M666 B", "G32");
      });
    after("at radius:", [&](const auto& values, double) { radius_ = values[0]; });
    if (has(".Height:")) {
      printed(".Height:", "M665 H");
      printed("Radius:", "M665 R");
      for (const char axis : {'x', 'y', 'z'})
        printed({string("E") + axis + ":"}, string("M666 ") + char(axis - 32));
    }
    for (const char axis : {'x', 'y', 'z'})
      printed({string(" T") + axis + ":"}, string("M665 ") + char(axis - 32));
    if (has("delta radius ") && has("iagonal")) {  // RepRapFirmware's answers to M665 and M666
      settle();
      printed(has("Diagonals ") ? "Diagonals " : "Diagonal ", "M665 L");
      printed("delta radius ", "M665 R");
      printed("homed height ", "M665 H");
      printed("bed radius ", "M665 B");
      for (const char axis : {'X', 'Y', 'Z'})
        printed({string(", ") + axis + " "}, string("M665 ") + axis);
    }
    if (has("ndstop adjustments ")) {
      printed("adjustments X", "M666 X");
      printed(" Y", "M666 Y");
      printed(" Z", "M666 Z");
      printed("tilt X", "M666 A");
      printed("% Y", "M666 B");
    }
    for (Scan scan{text}; !scan.done(); ++scan.at) {
      const size_t begin = scan.at;
      if (!scan.starts_word()) {
      } else if (text[begin] == 'M' || text[begin] == 'G') {
        ++scan.at;
        double number = 0;
        const size_t from = scan.at;
        if (digit(scan.done() ? ' ' : text[from]) && scan.number(number)) {
          const string name = text.substr(begin, scan.at - begin);
          if (command_of(name) && text.find(" Auto Calibrate", begin) == text.npos)
            command(name, scan, sent);
        }
      } else if (scan.take("Bed X:")) {
        Vector3 at;
        const auto next = [&](string_view name, double& value) {
          scan.space();
          if (!scan.take(name)) return false;
          scan.space();
          return scan.number(value);
        };
        if (next("", at[0]) && next("Y:", at[1]) && next("Z:", at[2])) {
          settle();
          probing("G30").bed.push_back(at);
        }
      } else if (scan.take("bed probe heights:") || scan.take("Bed probe heights:")) {
        Probing& of = probing("G32", true);
        for (double z = 0; scan.space(), scan.number(z);) of.g32.push_back(z);
      } else if (!sent) {
        for (const char* name : {"c:", "x:", "y:", "z:", "yz:", "zx:", "xy:"}) {
          double z = 0;
          scan.at = begin;
          if (!scan.take(name) || !scan.number(z)) continue;
          const string point(name, string_view(name).size() - 1);
          const bool again = !probings.empty() && probings.back().by == "G33" &&
                             probings.back().g33.contains(point);
          if (again) settle();
          probing("G33", again).g33[point] = z;
        }
      }
      scan.at = begin;
    }
  }
};
}  // namespace truepose::printers
