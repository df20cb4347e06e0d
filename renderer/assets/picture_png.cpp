// PNG through libpng.
#include <png.h>

#include <array>
#include <bit>
#include <csetjmp>
#include <cstring>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

/// What libpng's callbacks see; plain data, since libpng leaves them by longjmp.
struct Reader {
  Bytes rest;
  std::array<char, 120> message{};
};

void read_bytes(png_structp png, png_bytep out, std::size_t count) {
  auto& reader = *static_cast<Reader*>(png_get_io_ptr(png));
  if (count > reader.rest.size()) png_error(png, "the file is truncated");
  std::memcpy(out, reader.rest.data(), count);
  reader.rest = reader.rest.subspan(count);
}

void keep_message(png_structp png, png_const_charp message) {
  auto& reader = *static_cast<Reader*>(png_get_error_ptr(png));
  std::strncpy(reader.message.data(), message, reader.message.size() - 1);
  png_longjmp(png, 1);
}

void ignore_warning(png_structp, png_const_charp) {}

class Png {
 public:
  explicit Png(Bytes bytes) : reader_{.rest = bytes} {
    png_ = png_create_read_struct(PNG_LIBPNG_VER_STRING, &reader_, keep_message, ignore_warning);
    info_ = png_ ? png_create_info_struct(png_) : nullptr;
    if (!info_) throw std::bad_alloc();
    png_set_read_fn(png_, &reader_, read_bytes);
    png_set_user_limits(png_, 0x7fffffff, 0x7fffffff);  // our own limits come before the pixels
    png_set_chunk_malloc_max(png_, 16 << 20);
  }
  Png(const Png&) = delete;
  ~Png() { png_destroy_read_struct(&png_, &info_, nullptr); }

  /// Reads the header and asks for gray, gray-alpha, RGB or RGBA of 8 or 16 bits.
  [[nodiscard]] bool read_header() {
    if (setjmp(png_jmpbuf(png_))) return false;
    png_read_info(png_, info_);
    if (png_get_color_type(png_, info_) == PNG_COLOR_TYPE_PALETTE) png_set_palette_to_rgb(png_);
    png_set_expand_gray_1_2_4_to_8(png_);
    if (png_get_valid(png_, info_, PNG_INFO_tRNS)) png_set_tRNS_to_alpha(png_);
    if (std::endian::native == std::endian::little) png_set_swap(png_);
    png_set_interlace_handling(png_);
    png_read_update_info(png_, info_);
    return true;
  }
  [[nodiscard]] bool read_rows(png_bytepp rows) {
    if (setjmp(png_jmpbuf(png_))) return false;
    png_read_image(png_, rows);
    png_read_end(png_, nullptr);
    return true;
  }

  [[nodiscard]] ImageData layout() const {
    return {.texels = nullptr,
            .width = png_get_image_width(png_, info_),
            .height = png_get_image_height(png_, info_),
            .channels = png_get_channels(png_, info_),
            .type = png_get_bit_depth(png_, info_) == 16 ? TexelType::kU16 : TexelType::kU8};
  }
  [[nodiscard]] std::string message() const { return reader_.message.data(); }

 private:
  Reader reader_;
  png_structp png_ = nullptr;
  png_infop info_ = nullptr;
};

}  // namespace

Picture decode_png(const PictureSource& source) {
  Png png(source.bytes);
  if (!png.read_header()) refuse(source.where, "broken PNG: " + png.message());
  Canvas canvas(png.layout(), source);
  std::vector<png_bytep> rows(canvas.image.height);
  for (u32 y = 0; y < rows.size(); ++y) rows[y] = reinterpret_cast<png_bytep>(canvas.row(y));
  if (!png.read_rows(rows.data())) refuse(source.where, "broken PNG: " + png.message());
  return std::move(canvas).finish(true);
}

}  // namespace heliograph::assets
