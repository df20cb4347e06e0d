// TIFF through libtiff: the first picture of the file, gray or RGB with or without alpha.
#include <tiffio.h>

#include <algorithm>
#include <cstdarg>
#include <cstdio>
#include <cstring>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

struct Memory {
  Bytes bytes;
  u64 at = 0;
  std::string message;
};

tmsize_t read_bytes(thandle_t handle, void* out, tmsize_t count) {
  auto& memory = *static_cast<Memory*>(handle);
  const u64 left = memory.bytes.size() - std::min<u64>(memory.at, memory.bytes.size());
  const u64 taken = std::min(left, u64(std::max<tmsize_t>(count, 0)));
  std::memcpy(out, memory.bytes.data() + (memory.bytes.size() - left), taken);
  memory.at += taken;
  return tmsize_t(taken);
}
tmsize_t write_nothing(thandle_t, void*, tmsize_t) { return 0; }
toff_t seek(thandle_t handle, toff_t offset, int whence) {
  auto& memory = *static_cast<Memory*>(handle);
  memory.at = whence == SEEK_SET   ? offset
              : whence == SEEK_CUR ? memory.at + offset
                                   : memory.bytes.size() + offset;
  return memory.at;
}
int close_nothing(thandle_t) { return 0; }
toff_t size_of(thandle_t handle) { return static_cast<Memory*>(handle)->bytes.size(); }

int keep_message(TIFF*, void* data, const char*, const char* format, va_list arguments) {
  char text[200];
  std::vsnprintf(text, sizeof text, format, arguments);
  static_cast<Memory*>(data)->message = text;
  return 1;
}
int ignore_warning(TIFF*, void*, const char*, const char*, va_list) { return 1; }

class Tiff {
 public:
  Tiff(const PictureSource& source, Memory& memory) : source_(source), memory_(memory) {
    TIFFOpenOptions* options = TIFFOpenOptionsAlloc();
    if (!options) throw std::bad_alloc();
    TIFFOpenOptionsSetMaxSingleMemAlloc(options, tmsize_t(source.budget.limits().bytes));
    TIFFOpenOptionsSetErrorHandlerExtR(options, keep_message, &memory);
    TIFFOpenOptionsSetWarningHandlerExtR(options, ignore_warning, nullptr);
    tiff_ = TIFFClientOpenExt("picture", "rm", &memory, read_bytes, write_nothing, seek,
                              close_nothing, size_of, nullptr, nullptr, options);
    TIFFOpenOptionsFree(options);
    if (!tiff_) broken();
  }
  Tiff(const Tiff&) = delete;
  ~Tiff() {
    if (tiff_) TIFFClose(tiff_);
  }

  [[noreturn]] void broken() const {
    refuse(source_.where,
           "broken TIFF: " + (memory_.message.empty() ? "cannot be read" : memory_.message));
  }
  [[nodiscard]] u32 field(ttag_t tag, u32 fallback) const {
    u16 value = 0;
    return TIFFGetFieldDefaulted(tiff_, tag, &value) ? value : fallback;
  }
  [[nodiscard]] u32 side(ttag_t tag) const {
    u32 value = 0;
    return TIFFGetField(tiff_, tag, &value) ? value : 0;
  }
  [[nodiscard]] TIFF* get() const { return tiff_; }

 private:
  const PictureSource& source_;
  Memory& memory_;
  TIFF* tiff_ = nullptr;
};

