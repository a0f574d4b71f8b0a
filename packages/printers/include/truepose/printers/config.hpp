// Klipper's configuration: reader of printer.cfg and klippy.log, writer of printer.cfg.
//
// As in Klipper (klippy/configfile.py), a comment begins at any '#', or at a ';' at the start of a
// line or after a space. Lines that begin with "#*#" were written by SAVE_CONFIG; the file's own
// values take precedence over them. Included files are named, not read. A klippy.log has the whole
// configuration, includes too, at every start of Klipper; the last one counts.
#pragma once

#include "truepose/printers/text.hpp"

namespace truepose::printers {
constexpr size_t kMostBytes = 1000000;  ///< ten times the longest real configuration
constexpr double kLargest = 1e12;       ///< larger numbers would overflow in powers
constexpr string_view kSaved = "#*#";
constexpr string_view kSavedHeader =
    "#*# <---------------------- SAVE_CONFIG ---------------------->\n"
    "#*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n"
    "#*#\n";

using Options = map<string, string>;
/// By section and option; the second, in the order of the file.
using Sections = map<string, Options>;
using Place = pair<string, string>;

/// A configuration. The first error found by any function is kept; results after it are NaN.
struct Config {
  string kind = "klipper";  ///< or "marlin", "rrf"
  bool log = false;         ///< of a klippy.log
  bool own_rods = true;     ///< the firmware has a rod length for each tower
  vector<string> lines;
  string end = "\n", mark;  ///< first line end; byte-order mark, or empty
  Sections values, saved;   ///< as Klipper reads them; those of the saved block
  vector<Place> saved_order;
  map<Place, double> off;  ///< first number commented out in the file's own part
  vector<string> included, notes;
  string error;

