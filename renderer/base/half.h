// IEEE 754 binary16. Used where texels, volumes and planes are stored or sent as half floats.
#pragma once

#include <algorithm>
#include <bit>

#include "renderer/base/types.h"

namespace heliograph {

/// Rounded to the nearest, ties to even. What is finite stays finite, +-65504 beyond the range of
/// halves; infinities and NaN stay what they are.
inline u16 half_of_float(float x) {
  const u32 bits = std::bit_cast<u32>(x), sign = bits >> 16 & 0x8000u,
            magnitude = bits & ~(1u << 31);
  // Beside 0.5 a float's last bit is worth 2^-24, as that of a subnormal half.
  const u32 small = std::bit_cast<u32>(std::bit_cast<float>(magnitude) + 0.5f) - 0x3f000000u;
  const u32 within = std::min(magnitude, 0x477fe000u);  // 65504
  const u32 normal = (within + 0xfffu + (within >> 13 & 1u) - (112u << 23)) >> 13;
  const u32 finite = magnitude < 0x38800000u ? small : normal;
  const u32 endless = magnitude > 0x7f800000u ? 0x7e00u : 0x7c00u;
  return u16(sign | (magnitude < 0x7f800000u ? finite : endless));
}

inline float float_of_half(u16 half) {
  const u32 sign = u32(half & 0x8000u) << 16;
  const u32 exponent = (half >> 10) & 31u, fraction = half & 1023u;
  if (exponent == 0) {
    const float value = float(fraction) * 0x1p-24f;
    return sign ? -value : value;
  }
  const u32 bits =
      exponent == 31 ? 0x7f800000u | (fraction << 13) : ((exponent + 112) << 23) | (fraction << 13);
  return std::bit_cast<float>(sign | bits);
}

}  // namespace heliograph
