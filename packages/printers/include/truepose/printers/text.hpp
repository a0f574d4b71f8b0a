// Text of printers: numbers, formatting, and JSON, without exceptions, streams or locale.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace truepose::printers {
using std::sqrt, std::fabs, std::pow, std::sin, std::cos, std::min, std::max, std::isfinite,
    std::isnan;
using std::string, std::string_view, std::vector, std::map, std::pair, std::size_t, std::to_string;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMm = 1e-3, kDegree = 3.14159265358979323846 / 180;

/// Text of at most 4000 bytes by printf's format.
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
inline string format(const char* form, ...) {
  char text[4000];
  std::va_list values;
  va_start(values, form);
  const int size = std::vsnprintf(text, sizeof text, form, values);
  va_end(values);
  return size < 0 ? string() : string(text);
}

inline bool blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
inline bool digit(char c) { return c >= '0' && c <= '9'; }
inline bool wordy(char c) {
  return digit(c) || c == '_' || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c < 0;
}
inline string lower(string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c + 'a' - 'A');
  return text;
}
inline string_view trimmed(string_view text) {
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// The finite number that a text is, NaN if it is none.
inline double number_of(string_view text) {
  const string word(trimmed(text));
  if (word.empty() || word.find_first_not_of("+-.0123456789eE") != word.npos) return kNaN;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  return end == word.c_str() + word.size() && isfinite(value) ? value : kNaN;
}

/// A number with significant digits and no exponent; 0 below 0.00005.
inline string shown(double value, int significant = 2) {
  if (!isfinite(value)) return "nan";
  if (fabs(value) < 5e-5) return "0";
  const int digits = significant - 1 - int(std::floor(std::log10(fabs(value))));
  const double unit = pow(10.0, digits);
  return format("%.*f", digits > 0 ? digits : 0, std::nearbyint(value * unit) / unit);
}
inline string shown_mm(double value) { return shown(value / kMm); }

/// The lines of a text that end in LF, CR LF or CR.
inline vector<string_view> lines_of(string_view text) {
  vector<string_view> lines;
  for (size_t from = 0;;) {
    const size_t end = text.find_first_of("\r\n", from);
    lines.push_back(text.substr(from, end == text.npos ? end : end - from));
    if (end == text.npos) return lines;
    from = end + 1 + (text.substr(end, 2) == "\r\n");
  }
}

/// Bytes of the UTF-8 character at the start of a text, 0 if there is none.
inline int utf8(string_view text) {
  const unsigned char lead = static_cast<unsigned char>(text[0]);
  const int size = lead < 0x80 ? 1 : lead < 0xC2 ? 0 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;
  if (lead >= 0xF5 || size_t(size) > text.size()) return 0;
  for (int k = 1; k < size; ++k)
    if ((static_cast<unsigned char>(text[k]) & 0xC0) != 0x80) return 0;
  return size;
}

/// Calls f with each character of a text, and whether it is valid UTF-8.
void characters(string_view text, auto&& f) {
  for (size_t k = 0; k < text.size();) {
    const int size = utf8(text.substr(k));
    f(text.substr(k, max(size, 1)), size > 0);
    k += max(size, 1);
  }
}

/// A text for one line of a message: control characters as escapes, at most `most` bytes and "…".
inline string one_line(string_view text, size_t most = 60) {
  string line;
  bool whole = true;
  characters(text, [&](string_view c, bool valid) {
    whole = whole && line.size() + c.size() <= most;
    if (!whole) return;
    if (!valid || (c.size() == 1 && (c[0] < ' ' || c[0] == 127)))
      line += format("\\x%02x", unsigned(static_cast<unsigned char>(c[0])));
    else
      line += c;
  });
  return whole ? line : line + "…";
}

/// Writer of one JSON text; NaN and infinity are null.
class Json {
 public:
  Json& key(string_view name) { return value(name).raw(":"); }
  Json& open(char bracket) { return comma().raw(string_view(&bracket, 1)); }
  Json& close(char bracket) {
    text_ += bracket;
    return *this;
  }
  Json& value(double number) {
    return comma().raw(isfinite(number) ? format("%.17g", number) : "null");
  }
  Json& value(bool flag) { return comma().raw(flag ? "true" : "false"); }
  Json& value(string_view text) {
    comma().raw("\"");
    characters(text, [&](string_view c, bool valid) {
      const bool escaped = c == "\"" || c == "\\";
      if (!valid)
        text_ += "\\ufffd";
      else if (c.size() == 1 && (c[0] < ' ' || c[0] == '<'))  // '<': safe in a page's script
        text_ += format("\\u%04x", unsigned(c[0]));
      else
        (text_ += escaped ? "\\" : "") += c;
    });
    return raw("\"");
  }
  Json& value(const char* text) { return value(string_view(text)); }
  Json& value(const string& text) { return value(string_view(text)); }
  /// Any range of values.
  template <class Range>
  Json& value(const Range& range) {
    open('[');
    for (const auto& each : range) value(each);
    return close(']');
  }
  /// An array of `count` elements, each written by f(k).
  Json& list(size_t count, auto&& f) {
    open('[');
    for (size_t k = 0; k < count; ++k) f(k);
    return close(']');
  }
  /// Members by name and value.
  Json& members() { return *this; }
  Json& members(string_view name, const auto& of, const auto&... more) {
    return key(name).value(of).members(more...);
  }
  Json& object(const auto&... members_) { return open('{').members(members_...).close('}'); }
  const string& text() const { return text_; }

 private:
  Json& comma() {
    if (!text_.empty() && string_view("[{:").find(text_.back()) == string_view::npos) text_ += ',';
    return *this;
  }
  Json& raw(string_view text) {
    text_ += text;
    return *this;
  }
  string text_;
};
}  // namespace truepose::printers
