#include "renderer/assets/ply_header.h"

#include <algorithm>
#include <bit>
#include <charconv>
#include <cmath>
#include <cstring>
#include <limits>

#include "renderer/assets/bundle.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets::ply {
namespace {

constexpr std::array<u8, 8> kTypeBytes = {1, 1, 2, 2, 4, 4, 4, 8};

Type type_of(std::string_view name, const std::string& where) {
  constexpr std::array<std::array<std::string_view, 2>, 8> kNames = {{{"char", "int8"},
                                                                      {"uchar", "uint8"},
                                                                      {"short", "int16"},
                                                                      {"ushort", "uint16"},
                                                                      {"int", "int32"},
                                                                      {"uint", "uint32"},
                                                                      {"float", "float32"},
                                                                      {"double", "float64"}}};
  for (std::size_t i = 0; i < kNames.size(); ++i) {
    if (std::ranges::find(kNames[i], name) != kNames[i].end()) return Type(i);
  }
  refuse(where, fmt::format("'{}' is not a PLY type", clean_name(name, "")));
}

u64 parse_count(std::string_view word, const std::string& where) {
  u64 value = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (error != std::errc() || end != word.data() + word.size()) {
    refuse(where, "the count is not a whole number");
  }
  return value;
}

void header_line(std::string_view line, const std::string& where, Header& header) {
  const std::string_view key = take_word(line);
  if (key == "format") {
    const std::string_view name = take_word(line);
    if (name == "binary_little_endian") {
      header.encoding = Encoding::kLittle;
    } else if (name == "binary_big_endian") {
      header.encoding = Encoding::kBig;
    } else if (name != "ascii") {
      refuse(where, "the format is not ascii, binary_little_endian or binary_big_endian");
    }
  } else if (key == "element") {
    const std::string name(take_word(line));
    header.elements.push_back({name, parse_count(take_word(line), where), {}});
  } else if (key == "property") {
    if (header.elements.empty()) refuse(where, "a property comes before any element");
    Property property;
    std::string_view type = take_word(line);
    if (type == "list") {
      property.count = type_of(take_word(line), where);
      type = take_word(line);
    }
    property.type = type_of(type, where);
    property.name = take_word(line);
    header.elements.back().properties.push_back(std::move(property));
  } else if (key == "comment") {
    if (lower(take_word(line)) == "texturefile") header.textures.emplace_back(trimmed(line));
  } else if (key != "obj_info" && !key.empty()) {
    header.unread.push_back(clean_name(key, ""));
  }
}

template <class T>
double as(const std::array<char, 8>& bytes) {
  T number;
  std::memcpy(&number, bytes.data(), sizeof number);
  return double(number);
}
double value(const std::array<char, 8>& bytes, Type type) {
  switch (type) {
    case Type::kI8:
      return as<std::int8_t>(bytes);
    case Type::kU8:
      return as<u8>(bytes);
    case Type::kI16:
      return as<std::int16_t>(bytes);
    case Type::kU16:
      return as<u16>(bytes);
    case Type::kI32:
      return as<i32>(bytes);
    case Type::kU32:
      return as<u32>(bytes);
    case Type::kF32:
      return as<float>(bytes);
    case Type::kF64:
      return as<double>(bytes);
  }
  return 0;
}

}  // namespace

Header read_header(std::string_view text) {
  Header header;
  const std::size_t first = std::min(text.find_first_of("\r\n"), text.size());
  if (first == text.size()) refuse("header", "end_header is missing");
  const char line_end = text.substr(first).starts_with("\r\n") ? '\n' : text[first];
  u32 number = 0;
  while (true) {
    const std::size_t end = text.find(line_end, header.size);
    if (end == text.npos) refuse("header", "end_header is missing");
    const std::string_view line =
        trimmed(without_mark(text.substr(header.size, end - header.size)));
    header.size = end + 1;
    ++number;
    if (number == 1 && line != "ply") refuse("line 1", "a PLY file begins with 'ply'");
    if (line == "end_header") return header;
    if (number > 1) header_line(line, fmt::format("line {}", number), header);
  }
}

double Numbers::next(Type type) {
  if (encoding_ == Encoding::kAscii) return ascii();
  const std::size_t size = kTypeBytes[std::size_t(type)];
  if (size > rest_.size()) refuse("data", "the file is truncated");
  std::array<char, 8> bytes{};
  const bool same =
      (std::endian::native == std::endian::little) == (encoding_ == Encoding::kLittle);
  for (std::size_t i = 0; i < size; ++i) bytes[i] = rest_[same ? i : size - 1 - i];
  rest_.remove_prefix(size);
  return value(bytes, type);
}

u64 Numbers::next_count(Type type) {
  const double number = next(type);
  if (!(number >= 0) || number > 4294967295.0 || number != std::floor(number)) {
    refuse("data", "a count or an index is not a whole number, 0 or more");
  }
  return u64(number);
}

bool Numbers::end_element() {
  if (encoding_ != Encoding::kAscii) return false;
  const std::string_view line = rest_.substr(0, rest_.find_first_of("\r\n"));
  rest_.remove_prefix(line.size());
  return !trimmed(line).empty();
}

double Numbers::ascii() {
  const std::string_view word = take_word(rest_);
  if (word.empty()) refuse("data", "the file is truncated");
  double number = 0;
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (error == std::errc() && end == word.data() + word.size()) return number;
  if (is_no_number(word)) return std::numeric_limits<double>::quiet_NaN();
  refuse("data", fmt::format("'{}' is not a number", clean_name(word, "")));
}

}  // namespace heliograph::assets::ply
