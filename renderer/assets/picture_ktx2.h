// KTX 2 files: textures as GPUs take them, plain or packed by Basis Universal. Used by picture.cpp.
// Source: Khronos, KTX File Format Specification 2.0; Khronos Data Format Specification 1.3.
#pragma once

#include <string_view>

#include "renderer/assets/picture.h"

namespace heliograph::assets {

/// By its content.
[[nodiscard]] bool is_ktx2(Bytes bytes);

/// The largest level of a two-dimensional texture. Plain texels of 8 and 16 bits, halves and
/// floats, and what Basis Universal packed: 8 bits of RGB or RGBA, or halves of RGB.
///
/// layer  one channel, by its letter; "": the colours
///
/// The data format descriptor states whether the numbers are sRGB and alpha is multiplied in;
/// KTXorientation, where the first row lies. Arrays, cube maps, volumes, and formats that only GPUs
/// read (BC, ETC2) are refused by name.
[[nodiscard]] Picture decode_ktx2(const PictureSource& source, std::string_view layer);

}  // namespace heliograph::assets
