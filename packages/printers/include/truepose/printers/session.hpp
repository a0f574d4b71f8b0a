// Session of a printer, read in order: settings, and probings under them.
//
// A probing belongs to the settings in force when it was taken. M665, M666 and the like set them,
// sent or printed; so do the lines of Marlin's G33 (".Height: … Radius: …"), the answers of
// RepRapFirmware's M665 and M666, Smoothieware's configuration and Repetier's M205. A calibration
// by the printer changes them, M501 and M502 load others: these are unknown until they are printed.
#pragma once

#include "truepose/printers/delta.hpp"
#include "truepose/printers/dialects.hpp"

namespace truepose::printers {
/// Whether a place of a text is the begin of a word.
inline bool begins(string_view text, size_t at) {
  const char c = at > 0 ? text[at - 1] : ' ';
  return !(digit(c) || c == '_' || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c & 0x80));
}

/// Decimal numbers with ':' between, behind spaces at a place of a text, which moves behind them;
/// `unit` is one of the last digit. A comma between digits is a decimal point.
inline vector<double> numbers(string_view text, size_t& at, double& unit) {
  vector<double> values;
  for (at = min(text.find_first_not_of(" \t", at), text.size()); at < text.size(); ++at) {
    const bool sign = text[at] == '-' || text[at] == '+';
    size_t end = min(text.find_first_not_of("0123456789.", at + sign), text.size());
    string word(text.substr(at, end - at));
    if (end > at + sign && end + 1 < text.size() && text[end] == ',' && digit(text[end + 1]) &&
        word.find('.') == word.npos) {
      at = end + 1;
      end = min(text.find_first_not_of("0123456789", at), text.size());
      word += '.' + string(text.substr(at, end - at));
    }
    const double value = number_of(word);
    if (isnan(value)) break;
    values.push_back(value);
    unit = word.find('.') == word.npos ? 1 : pow(0.1, double(word.size() - word.find('.') - 1));
    at = end;
    if (at == text.size() || text[at] != ':') break;
  }
  return values;
}

using Words = map<string, vector<double>>;  ///< "M665 L": values. mm, degrees

/// A command that sets where the nozzle is, and its words without influence on heights and geometry
/// that any dialect has, "*" all: steps cancel.
struct Command {
  string_view name, idle;
  double neutral = 0;  ///< value at which any other word has no influence
};
constexpr Command kCommands[] = {
    {"M665", ""},  {"M666", ""},  {"M92", "*"},   {"M851", "XYZ"},  {"G31", "*"},
    {"M206", ""},  {"M290", "R"}, {"M556", "SP"}, {"M579", "P", 1}, {"M669", "ST", 3},
    {"M852", ""},  {"G30", "*"},  {"G33", "*"},   {"G32", "*"},     {"G100", "*"},
    {"G132", "*"}, {"M501", "*"}, {"M502", "*"},  {"EPR", "*"},
};
inline const Command* command_of(string_view name) {
  const auto at = std::find_if(std::begin(kCommands), std::end(kCommands),
                               [&](const Command& each) { return each.name == name; });
  return at == std::end(kCommands) ? nullptr : at;
}

/// What answers print: in a line with the first text the values of a word behind the second.
constexpr struct {
  const char *in, *label, *word;
} kPrinted[] = {
    {".Height:", ".Height:", "M665 H"},
    {".Height:", "Radius:", "M665 R"},
    {".Height:", "Ex:", "M666 X"},
    {".Height:", "Ey:", "M666 Y"},
    {".Height:", "Ez:", "M666 Z"},
    {" T", " Tx:", "M665 X"},
    {" T", " Ty:", "M665 Y"},
    {" T", " Tz:", "M665 Z"},
    {"delta radius ", "Diagonals ", "M665 L"},
    {"delta radius ", "Diagonal ", "M665 L"},
    {"delta radius ", "delta radius ", "M665 R"},
    {"delta radius ", "homed height ", "M665 H"},
    {"delta radius ", "bed radius ", "M665 B"},
    {"delta radius ", ", X ", "M665 X"},
    {"delta radius ", ", Y ", "M665 Y"},
    {"delta radius ", ", Z ", "M665 Z"},
    {"ndstop adjustments ", "adjustments X", "M666 X"},
    {"ndstop adjustments ", " Y", "M666 Y"},
    {"ndstop adjustments ", " Z", "M666 Z"},
    {"ndstop adjustments ", "adjustments X:", "M666 X"},
    {"ndstop adjustments ", " Y:", "M666 Y"},
    {"ndstop adjustments ", " Z:", "M666 Z"},
    {"ndstop adjustments ", "tilt X", "M666 A"},
    {"ndstop adjustments ", "% Y", "M666 B"},
    {"arm_length", "arm_length", "M665 L"},
    {"arm_radius", "arm_radius", "M665 R"},
    {"gamma_max", "gamma_max", "M665 Z"},
    {"tower1_offset", "tower1_offset", "M665 A"},
    {"tower2_offset", "tower2_offset", "M665 B"},
    {"tower3_offset", "tower3_offset", "M665 C"},
    {"tower1_angle", "tower1_angle", "M665 D"},
    {"tower2_angle", "tower2_angle", "M665 E"},
    {"tower3_angle", "tower3_angle", "M665 H"},
    {"arm1_trim", "arm1_trim", "M665 I"},
    {"arm2_trim", "arm2_trim", "M665 J"},
    {"arm3_trim", "arm3_trim", "M665 K"},
    {"alpha_trim", "alpha_trim", "M666 X"},
    {"beta_trim", "beta_trim", "M666 Y"},
    {"gamma_trim", "gamma_trim", "M666 Z"},
    {"set trim to", "X:", "M666 X"},
    {"set trim to", "Y:", "M666 Y"},
    {"set trim to", "Z:", "M666 Z"},
    {"Setting delta radius", "radius to:", "M665 R"},
};

