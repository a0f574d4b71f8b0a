// Text of printers: numbers, formatting, and JSON, without exceptions, streams or locale.
#pragma once

#include <cmath>
#include <cstdarg>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

namespace truepose::printers {
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr double kMm = 1e-3, kDegree = 3.14159265358979323846 / 180;

/// Text of at most 4000 bytes by printf's format.
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
inline std::string format(const char* form, ...) {
  char text[4000];
  std::va_list values;
  va_start(values, form);
  const int size = std::vsnprintf(text, sizeof text, form, values);
  va_end(values);
  return size < 0 ? std::string() : std::string(text);
}

inline bool blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
inline bool digit(char c) { return c >= '0' && c <= '9'; }
inline bool wordy(char c) {
  return digit(c) || c == '_' || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c < 0;
}
inline std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = char(c + 'a' - 'A');
  return text;
}
inline std::string_view trimmed(std::string_view text) {
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// The finite number that a text is, NaN if it is none.
inline double number_of(std::string_view text) {
  const std::string word(trimmed(text));
  if (word.empty() || word.find_first_not_of("+-.0123456789eE") != word.npos) return kNaN;
  char* end = nullptr;
  const double value = std::strtod(word.c_str(), &end);
  return end == word.c_str() + word.size() && std::isfinite(value) ? value : kNaN;
}

/// A number with significant digits and no exponent; 0 below 0.00005.
inline std::string shown(double value, int significant = 2) {
  if (!std::isfinite(value)) return "nan";
  if (std::fabs(value) < 5e-5) return "0";
  const int digits = significant - 1 - int(std::floor(std::log10(std::fabs(value))));
  const double unit = std::pow(10.0, digits);
  return format("%.*f", digits > 0 ? digits : 0, std::nearbyint(value * unit) / unit);
}
inline std::string shown_mm(double value) { return shown(value / kMm); }

/// The lines of a text that end in LF, CR LF or CR.
inline std::vector<std::string_view> lines_of(std::string_view text) {
  std::vector<std::string_view> lines;
  for (std::size_t from = 0;;) {
    const std::size_t end = text.find_first_of("\r\n", from);
    lines.push_back(text.substr(from, end == text.npos ? end : end - from));
    if (end == text.npos) return lines;
    from = end + 1 + (text.substr(end, 2) == "\r\n");
  }
}

/// Bytes of the UTF-8 character at the start of a text, 0 if there is none.
inline int utf8(std::string_view text) {
  const unsigned char lead = static_cast<unsigned char>(text[0]);
  const int size = lead < 0x80 ? 1 : lead < 0xC2 ? 0 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;
  if (lead >= 0xF5 || std::size_t(size) > text.size()) return 0;
  for (int k = 1; k < size; ++k)
    if ((static_cast<unsigned char>(text[k]) & 0xC0) != 0x80) return 0;
  return size;
}

/// A text for one line of a message: control characters as escapes, at most `most` bytes and "…".
inline std::string one_line(std::string_view text, std::size_t most = 60) {
  std::string line;
  for (std::size_t k = 0; k < text.size();) {
    const int size = utf8(text.substr(k));
    if (line.size() + std::size_t(size) > most) return line + "…";
    if (size == 0 || (size == 1 && (text[k] < ' ' || text[k] == 127)))
      line += format("\\x%02x", unsigned(static_cast<unsigned char>(text[k])));
    else
      line += text.substr(k, std::size_t(size));
    k += std::size_t(size > 0 ? size : 1);
  }
  return line;
}

/// Writer of one JSON text; NaN and infinity are null.
class Json {
 public:
  Json& key(std::string_view name) { return value(name).raw(":"); }
  Json& open(char bracket) { return comma().raw(std::string_view(&bracket, 1)); }
  Json& close(char bracket) {
    text_ += bracket;
    return *this;
  }
  Json& value(double number) {
    return comma().raw(std::isfinite(number) ? format("%.17g", number) : "null");
  }
  Json& value(bool flag) { return comma().raw(flag ? "true" : "false"); }
  Json& value(std::string_view text) {
    comma().raw("\"");
    for (std::size_t k = 0; k < text.size();) {
      const int size = utf8(text.substr(k));
      const char c = text[k];
      if (size == 0)
        text_ += "\\ufffd";
      else if (size == 1 && (c < ' ' || c == '<'))  // '<': safe in a page's script
        text_ += format("\\u%04x", unsigned(c));
      else
        (size == 1 && (c == '"' || c == '\\') ? text_ += '\\' : text_) +=
            text.substr(k, std::size_t(size));
      k += std::size_t(size > 0 ? size : 1);
    }
    return raw("\"");
  }
  Json& value(const char* text) { return value(std::string_view(text)); }
  Json& value(const std::string& text) { return value(std::string_view(text)); }
  /// Any range of values.
  template <class Range>
  Json& value(const Range& range) {
    open('[');
    for (const auto& each : range) value(each);
    return close(']');
  }
  template <class Value>
  Json& member(std::string_view name, const Value& of) {
    return key(name).value(of);
  }
  const std::string& text() const { return text_; }

 private:
  Json& comma() {
    if (!text_.empty() && std::string_view("[{:").find(text_.back()) == std::string_view::npos)
      text_ += ',';
    return *this;
  }
  Json& raw(std::string_view text) {
    text_ += text;
    return *this;
  }
  std::string text_;
};
}  // namespace truepose::printers
