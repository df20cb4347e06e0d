// Radiance HDR (RGBE), by hand. Source: Ward 1991, "Real Pixels", Graphics Gems II; the run-length
// code of Radiance's color.c.
#include <charconv>
#include <cmath>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

/// The bytes that are left, taken in order; past the end is "truncated".
class Cursor {
 public:
  Cursor(Bytes bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  [[nodiscard]] u8 next() {
    if (at_ == bytes_.size()) refuse(where_, "broken HDR: the file is truncated");
    return u8(bytes_[at_++]);
  }
  [[nodiscard]] u8 peek(std::size_t ahead) const {
    return at_ + ahead < bytes_.size() ? u8(bytes_[at_ + ahead]) : 0;
  }
  [[nodiscard]] std::string line() {
    constexpr std::size_t kLongest = 4096;
    std::string text;
    for (u8 c = next(); c != '\n'; c = next()) {
      if (text.size() == kLongest) refuse(where_, "broken HDR: a header line is too long");
      text += char(c);
    }
    return text;
  }

 private:
  Bytes bytes_;
  const std::string& where_;
  std::size_t at_ = 0;
};

struct Header {
  u32 width = 0;
  u32 height = 0;
  float exposure = 1;  // the texels were multiplied by it
};

float positive_float(std::string_view text, const std::string& where) {
  while (text.starts_with(' ')) text.remove_prefix(1);
  float value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || !(value > 0) || !std::isfinite(value)) {
    refuse(where, "broken HDR: EXPOSURE is not a positive number");
  }
  return value;
}

u32 take_side(std::string_view& text, std::string_view axis, const std::string& where) {
  u32 value = 0;
  if (!text.starts_with(axis)) {
    refuse_unimplemented(where, "an HDR whose rows do not run from top left (-Y h +X w)");
  }
  text.remove_prefix(axis.size());
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc()) refuse(where, "broken HDR: the size is not a number");
  text.remove_prefix(std::size_t(end - text.data()));
  return value;
}

Header read_header(Cursor& cursor, const std::string& where) {
  Header header;
  bool rgbe = false;
  for (std::string line = cursor.line(); !line.empty(); line = cursor.line()) {
    if (line == "FORMAT=32-bit_rle_rgbe") rgbe = true;
    if (line == "FORMAT=32-bit_rle_xyze") refuse_unimplemented(where, "an HDR in XYZ colours");
    if (line.starts_with("EXPOSURE=")) header.exposure *= positive_float(line.substr(9), where);
  }
  if (!rgbe) refuse(where, "broken HDR: no FORMAT=32-bit_rle_rgbe line");
  const std::string size = cursor.line();
  std::string_view rest = size;
  header.height = take_side(rest, "-Y ", where);
  header.width = take_side(rest, " +X ", where);
  return header;
}

using Rgbe = std::array<u8, 4>;

/// A scanline whose four components are run-length coded one after the other.
void read_coded(Cursor& cursor, std::vector<Rgbe>& row, const std::string& where) {
  for (std::size_t component = 0; component < 4; ++component) {
    std::size_t x = 0;
    while (x < row.size()) {
      const u8 count = cursor.next();
      const bool run = count > 128;
      const std::size_t length = run ? count - 128u : count;
      if (length == 0 || length > row.size() - x) refuse(where, "broken HDR: a run leaves its row");
      u8 value = run ? cursor.next() : u8(0);
      for (std::size_t i = 0; i < length; ++i) {
        if (!run) value = cursor.next();
        row[x++][component] = value;
      }
    }
  }
}

/// A scanline of plain texels, in which (1, 1, 1, n) repeats the last one.
void read_plain(Cursor& cursor, std::vector<Rgbe>& row, const std::string& where) {
  u32 shift = 0;
  std::size_t x = 0;
  while (x < row.size()) {
    Rgbe texel;
    for (u8& component : texel) component = cursor.next();
    if (texel[0] != 1 || texel[1] != 1 || texel[2] != 1) {
      row[x++] = texel;
      shift = 0;
      continue;
    }
    const u64 length = shift < 32 ? u64(texel[3]) << shift : ~u64(0);
    if (x == 0 || length > row.size() - x) refuse(where, "broken HDR: a run leaves its row");
    for (u64 i = 0; i < length; ++i, ++x) row[x] = row[x - 1];
    shift += 8;
  }
}

void read_row(Cursor& cursor, std::vector<Rgbe>& row, const std::string& where) {
  const std::size_t width = row.size();
  const bool coded = width >= 8 && width < 32768 && cursor.peek(0) == 2 && cursor.peek(1) == 2 &&
                     cursor.peek(2) < 128;
  if (!coded) return read_plain(cursor, row, where);
  if (std::size_t(cursor.peek(2)) * 256 + cursor.peek(3) != width) {
    refuse(where, "broken HDR: a row has another width than the picture");
  }
  for (int i = 0; i < 4; ++i) (void)cursor.next();
  read_coded(cursor, row, where);
}

}  // namespace

Picture decode_hdr(const PictureSource& source) {
  Cursor cursor(source.bytes, source.where);
  const Header header = read_header(cursor, source.where);
  Canvas canvas({.texels = nullptr,
                 .width = header.width,
                 .height = header.height,
                 .channels = 3,
                 .type = TexelType::kF32},
                source);
  std::vector<Rgbe> row(header.width);
  for (u32 y = 0; y < header.height; ++y) {
    read_row(cursor, row, source.where);
    auto* out = reinterpret_cast<float*>(canvas.row(y));
    for (const Rgbe& texel : row) {
      const float scale =
          texel[3] == 0 ? 0.0f : std::ldexp(1.0f, int(texel[3]) - 136) / header.exposure;
      for (int i = 0; i < 3; ++i) *out++ = float(texel[std::size_t(i)]) * scale;
    }
  }
  return std::move(canvas).finish(false);
}

}  // namespace heliograph::assets