/// Heights that were probed one after the other with the same settings.
struct Probing {
  string by;                              ///< "G33", "G32", or "G30": with their places
  vector<Vector3> bed;                    ///< x, y, z of these
  map<string, double> g33;                ///< height by name
  vector<double> g32;                     ///< of RepRapFirmware
  map<int, pair<double, double>> places;  ///< of its G30 P…
  map<char, double> options;              ///< of the command G33
  double radius = 0;                      ///< of G33's points, as printed; 0: not
  Words words;                            ///< the settings
  map<string, string> lost;               ///< unknown ones, and what changed them
  int state = 0;                          ///< number of the settings

  int points() const {
    const auto failed = std::count_if(g32.begin(), g32.end(), [](double z) { return isnan(z); });
    return int(bed.size() + g33.size() + g32.size()) - int(failed);
  }
};

inline double option_of(const map<char, double>& of, char letter, double otherwise) {
  const auto at = of.find(letter);
  return at == of.end() ? otherwise : at->second;
}

/// Seconds of the clock in the first words of a line, -1 if there is none.
inline int clock_of(string_view line) {
  line = line.substr(0, 30);
  for (size_t at = line.find(':'); at != line.npos; at = line.find(':', at + 1)) {
    int hour = 0, minute = 0, second = 0;
    const size_t from = at < 2 || !digit(line[at - 2]) ? at - 1 : at - 2;
    const string clock(line.substr(min(from, line.size())));
    if (begins(line, min(from, line.size())) &&
        std::sscanf(clock.c_str(), "%2d:%2d:%2d", &hour, &minute, &second) == 3) {
      const bool later = clock.find("PM") != clock.npos;
      if (later || clock.find("AM") != clock.npos) hour = hour % 12 + 12 * later;
      return (60 * hour + minute) * 60 + second;
    }
  }
  return -1;
}

/// The lines of a text in order of time: RepRapFirmware's web console has the newest on top.
inline vector<string_view> in_order(string_view text) {
  const vector<string_view> lines = lines_of(text);
  vector<vector<string_view>> parts(1);  // those before the first clock, then by clock
  vector<int> clocks;
  for (const string_view line : lines) {
    if (const int clock = clock_of(line); clock >= 0) {
      clocks.push_back(clock);
      parts.emplace_back();
    }
    parts.back().push_back(line);
  }
  if (clocks.empty() || !std::is_sorted(clocks.rbegin(), clocks.rend()) ||
      clocks.front() == clocks.back() ||
      clocks.front() - clocks.back() > 12 * 60 * 60)  // in order, over midnight
    return lines;
  std::reverse(parts.begin() + 1, parts.end());
  vector<string_view> ordered;
  for (const auto& part : parts) ordered.insert(ordered.end(), part.begin(), part.end());
  return ordered;
}

/// State of the printer along a session.
class Session {
 public:
  vector<Probing> probings;
  Words words;               ///< at the end
  map<string, string> lost;  ///< at the end
  bool seen = false;         ///< a length of the rods, a radius, an endstop or a height is there

  Session(string_view text, const Dialect& dialect) : of_(dialect) {
    const char* comment = of_.relative ? ";#" : ";";
    for (const string_view whole : in_order(text))
      line(whole.substr(0, whole.find_first_of(comment)));
    settle();
    for (Probing& each : probings) {
      seen = seen || each.by != "G33";
      // Printed for the first time later, and not changed before: already in force.
      for (const auto& [word, values] : first_)
        if (!each.lost.contains(word)) each.words.try_emplace(word, values);
      if (each.places.size() != each.g32.size()) each.places = places_;
    }
  }

