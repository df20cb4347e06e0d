// Texture lookup in software: the same bits on every device. Called by material.h and light.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/core/srgb_table.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL u32 half_size(u32 size) { return size > 1 ? size / 2 : 1; }
KERNEL bool has_coarser(const TextureView& texture) {
  return texture.width > 1 && texture.height > 1;
}

KERNEL u32 texel_stride(const TextureView& texture) {
  const u32 size = texture.type == TexelType::kU8 ? 1 : texture.type == TexelType::kF32 ? 4 : 2;
  return texture.channels * size;
}
KERNEL u64 texture_bytes(const TextureView& texture) {
  return u64(texture.width) * texture.height * texel_stride(texture);
}

/// The level of a texture whose texels are at least half as wide as a footprint, if there is one:
/// never blurred more than the footprint.
///
/// width   of the footprint, in texels of the texture itself
KERNEL TextureView level_of(const TextureView& texture, float width) {
  TextureView level = texture;
  if (!texture.mips || width < 2) return level;
  level.texels = texture.mips;
  for (;;) {
    level.width = half_size(level.width);
    level.height = half_size(level.height);
    width *= 0.5f;
    if (width < 2 || !has_coarser(level)) return level;
    level.texels = static_cast<const u8*>(level.texels) + texture_bytes(level);
  }
}

/// Bytes of all levels but the first.
KERNEL u64 mip_bytes(TextureView texture) {
  u64 bytes = 0;
  while (has_coarser(texture)) {
    texture.width = half_size(texture.width);
    texture.height = half_size(texture.height);
    bytes += texture_bytes(texture);
  }
  return bytes;
}

/// IEC 61966-2-1, for texels of more than 8 bits.
HELIO_GPU_NOINLINE KERNEL float srgb_to_linear(float x) {
  return x <= 0.04045f ? x * (1 / 12.92f) : std::pow((x + 0.055f) * (1 / 1.055f), 2.4f);
}

/// IEEE 754 binary16; subnormals, infinities and NaN included.
KERNEL float half_to_float(u16 h) {
  const u32 sign = u32(h & 0x8000u) << 16;
  const u32 rest = u32(h & 0x7fffu) << 13;
  // Scaling by 2^112 moves the exponent's bias and makes subnormals right at once.
  float value = glm::uintBitsToFloat(rest) * 0x1p112f;
  if (rest >= 0x7c00u << 13) value = glm::uintBitsToFloat(rest | 0x7f800000u);
  return glm::uintBitsToFloat(glm::floatBitsToUint(value) | sign);
}

template <TexelType T>
KERNEL float load_texel(const void* texels, u64 i, bool srgb) {
  if constexpr (T == TexelType::kU8) {
    const u8 x = static_cast<const u8*>(texels)[i];
    return srgb ? kSrgbToLinear[x] : float(x) * (1 / 255.0f);
  } else if constexpr (T == TexelType::kU16) {
    const float x = float(static_cast<const u16*>(texels)[i]) * (1 / 65535.0f);
    return srgb ? srgb_to_linear(x) : x;
  } else if constexpr (T == TexelType::kF16) {
    const float x = half_to_float(static_cast<const u16*>(texels)[i]);
    return srgb ? srgb_to_linear(x) : x;
  } else {
    const float x = static_cast<const float*>(texels)[i];
    return srgb ? srgb_to_linear(x) : x;
  }
}

/// One texel as RGBA: grey fills RGB, a missing alpha is 1.
template <TexelType T, u32 kChannels>
KERNEL vec4 load_rgba(const TextureView& texture, u64 i) {
  const void* t = texture.texels;
  const u64 at = i * kChannels;
  const bool srgb = texture.srgb;
  if constexpr (kChannels < 3) {
    const float alpha = kChannels == 2 ? load_texel<T>(t, at + 1, false) : 1;
    return vec4(vec3(load_texel<T>(t, at, srgb)), alpha);
  } else {
    const float alpha = kChannels == 4 ? load_texel<T>(t, at + 3, false) : 1;
    return vec4(load_texel<T>(t, at, srgb), load_texel<T>(t, at + 1, srgb),
                load_texel<T>(t, at + 2, srgb), alpha);
  }
}

/// Calls f with the type and the number of channels of a texture's texels as template arguments.
template <class F>
KERNEL vec4 with_format(const TextureView& texture, const F& f) {
  const auto with_channels = [&]<TexelType T>() {
    switch (texture.channels) {
      case 1:
        return f.template operator()<T, 1>();
      case 2:
        return f.template operator()<T, 2>();
      case 3:
        return f.template operator()<T, 3>();
      default:
        return f.template operator()<T, 4>();
    }
  };
  switch (texture.type) {
    case TexelType::kU8:
      return with_channels.template operator()<TexelType::kU8>();
    case TexelType::kU16:
      return with_channels.template operator()<TexelType::kU16>();
    case TexelType::kF16:
      return with_channels.template operator()<TexelType::kF16>();
    case TexelType::kF32:
      break;
  }
  return with_channels.template operator()<TexelType::kF32>();
}

