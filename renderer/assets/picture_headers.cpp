#include "renderer/assets/picture_headers.h"

#include <algorithm>
#include <string_view>

#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

std::string_view take_line(std::string_view& text) {
  const std::string_view line = text.substr(0, text.find('\n'));
  text.remove_prefix(std::min(text.size(), line.size() + 1));
  return line;
}

std::optional<Chromaticities> chromaticities_of(std::string_view text) {
  Chromaticities found{};
  for (float& coordinate : found) {
    const auto number = parse_number(take_word(text));
    if (!number) return std::nullopt;
    coordinate = *number;
  }
  return found;
}

}  // namespace

RadianceHeader radiance_header(Bytes bytes) {
  RadianceHeader header;
  std::string_view text = as_text(bytes);
  for (auto line = take_line(text); !line.empty(); line = take_line(text)) {
    const std::string_view key = line.substr(0, line.find('='));
    std::string_view value = line.substr(std::min(line.size(), key.size() + 1));
    if (key == "FORMAT") header.is_xyze = value.starts_with("32-bit_rle_xyze");
    if (key == "PRIMARIES") header.primaries = chromaticities_of(value);
    if (key != "EXPOSURE") continue;
    const auto factor = parse_number(take_word(value));
    if (factor && *factor > 0) header.exposure *= *factor;
  }
  return header;
}

bool is_cut_jpeg(Bytes bytes) {
  const auto byte = [&](std::size_t i) { return u8(bytes[i]); };
  if (bytes.size() < 4 || byte(0) != 0xff || byte(1) != 0xd8 || byte(2) != 0xff) return false;
  constexpr u8 kEnd = 0xd9, kScan = 0xda;
  const std::string_view text = as_text(bytes);
  std::size_t at = 2;
  bool in_scan = false;
  while (at + 1 < bytes.size()) {
    const u8 marker = byte(at + 1);
    const bool is_marker = marker != 0 && marker != 0xff;
    const bool restart = marker >= 0xd0 && marker <= 0xd7;
    if (byte(at) != 0xff) {
      if (!in_scan) return false;  // libjpeg decides
      at = std::min(text.find('\xff', at), text.size());
      continue;
    }
    if (!is_marker || restart) {
      at += is_marker ? 2 : 1;
      continue;
    }
    if (marker == kEnd) return false;
    if (at + 3 >= bytes.size()) return true;
    in_scan = marker == kScan;
    at += 2 + (std::size_t(byte(at + 2)) << 8 | byte(at + 3));
  }
  return true;
}

std::vector<std::byte> without_last_line_end(Bytes bytes) {
  constexpr std::size_t kHeader = 34;  // with the kind of compression
  constexpr u32 kRle8 = 1, kRle4 = 2;
  if (bytes.size() < kHeader || char(bytes[0]) != 'B' || char(bytes[1]) != 'M') return {};
  const auto word = [&](std::size_t at) {
    u32 value = 0;
    for (std::size_t i = 4; i-- > 0;) value = value << 8 | u8(bytes[at + i]);
    return value;
  };
  const u32 kind = word(30);
  if (kind != kRle8 && kind != kRle4) return {};
  std::size_t line_end = 0;  // where the codes before ended a line; 0: they did not
  for (std::size_t at = word(10); at + 1 < bytes.size();) {
    const u8 count = u8(bytes[at]), code = u8(bytes[at + 1]);
    if (count == 0 && code == 1) {
      if (line_end == 0) return {};
      std::vector<std::byte> out(bytes.begin(), bytes.end());
      out.erase(out.begin() + std::ptrdiff_t(line_end), out.begin() + std::ptrdiff_t(at));
      return out;
    }
    line_end = count == 0 && code == 0 ? at : 0;
    at += 2;
    if (count == 0 && code == 2) at += 2;
    const std::size_t plain = kind == kRle8 ? code : (code + 1u) / 2;  // texels as they are
    if (count == 0 && code > 2) at += plain + plain % 2;
  }
  return {};
}

}  // namespace heliograph::assets
