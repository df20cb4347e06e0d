// JPEG through libjpeg.
#include <csetjmp>
#include <cstddef>
#include <cstdio>
// jpeglib.h expects the two before it.
#include <jerror.h>
#include <jpeglib.h>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

/// libjpeg's error manager; plain data, since its callbacks leave by longjmp.
struct Errors {
  jpeg_error_mgr base;  // first: libjpeg hands back its address
  std::jmp_buf jump;
  char message[JMSG_LENGTH_MAX];
};

void leave(j_common_ptr jpeg) {
  auto& errors = *reinterpret_cast<Errors*>(jpeg->err);
  errors.base.format_message(jpeg, errors.message);
  std::longjmp(errors.jump, 1);
}

/// Data that ends early or does not decode is an error here, not a grey area in the picture.
void leave_on_corruption(j_common_ptr jpeg, int level) {
  if (level >= 0) return;
  const int code = jpeg->err->msg_code;
  if (code == JWRN_JPEG_EOF || code == JWRN_HIT_MARKER || code == JWRN_HUFF_BAD_CODE) leave(jpeg);
}

class Jpeg {
 public:
  Jpeg() {
    jpeg_.err = jpeg_std_error(&errors_.base);
    errors_.base.error_exit = leave;
    errors_.base.emit_message = leave_on_corruption;
    errors_.message[0] = 0;
  }
  Jpeg(const Jpeg&) = delete;
  ~Jpeg() { jpeg_destroy_decompress(&jpeg_); }

  [[nodiscard]] bool read_header(Bytes bytes) {
    if (setjmp(errors_.jump)) return false;
    jpeg_create_decompress(&jpeg_);
    jpeg_mem_src(&jpeg_, reinterpret_cast<const u8*>(bytes.data()), bytes.size());
    jpeg_read_header(&jpeg_, TRUE);
    const bool gray = jpeg_.jpeg_color_space == JCS_GRAYSCALE;
    jpeg_.out_color_space = gray ? JCS_GRAYSCALE : JCS_RGB;
    jpeg_.dct_method = JDCT_ISLOW;
    return true;
  }
  [[nodiscard]] bool read_rows(Canvas& canvas) {
    if (setjmp(errors_.jump)) return false;
    jpeg_start_decompress(&jpeg_);
    while (jpeg_.output_scanline < jpeg_.output_height) {
      JSAMPROW row = reinterpret_cast<JSAMPROW>(canvas.row(jpeg_.output_scanline));
      jpeg_read_scanlines(&jpeg_, &row, 1);
    }
    jpeg_finish_decompress(&jpeg_);
    return true;
  }

  [[nodiscard]] bool four_inks() const {
    return jpeg_.jpeg_color_space == JCS_CMYK || jpeg_.jpeg_color_space == JCS_YCCK;
  }
  [[nodiscard]] ImageData layout() const {
    return {.texels = nullptr,
            .width = jpeg_.image_width,
            .height = jpeg_.image_height,
            .channels = jpeg_.out_color_space == JCS_GRAYSCALE ? 1u : 3u,
            .type = TexelType::kU8};
  }
  [[nodiscard]] std::string message() const { return errors_.message; }

 private:
  jpeg_decompress_struct jpeg_{};
  Errors errors_{};
};

}  // namespace

Picture decode_jpeg(const PictureSource& source) {
  Jpeg jpeg;
  if (!jpeg.read_header(source.bytes)) refuse(source.where, "broken JPEG: " + jpeg.message());
  if (jpeg.four_inks()) refuse_unimplemented(source.where, "CMYK JPEG; save it as RGB");
  Canvas canvas(jpeg.layout(), source);
  if (!jpeg.read_rows(canvas)) refuse(source.where, "broken JPEG: " + jpeg.message());
  return std::move(canvas).finish(true);
}

}  // namespace heliograph::assets