 private:
  const Dialect& of_;
  Words first_;  ///< of words that were printed before they were changed
  map<int, pair<double, double>> places_;
  map<char, double> options_;
  double radius_ = 0;
  int state_ = 0;
  bool calibrating_ = false;  ///< G33 was sent without V0, and its result is not printed yet
  int map_ = 0;               ///< line of RepRapFirmware's height map; 0: none
  double grid_[4] = {};       ///< its first x, first y, distances

  void set(const string& word, vector<double> values, double unit, bool sent) {
    seen = seen || word == of_.rod || word == of_.radius || word == word_of(of_.end, 0);
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
    const double points = g33 ? option_of(options_, 'P', 3) : 3;
    lose(of_.height, by);
    if (points == 1) return;
    lose(of_.radius, by);
    for (int i = 0; i < 3; ++i) {
      lose(word_of(of_.end, i), by);
      if (points >= 3 && !(g33 && options_.contains('T'))) lose(word_of(of_.angle, i), by);
      if (of_.eeprom()) lose(word_of(of_.trim, i), by);
    }
  }
  void settle() {
    if (calibrating_) calibrated("G33");
  }
  Probing& probing(const string& by, bool anew = false) {
    if (anew || probings.empty() || probings.back().by != by || probings.back().state != state_)
      probings.push_back({by, {}, {}, {}, places_, options_, radius_, words, lost, state_});
    return probings.back();
  }

  void command(const string& name, string_view text, size_t at, bool sent) {
    map<char, double> own;
    settle();
    for (;;) {
      while (at < text.size() && blank(text[at])) ++at;
      if (at == text.size() || text[at] < 'A' || text[at] > 'Z') break;
      const char letter = text[at++];
      double unit = 1;
      vector<double> values = numbers(text, at, unit);
      if (values.empty() && name != "G33") break;
      own[letter] = values.empty() ? 1 : values[0];
      if ((name[0] == 'M' || name == "G31") && !(name == "M206" && of_.eeprom()))
        set(name + " " + letter, values, unit, sent);
    }
    for (const char letter : {'X', 'S'})
      if (name == "M206" && of_.eeprom() && own.contains(letter))
        set(format("EPR %.0f", own['P']), {own[letter]}, 1, true);
    if (of_.eeprom() && (name == "G100" || name == "G132" || (name == "G32" && own['S'] > 0)))
      calibrated(name);
    if (name == "G30" && own.contains('P') && own.contains('X') && own.contains('Y')) {
      const int number = int(std::clamp(own['P'], -1.0, 1e6));
      if (number == 0) places_.clear();
      places_[number] = {own['X'], own['Y']};
    } else if (name == "G33" && of_.kind == kDialects->kind) {
      calibrating_ = !own.contains('V') || own['V'] != 0;
      options_ = own;
      radius_ = 0;
      if (!probings.empty()) probings.back().state = -1;  // the next one is another
    } else if (name == "M501" || name == "M502") {
      for (const Words known = words; const auto& [word, _] : known)
        if (word.starts_with("M66") || word.starts_with("M851") || word.starts_with("EPR"))
          lose(word, name);
    }
  }

