// What OpenImageIO does not say of a file's header. Used by picture.cpp.
#pragma once

#include <optional>

#include "renderer/assets/picture_texels.h"

namespace heliograph::assets {

/// Of Radiance's .hdr: what the texels were multiplied by, and their primaries.
struct RadianceHeader {
  double exposure = 1;
  std::optional<Chromaticities> primaries;
};
[[nodiscard]] RadianceHeader radiance_header(Bytes bytes);

/// A JPEG that ends before its end marker, whose rest libjpeg fills with grey. Source: ITU-T T.81,
/// B.1.1.
[[nodiscard]] bool is_cut_jpeg(Bytes bytes);

}  // namespace heliograph::assets
