// Changes to the texels of a picture once they are read. Used by picture.cpp.
#pragma once

#include <array>
#include <glm/mat3x3.hpp>
#include <optional>

#include "renderer/assets/picture.h"

namespace heliograph::assets {

/// Place of texels in a larger or smaller canvas.
struct Window {
  i32 x = 0, y = 0;  // of its first texel
};

/// A canvas of some of the channels, in this order.
[[nodiscard]] Canvas picked(Canvas canvas, std::span<const u32> channels,
                            const PictureSource& source);

/// Copies the part of `pixels` that lies in `canvas`; the rest stays as it is.
void place(const Canvas& pixels, Window at, Canvas& canvas);

/// Turns rows and columns to where an orientation of 2 to 8 (EXIF 2.3, tag 274) has them seen.
[[nodiscard]] Canvas upright(Canvas canvas, u32 orientation, const PictureSource& source);

/// Divides colours by the alpha that they were multiplied by, the last channel; where it is 0 they
/// stay.
void make_alpha_straight(Canvas& canvas);

/// CIE xy of red, green, blue and white.
using Chromaticities = std::array<float, 8>;
/// Linear Rec.709 from a file's primaries; nothing when they are Rec.709's. Source: SMPTE RP
/// 177-1993; white is not adapted.
[[nodiscard]] std::optional<glm::dmat3> rec709_from(const Chromaticities& file);
void transform_colors(Canvas& canvas, const glm::dmat3& matrix);
void scale_colors(Canvas& canvas, double factor);

}  // namespace heliograph::assets