ImageData layout_of(const Tiff& tiff, const std::string& where) {
  const u32 bits = tiff.field(TIFFTAG_BITSPERSAMPLE, 1);
  const u32 format = tiff.field(TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_UINT);
  const u32 channels = tiff.field(TIFFTAG_SAMPLESPERPIXEL, 1);
  const u32 photometric = tiff.field(TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
  ImageData layout{.texels = nullptr,
                   .width = tiff.side(TIFFTAG_IMAGEWIDTH),
                   .height = tiff.side(TIFFTAG_IMAGELENGTH),
                   .channels = channels};
  const bool integer = format == SAMPLEFORMAT_UINT || format == SAMPLEFORMAT_VOID;
  if (integer && bits == 8) {
    layout.type = TexelType::kU8;
  } else if (integer && bits == 16) {
    layout.type = TexelType::kU16;
  } else if (format == SAMPLEFORMAT_IEEEFP && bits == 16) {
    layout.type = TexelType::kF16;
  } else if (format == SAMPLEFORMAT_IEEEFP && bits == 32) {
    layout.type = TexelType::kF32;
  } else {
    refuse_unimplemented(where, fmt::format("a TIFF of {} bits in sample format {}; save it as 8 "
                                            "or 16 bit integers or 16 or 32 bit floats",
                                            bits, format));
  }
  if (channels < 1 || channels > 4) {
    refuse_unimplemented(where, fmt::format("a TIFF of {} channels", channels));
  }
  const bool color = photometric == PHOTOMETRIC_RGB && channels >= 3;
  const bool gray = photometric == PHOTOMETRIC_MINISBLACK && channels <= 2;
  if (!color && !gray) {
    refuse_unimplemented(where, fmt::format("a TIFF of photometric interpretation {}; save it as "
                                            "gray or RGB",
                                            photometric));
  }
  return layout;
}

/// A rectangle of texels as libtiff hands it out: a strip or a tile, of all channels or of one.
struct Block {
  u32 x, y, width, height, first_channel, channels;
};

void place(const std::vector<std::byte>& from, const Block& block, Canvas& canvas) {
  const std::size_t size = texel_bytes(canvas.image.type);
  const std::size_t texel = size * canvas.image.channels;
  const u32 right = std::min(block.x + block.width, canvas.image.width);
  const u32 bottom = std::min(block.y + block.height, canvas.image.height);
  for (u32 y = block.y; y < bottom; ++y) {
    const std::byte* in =
        from.data() + std::size_t(y - block.y) * block.width * block.channels * size;
    std::byte* out = canvas.row(y) + block.x * texel + block.first_channel * size;
    for (u32 x = block.x; x < right; ++x, in += block.channels * size, out += texel) {
      std::memcpy(out, in, block.channels * size);
    }
  }
}

void read_blocks(const Tiff& tiff, Canvas& canvas, const PictureSource& source) {
  TIFF* file = tiff.get();
  const bool tiled = TIFFIsTiled(file) != 0;
  const bool separate =
      tiff.field(TIFFTAG_PLANARCONFIG, PLANARCONFIG_CONTIG) != PLANARCONFIG_CONTIG;
  u32 width = canvas.image.width;
  u32 height = tiled ? tiff.side(TIFFTAG_TILELENGTH)
                     : std::max(1u, std::min(tiff.side(TIFFTAG_ROWSPERSTRIP), canvas.image.height));
  if (tiled) width = tiff.side(TIFFTAG_TILEWIDTH);
  if (width == 0 || height == 0) tiff.broken();
  const u32 channels = separate ? 1 : canvas.image.channels;
  const u64 expected = u64(width) * height * channels * texel_bytes(canvas.image.type);
  const u64 size = u64(std::max<tmsize_t>(tiled ? TIFFTileSize(file) : TIFFStripSize(file), 0));
  if (size != expected) tiff.broken();
  source.budget.take(size, 1, source.where);
  std::vector<std::byte> block(size);
  for (u32 plane = 0; plane < (separate ? canvas.image.channels : 1); ++plane) {
    for (u64 y = 0; y < canvas.image.height; y += height) {
      for (u64 x = 0; x < canvas.image.width; x += width) {
        const tmsize_t read =
            tiled ? TIFFReadTile(file, block.data(), u32(x), u32(y), 0, u16(plane))
                  : TIFFReadEncodedStrip(file, TIFFComputeStrip(file, u32(y), u16(plane)),
                                         block.data(), tmsize_t(size));
        if (read < 0) tiff.broken();
        place(block, {u32(x), u32(y), width, height, plane, channels}, canvas);
      }
    }
  }
}

}  // namespace

Picture decode_tiff(const PictureSource& source) {
  Memory memory{.bytes = source.bytes, .at = 0, .message = ""};
  const Tiff tiff(source, memory);
  Canvas canvas(layout_of(tiff, source.where), source);
  read_blocks(tiff, canvas, source);
  const bool integer = canvas.image.type == TexelType::kU8 || canvas.image.type == TexelType::kU16;
  return std::move(canvas).finish(integer);
}

}  // namespace heliograph::assets
