// Parts of a file's header that OpenImageIO does not report. Used by picture.cpp.
#pragma once

#include <optional>
#include <vector>

#include "renderer/assets/picture_texels.h"

namespace heliograph::assets {

/// Header of Radiance's .hdr: what the texels were multiplied by, and their primaries.
struct RadianceHeader {
  double exposure = 1;
  std::optional<Chromaticities> primaries;
  bool is_xyze = false;  // of CIE's X, Y and Z
};
[[nodiscard]] RadianceHeader radiance_header(Bytes bytes);

/// A JPEG that ends before its end marker, whose rest libjpeg fills with grey. Source: ITU-T T.81,
/// B.1.1.
[[nodiscard]] bool is_cut_jpeg(Bytes bytes);

/// A run-length BMP whose last line ends before the picture does, without that end, which
/// OpenImageIO takes for a line too many; empty for all others. Source: Microsoft, "Bitmap
/// Compression".
[[nodiscard]] std::vector<std::byte> without_last_line_end(Bytes bytes);

}  // namespace heliograph::assets