  void line(string_view text) {
    const auto has = [&](string_view word) { return text.find(word) != text.npos; };
    double unit = 1;
    const auto after = [&](string_view word, size_t from = 0) {
      size_t at = text.find(word, from);
      return at == text.npos ? vector<double>() : numbers(text, at += word.size(), unit);
    };
    const bool sent = has("Send:") || has("SENDING:") || text.starts_with('>');
    if (has("nknown command")) return;
    if (has("height map file"))
      map_ = 1;
    else if (map_)
      return row(parts_of(text, ','));
    if (has("Calibrating Endstops"))
      for (int i = 0; i < 3; ++i) lose(word_of(of_.end, i), "G32");
    if (has("Calibrating delta radius")) lose(of_.radius, "G32");
    if (has("Iteration :") || has("No convergence") || has("Calibration OK")) calibrated("G33");
    if (const auto factors = after("Calibrated "); has(" factors using ") && !factors.empty()) {
      calibrated("G32");
      if (factors[0] == 7 || factors[0] == 9) lose("M665 L", "G32");
      if (factors[0] >= 8) lose("M666 A", "G32"), lose("M666 B", "G32");
    }
    if (const auto values = after("at radius:"); !values.empty()) radius_ = values[0];
    for (const auto& [in, label, word] : kPrinted)
      if (const auto values = after(label); has(in) && !values.empty())
        set(word, values, unit, false);
    if (const size_t at = text.find("EPR:"); at != text.npos && of_.eeprom()) {
      const vector<string> parts = parts_of(text.substr(at), ' ');
      size_t from = 0;
      if (parts.size() > 2)
        if (const double whole = number_of(parts[2]); !isnan(whole))
          set("EPR " + parts[1], {whole}, 1e-3, false);
        else if (const auto values = numbers(parts[2], from, unit); !values.empty())
          set("EPR " + parts[1], {values[0]}, 1e-3, false);  // of a decimal comma
    }
    if (const auto number = after("<epr pos='"), value = after("value='");
        of_.eeprom() && !number.empty() && !value.empty())  // a file of Repetier-Host
      set(format("EPR %.0f", number[0]), {value[0]}, 1e-3, false);
    string caps(text);  // commands may be typed in lower case
    for (char& c : caps)
      if (c >= 'a' && c <= 'z') c = char(c + 'A' - 'a');
    for (size_t at = caps.find_first_of("MG"); at < caps.size();
         at = caps.find_first_of("MG", at + 1)) {
      const size_t end = min(caps.find_first_not_of("0123456789.", at + 1), caps.size());
      const string name = caps.substr(at, end - at);
      if (begins(caps, at) && command_of(name) && text.find(" Auto Calibrate", at) == text.npos)
        command(name, caps, end, sent);
    }
    const auto point = [&](string_view in, const char* labels, double up = 1) {
      const size_t at = text.find(in);
      if (at == text.npos) return;
      const vector<string> each = parts_of(labels, ' ');
      const auto x = after(each[0], at), y = after(each[1], at), z = after(each[2], at);
      if (x.empty() || y.empty() || z.empty()) return;
      settle();
      probing("G30").bed.emplace_back(x[0], y[0], up * z[0]);
    };
    point("Bed X:", "X: Y: Z:");
    point("Bed Position X:", "X: Y: Z:");
    if (of_.eeprom()) {
      if (const auto map = after("zCorr:"); !map.empty() && map[0] != 0)
        set("EPR zCorr", map, HUGE_VAL, false);
      point("Z-probe:", "X: Y: Z-probe:", -1);  // the way down
    } else if (of_.relative && !sent) {
      if (has("PROBE: X") || (!has("X:") && text.find_first_of("GM") == text.npos))
        point("X", "X Y Z");
      else if (has(" A:") && has(" B:") && !has("C: X:"))
        point("X:", "X: Y: Z:", -1);  // the way down
    }
    if (const size_t at = text.find("ed probe heights:"); at != text.npos) {
      vector<double>& heights = probing("G32", true).g32;
      for (const string& part : parts_of(text.substr(at + 17), ' ')) {
        if (part.find("mean") != part.npos) break;
        size_t from = 0;
        if (const auto z = numbers(part, from, unit); !z.empty())
          heights.push_back(z[0]);
        else if (part.starts_with("set") ||
                 part.starts_with("failed"))  // "not set", "probing failed"
          heights.push_back(kNaN);
      }
    }
    for (const string name : {"c", "x", "y", "z", "yz", "zx", "xy"})
      for (size_t at = text.find(name + ":");
           of_.kind == kDialects->kind && !sent && at < text.size();
           at = text.find(name + ":", at + 1))
        if (const auto z = after(name + ":", at); begins(text, at) && !z.empty()) {
          const bool again = !probings.empty() && probings.back().by == "G33" &&
                             probings.back().g33.contains(name);
          if (again) settle();
          probing("G33", again).g33[name] = z[0];
        }
  }

  /// A row of RepRapFirmware's height map: names, grid, then heights, "0" where none was probed.
  void row(const vector<string>& parts) {
    vector<double> values;
    for (const string& part : parts)
      if (const double value = number_of(part); !isnan(value)) values.push_back(value);
    const size_t count = values.size();
    if (map_ == 2 && (count == 8 || count == 9)) {
      const double grid[] = {values[0], values[2], values[5], values[count - 3]};
      std::copy(grid, grid + 4, grid_);
      probing("G30", true);
    } else if (map_ > 2 && count == parts.size() && count > 1) {
      for (size_t k = 0; k < count; ++k)
        if (trimmed(parts[k]) != "0")
          probings.back().bed.emplace_back(grid_[0] + double(k) * grid_[2],
                                           grid_[1] + (map_ - 3) * grid_[3], values[k]);
    } else if (map_ > 1) {
      map_ = -1;
    }
    ++map_;
  }
};
}  // namespace truepose::printers