  void fail(const string& text) {
    if (error.empty()) error = text;
  }
  void fail(const string& section, const string& option, const string& text) {
    const string* value = find(section, option);
    fail("[" + section + "] " + option + (value ? " = " + one_line(*value) : "") + ": " + text);
  }
  const string* find(const string& section, const string& option) const {
    const auto of = values.find(section);
    if (of == values.end()) return nullptr;
    const auto at = of->second.find(option);
    return at == of->second.end() ? nullptr : &at->second;
  }
  bool has(const string& section, const string& option) const {
    return find(section, option) != nullptr;
  }
  string word(const string& section, const string& option) {
    if (const string* value = find(section, option)) return *value;
    const string where = "; it may be in " + files() + ": not read";
    fail(section, option, "is missing" + (included.empty() ? "" : where));
    return {};
  }
  /// Names of the included files, for one line.
  string files() const {
    string names;
    for (const string& name : included) names += (names.empty() ? "" : ", ") + name;
    return one_line(names, 200);
  }
  double checked(const string& section, const string& option, string_view text,
                 double above = -kLargest) {
    const double value = number_of(text);
    if (isnan(value)) fail(section, option, "must be a number");
    if (fabs(value) >= kLargest)
      fail(section, option, format("must be less than %g", kLargest));
    else if (value <= above)
      fail(section, option, format("must be greater than %g", above));
    return value;
  }
  double number(const string& section, const string& option, double above = -kLargest) {
    const string text = word(section, option);
    return error.empty() ? checked(section, option, text, above) : kNaN;
  }
  double number_or(const string& section, const string& option, double otherwise,
                   double above = -kLargest) {
    return has(section, option) ? number(section, option, above) : otherwise;
  }
  /// Parts of an option between separators.
  vector<string> parts(string_view text, char by) const {
    vector<string> found(1);
    for (const char c : text)
      if (c == by)
        found.emplace_back();
      else
        found.back() += c;
    return found;
  }
  /// A gear ratio as 80:16, 2:1: motor turns per turn of the shaft.
  double ratio(const string& section, const string& option) {
    double result = 1;
    for (const string& pair : parts(word(section, option), ',')) {
      const vector<string> of = parts(pair, ':');
      if (of.size() == 2)
        result *= checked(section, option, of[0], 0) / checked(section, option, of[1], 0);
      else
        fail(section, option, "must be pairs of numbers, as 80:16, 2:1");
    }
    return result;
  }
  /// The saved value of an option that the file itself sets to another value, or null.
  const string* twice(const string& section, const string& option) const {
    const auto of = saved.find(section);
    if (of == saved.end()) return nullptr;
    const auto at = of->second.find(option);
    const string* counts = find(section, option);
    return at == of->second.end() || (counts && *counts == at->second) ? nullptr : &at->second;
  }
  /// Number of the first line, from 1, in SAVE_CONFIG's block that it did not write; 0: none.
  int broken() const {
    size_t last = lines.size();
    while (last > 0 && trimmed(lines[last - 1]).empty()) --last;
    bool within = false;
    for (size_t k = 0; k < last; ++k) {
      const bool of_block = lines[k].starts_with(kSaved);
      if (within && !of_block) return int(k) + 1;
      within = within || of_block;
    }
    return 0;
  }
};

/// The section that a line begins, empty if none.
inline string section_of(string_view line) {
  const size_t end = line.rfind(']');
  return line.starts_with('[') && end != line.npos && end > 1
             ? string(trimmed(line.substr(1, end - 1)))
             : string();
}

/// Read sections and options by the rules of Python's configparser, which Klipper uses.
inline void parse_sections(Config& config, const vector<string_view>& lines, Sections& into,
                           vector<Place>* order) {
  Options* section = nullptr;
  string* value = nullptr;
  string name;
  size_t indent = 0;
  for (size_t k = 0; k < lines.size(); ++k) {
    string_view line = lines[k].substr(0, lines[k].find('#'));
    for (size_t at = line.find(';'); at != line.npos; at = line.find(';', at + 1))
      if (at == 0 || blank(line[at - 1])) {
        line = line.substr(0, at);
        break;
      }
    const string_view text = trimmed(line);
    if (text.empty()) {
      if (value) *value += '\n';
      continue;
    }
    const size_t own = size_t(text.data() - line.data());
    if (value && own > indent) {
      (*value += '\n') += text;
      continue;
    }
    indent = own;
    const string at_line = format("not a printer.cfg: line %d: ", int(k) + 1);
    if (const string header = section_of(text); !header.empty()) {
      section = &into[name = header];
      value = nullptr;
      if (order && header.starts_with("include "))
        config.fail(at_line + "include in a saved block");
      if (!order && header.starts_with("include "))
        config.included.emplace_back(trimmed(string_view(header).substr(8)));
      continue;
    }
    const size_t at = text.find_first_of("=:");
    if (!section) return config.fail(at_line + one_line(text) + ": before any [section]");
    if (at == text.npos || at == 0)
      return config.fail(at_line + one_line(text) + ": neither a [section] nor 'option: value'");
    const string option = lower(string(trimmed(text.substr(0, at))));
    const auto [place, is_new] =
        section->insert_or_assign(option, string(trimmed(text.substr(at + 1))));
    value = &place->second;
    if (order && is_new) order->emplace_back(name, option);
  }
  for (auto& [_, options] : into)
    for (auto& [__, of] : options)
      while (!of.empty() && blank(of.back())) of.pop_back();
}

/// An option that a line sets, lower case, and in `rest` what follows; empty if none.
inline string option_of(string_view line, string_view& rest) {
  size_t end = 0;
  while (end < line.size() && wordy(line[end])) ++end;
  size_t at = end;
  while (at < line.size() && blank(line[at])) ++at;
  if (end == 0 || at == line.size() || (line[at] != ':' && line[at] != '=')) return {};
  rest = line.substr(at + 1);
  return lower(string(line.substr(0, end)));
}

/// The commented-out numbers by section, as SAVE_CONFIG leaves replaced values.
inline map<Place, double> commented_out(const auto& lines) {
  map<Place, double> found;
  string section;
  for (const string_view line : lines) {
    if (line.starts_with(kSaved)) continue;
    if (const string header = section_of(line); !header.empty()) section = header;
    if (!line.starts_with('#')) continue;
    string_view rest;
    const string option = option_of(trimmed(line.substr(1)), rest);
    const double value = number_of(rest.substr(0, rest.find_first_of("#;")));
    if (!option.empty() && !isnan(value)) found.try_emplace({section, option}, value);
  }
  return found;
}

/// Read a printer.cfg or klippy.log.
inline Config parse_config(string_view text) {
  Config config;
  constexpr string_view kLogged = "===== Config file =====", kEnd = "=======================";
  size_t begin = text.rfind(kLogged);
  for (; begin != text.npos; begin = begin ? text.rfind(kLogged, begin - 1) : text.npos) {
    const size_t next = begin + kLogged.size();  // a line of its own
    if ((begin == 0 || text[begin - 1] == '\n') && next < text.size() &&
        (text[next] == '\r' || text[next] == '\n'))
      break;
  }
  config.log = begin != text.npos;
  if (config.log) {
    text.remove_prefix(begin + kLogged.size());
    const size_t end = text.find("\n" + string(kEnd));
    if (end == text.npos) config.fail("ends within the configuration of Klipper's last start");
    text = text.substr(0, end);
  }
  if (text.size() > kMostBytes) config.fail(format("more than %d bytes", int(kMostBytes)));
  characters(text, [&](string_view c, bool valid) {
    if (!valid || c[0] == 0) config.fail("not a text file (UTF-8)");
  });
  if (!config.error.empty()) return config;
  if (text.starts_with("\xEF\xBB\xBF")) {
    config.mark = text.substr(0, 3);
    text.remove_prefix(3);
  }
  if (const size_t at = text.find_first_of("\r\n"); at != text.npos)
    config.end = text.substr(at, text.substr(at, 2) == "\r\n" ? 2 : 1);
  const vector<string_view> lines = lines_of(text);
  config.lines.assign(lines.begin(), lines.end());
  vector<string_view> own = lines, block(lines.size());
  bool begun = false;
  for (size_t k = 0; k < lines.size(); ++k)
    if (lines[k].starts_with(kSaved)) {
      own[k] = {};
      block[k] = lines[k].substr(min<size_t>(4, lines[k].size()));
      begun = begun || block[k].starts_with('[');
      if (!begun) block[k] = {};
    }
  Sections first;
  parse_sections(config, own, first, nullptr);
  parse_sections(config, block, config.saved, &config.saved_order);
  config.values = config.saved;
  for (auto& [name, options] : first)
    for (auto& [option, value] : options) config.values[name].insert_or_assign(option, value);
  config.off = commented_out(lines);
  return config;
}

/// The file's text with changed values, as SAVE_CONFIG would write it: the file's own values are
/// commented out and the saved block has the new ones. All else, comments and includes too, stays.
/// `nominal` numbers stay as comments, which Klipper ignores; Config::off reads the first one.
inline string rewritten(const Config& config, const vector<pair<Place, string>>& changes,
                        const vector<pair<Place, double>>& nominal) {
  map<Place, string> changed(changes.begin(), changes.end());
  vector<string> own;
  string section;
  bool replaced = false;
  for (const string& line : config.lines) {
    if (line.starts_with(kSaved)) continue;
    const string header = section_of(line);
    if (!header.empty()) section = header;
    string_view rest;
    const string option = option_of(line, rest);
    if (!header.empty() || !option.empty()) replaced = changed.contains({section, option});
    const bool goes_on = !line.empty() && blank(line[0]) && !trimmed(line).empty();
    own.push_back(replaced && (!option.empty() || goes_on) ? "#" + line : line);
  }
  const map<Place, double> noted = commented_out(own);
  for (const auto& [place, value] : nominal) {
    const auto at = std::find_if(own.begin(), own.end(), [&](const string& line) {
      return section_of(line) == place.first;
    });
    const auto is = noted.find(place);
    if (at != own.end() && (is == noted.end() || is->second != value))
      own.insert(at + 1, "#" + place.second + format(": %.10g", value));
  }
  vector<string> sections;  // in the order of the file
  map<string, string> block;
  const auto set = [&](const Place& place, string value) {
    if (block.try_emplace(place.first).second) sections.push_back(place.first);
    for (size_t k = value.find('\n'); k != value.npos; k = value.find('\n', k + 1))
      value.replace(k, 1, "\n#*# \t");
    block[place.first] += "#*# " + place.second + " = " + value + "\n";
  };
  for (const Place& place : config.saved_order) {
    const auto is = changed.find(place);
    set(place, is == changed.end() ? config.saved.at(place.first).at(place.second) : is->second);
  }
  for (const auto& [place, value] : changes)
    if (const auto of = config.saved.find(place.first);
        of == config.saved.end() || !of->second.contains(place.second))
      set(place, value);
  while (!own.empty() && trimmed(own.back()).empty()) own.pop_back();
  string text;
  for (const string& line : own) (text += line) += '\n';
  (text += '\n') += kSavedHeader;
  for (size_t k = 0; k < sections.size(); ++k)
    text += (k ? "#*#\n#*# [" : "#*# [") + sections[k] + "]\n" + block[sections[k]];
  if (config.end != "\n")
    for (size_t k = text.find('\n'); k != text.npos; k = text.find('\n', k + config.end.size()))
      text.replace(k, 1, config.end);
  return config.mark + text;
}
}  // namespace truepose::printers