KERNEL vec4 load_rgba(const TextureView& texture, u64 i) {
  return with_format(
      texture, [&]<TexelType T, u32 kChannels>() { return load_rgba<T, kChannels>(texture, i); });
}

/// The coordinate within one period, in [0, 1], even of what is no number.
KERNEL float wrap_coordinate(float x, Wrap wrap) {
  if (wrap == Wrap::kClamp) return clamp01(x);
  if (wrap == Wrap::kRepeat) return max2(x - std::floor(x), 0.0f);
  const float y = x - 2 * std::floor(0.5f * x);
  return max2(y > 1 ? 2 - y : y, 0.0f);
}

/// Two neighbouring texels along one axis and the second one's weight.
struct Taps {
  u32 first, second;
  float weight;
};
KERNEL Taps make_taps(float x, u32 size, Wrap wrap) {
  const float place = wrap_coordinate(x, wrap) * float(size) - 0.5f;
  const float floor = std::floor(place);
  const i32 last = i32(size) - 1;
  const i32 first = i32(floor);
  const i32 second = first + 1;
  const bool repeat = wrap == Wrap::kRepeat;
  return {u32(first < 0 ? (repeat ? last : 0) : min2(first, last)),
          u32(second > last ? (repeat ? 0 : last) : second), place - floor};
}
KERNEL u32 nearest_tap(float x, u32 size, Wrap wrap) {
  return min2(u32(wrap_coordinate(x, wrap) * float(size)), size - 1);
}

/// Values that cannot be light count as darkness: negative ones and NaN.
KERNEL vec4 as_radiance(vec4 v) {
  return vec4(v.x > 0 ? v.x : 0, v.y > 0 ? v.y : 0, v.z > 0 ? v.z : 0, v.w);
}

/// Four neighbouring texels, mixed.
template <TexelType T, u32 kChannels, bool kRadiance>
HELIO_ALWAYS_INLINE KERNEL vec4 bilinear(const TextureView& texture, Taps x, Taps y) {
  const u64 top_row = u64(y.first) * texture.width;
  const u64 bottom_row = u64(y.second) * texture.width;
  vec4 a = load_rgba<T, kChannels>(texture, top_row + x.first);
  vec4 b = load_rgba<T, kChannels>(texture, top_row + x.second);
  vec4 c = load_rgba<T, kChannels>(texture, bottom_row + x.first);
  vec4 d = load_rgba<T, kChannels>(texture, bottom_row + x.second);
  if constexpr (kRadiance) {
    a = as_radiance(a), b = as_radiance(b), c = as_radiance(c), d = as_radiance(d);
  }
  const vec4 top = a + (b - a) * x.weight;
  const vec4 bottom = c + (d - c) * x.weight;
  return top + (bottom - top) * y.weight;
}

/// Asks for the texels about a place, row 0 at v = 0.
HELIO_ALWAYS_INLINE KERNEL void prefetch_texel(const TextureView& texture, vec2 uv) {
  const u32 x = min2(u32(max2(uv.x * float(texture.width) - 0.5f, 0.0f)), texture.width - 1);
  const u32 y = min2(u32(max2(uv.y * float(texture.height) - 0.5f, 0.0f)), texture.height - 1);
  const u64 size = texel_stride(texture), row = texture.width * size;
  const u8* at = static_cast<const u8*>(texture.texels) + y * row + x * size;
  prefetch(at);
  prefetch(at + (y + 1 < texture.height ? row : 0));
}

/// Bilinear lookup (or the nearest texel). uv: v = 0 is the bottom row.
template <bool kRadiance = false>
HELIO_GPU_NOINLINE KERNEL vec4 sample_texture(const TextureView& texture, vec2 uv) {
  if (texture.nearest) {
    const u32 x = nearest_tap(uv.x, texture.width, texture.wrap_u);
    const u32 y = nearest_tap(1 - uv.y, texture.height, texture.wrap_v);
    const vec4 texel = load_rgba(texture, u64(y) * texture.width + x);
    return kRadiance ? as_radiance(texel) : texel;
  }
  const Taps x = make_taps(uv.x, texture.width, texture.wrap_u);
  const Taps y = make_taps(1 - uv.y, texture.height, texture.wrap_v);
  return with_format(texture, [&]<TexelType T, u32 kChannels>() {
    return bilinear<T, kChannels, kRadiance>(texture, x, y);
  });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
