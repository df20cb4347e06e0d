// Lines, words and numbers of text formats. Used by OBJ, MTL, PLY, STL
// and COLLADA.
#pragma once

#include <algorithm>
#include <charconv>
#include <cmath>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "renderer/assets/refuse.h"
#include "renderer/base/types.h"

namespace heliograph::assets {

[[nodiscard]] inline std::string_view as_text(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

[[nodiscard]] constexpr bool is_space(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }
[[nodiscard]] constexpr bool is_no_space(char c) { return !is_space(c); }

[[nodiscard]] inline std::string_view trimmed(std::string_view text) {
  const auto first = std::ranges::find_if(text, is_no_space);
  auto last = text.end();
  while (last != first && is_space(last[-1])) --last;
  return {first, last};
}

/// Takes the next word off the front of `text`; empty at the end.
[[nodiscard]] inline std::string_view take_word(std::string_view& text) {
  const auto first = std::ranges::find_if(text, is_no_space);
  const auto last = std::find_if(first, text.end(), is_space);
  const std::string_view word(first, last);
  text = {last, text.end()};
  return word;
}

[[nodiscard]] inline std::string lower(std::string_view text) {
  std::string out(text);
  for (char& c : out) c = c >= 'A' && c <= 'Z' ? char(c + ('a' - 'A')) : c;
  return out;
}

/// Characters that no text has.
[[nodiscard]] inline bool has_controls(std::string_view text) {
  return std::ranges::any_of(text, [](char c) { return u8(c) < ' ' && !(c >= '\t' && c <= '\r'); });
}

/// Without the byte order mark that some editors put before UTF-8.
[[nodiscard]] inline std::string_view without_mark(std::string_view text) {
  constexpr std::string_view kMark = "\xef\xbb\xbf";
  return text.starts_with(kMark) ? text.substr(kMark.size()) : text;
}

/// A number that is the whole word, as a T holds it.
template <class T>
[[nodiscard]] std::optional<T> parse(std::string_view word) {
  T value{};
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  const bool whole = error == std::errc() && end == word.data() + word.size();
  return whole ? std::optional(value) : std::nullopt;
}

/// A number that is the whole word and that f32 can hold.
[[nodiscard]] inline std::optional<double> parse_double(std::string_view word) {
  if (word.starts_with('+')) word.remove_prefix(1);
  double value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  const bool whole = end == word.data() + word.size() && !word.empty();
  const bool tiny = word.find("e-") != word.npos || word.find("E-") != word.npos;
  if (error == std::errc::result_out_of_range && whole && tiny) return 0.0;
  if (error != std::errc() || !whole || !std::isfinite(float(value))) return std::nullopt;
  return value;
}
[[nodiscard]] inline std::optional<float> parse_number(std::string_view word) {
  const std::optional<double> value = parse_double(word);
  return value ? std::optional(float(*value)) : std::nullopt;
}

[[nodiscard]] inline double take_double(std::string_view& text, const std::string& where) {
  const std::string_view word = take_word(text);
  const std::optional<double> value = parse_double(word);
  if (!value) {
    refuse(where, word.empty() ? "a number is missing" : "is not a finite number");
  }
  return *value;
}
[[nodiscard]] inline float take_number(std::string_view& text, const std::string& where) {
  return float(take_double(text, where));
}

/// True if a program wrote this word for a number that is none: nan, -nan(ind), inf, 1.#QNAN.
[[nodiscard]] inline bool is_no_number(std::string_view word) {
  if (word.starts_with('-') || word.starts_with('+')) word.remove_prefix(1);
  const std::string start = lower(word.substr(0, 3));
  return start == "nan" || start == "inf" || start == "1.#";
}

/// Lines of a text, without their ends; a backslash at the end joins the next line, but for a
/// comment's. Lines of a text without line feeds end with carriage returns.
class Lines {
 public:
  explicit Lines(std::string_view text)
      : rest_(without_mark(text)), end_(rest_.find('\n') == rest_.npos ? '\r' : '\n') {}

  /// The next line, trimmed; nullopt at the end. Valid until the next call.
  [[nodiscard]] std::optional<std::string_view> next() {
    if (rest_.empty()) return std::nullopt;
    std::string_view line = one();
    if (!line.ends_with('\\') || line.starts_with('#')) return line;
    joined_.clear();
    while (line.ends_with('\\')) {
      joined_ += line.substr(0, line.size() - 1);
      joined_ += ' ';
      line = rest_.empty() ? std::string_view() : one();
    }
    joined_ += line;
    return joined_;
  }
  /// "line 17" of the line returned last.
  [[nodiscard]] std::string where() const { return fmt::format("line {}", number_); }

 private:
  std::string_view one() {
    const std::size_t end = std::min(rest_.find(end_), rest_.size());
    const std::string_view line = trimmed(rest_.substr(0, end));
    rest_.remove_prefix(std::min(end + 1, rest_.size()));
    ++number_;
    return line;
  }
  std::string_view rest_;
  char end_;
  std::string joined_;
  u64 number_ = 0;
};

/// sRGB (IEC 61966-2-1) to linear.
[[nodiscard]] inline float linear_from_srgb(float c) {
  return c <= 0.04045f ? c / 12.92f : std::pow((c + 0.055f) / 1.055f, 2.4f);
}

}  // namespace heliograph::assets
