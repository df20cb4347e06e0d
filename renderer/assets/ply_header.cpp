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

template <class T>
double as(const std::array<char, 8>& bytes) {
  T number;
  std::memcpy(&number, bytes.data(), sizeof number);
  return double(number);
}

struct TypeRow {
  std::string_view name, other_name;
  std::size_t size;
  double (*value)(const std::array<char, 8>&);
};
/// In the order of Type.
constexpr std::array kTypes = std::to_array<TypeRow>({{"char", "int8", 1, as<std::int8_t>},
                                                      {"uchar", "uint8", 1, as<u8>},
                                                      {"short", "int16", 2, as<std::int16_t>},
                                                      {"ushort", "uint16", 2, as<u16>},
                                                      {"int", "int32", 4, as<i32>},
                                                      {"uint", "uint32", 4, as<u32>},
                                                      {"float", "float32", 4, as<float>},
                                                      {"double", "float64", 8, as<double>}});

Type type_of(std::string_view name, const std::string& where) {
  for (std::size_t i = 0; i < kTypes.size(); ++i)
    if (name == kTypes[i].name || name == kTypes[i].other_name) return Type(i);
  refuse(where, fmt::format("'{}' is not a PLY type", clean_name(name, "")));
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
    const auto count = parse<u64>(take_word(line));
    if (!count) refuse(where, "the count is not a whole number");
    header.elements.push_back({name, *count, {}});
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
  const TypeRow& row = kTypes[std::size_t(type)];
  if (row.size > rest_.size()) refuse("data", "the file is truncated");
  std::array<char, 8> bytes{};
  const bool same =
      (std::endian::native == std::endian::little) == (encoding_ == Encoding::kLittle);
  for (std::size_t i = 0; i < row.size; ++i) bytes[i] = rest_[same ? i : row.size - 1 - i];
  rest_.remove_prefix(row.size);
  return row.value(bytes);
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
  if (const auto number = parse<double>(word)) return *number;
  if (is_no_number(word)) return std::numeric_limits<double>::quiet_NaN();
  refuse("data", fmt::format("'{}' is not a number", clean_name(word, "")));
}

}  // namespace heliograph::assets::ply
