#include "renderer/assets/picture_texels.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <glm/matrix.hpp>
#include <limits>
#include <utility>

#include "renderer/base/half.h"

namespace heliograph::assets {
namespace {

struct Half {
  u16 bits;
};

/// Integers as they are, which no caller mixes with others.
template <class T>
double number_of(T component) {
  return double(component);
}
double number_of(Half component) { return double(float_of_half(component.bits)); }

template <class T>
void put_number(T& component, double value) {
  component = T(std::clamp(std::nearbyint(value), 0., double(std::numeric_limits<T>::max())));
}
void put_number(float& component, double value) { component = float(value); }
void put_number(Half& component, double value) { component.bits = half_of_float(float(value)); }

/// change_colors() of texels of a known layout: what is fixed here is not asked for each of them.
template <class T, u32 kChannels, class F>
void change_colors_of(Canvas& canvas, const F& f) {
  constexpr u32 kColors = kChannels < 3 ? 1 : 3;
  const std::span all(reinterpret_cast<T*>(canvas.texels.data()), canvas.texels.size() / sizeof(T));
  glm::dvec3 color(0);
  for (std::size_t at = 0; at < all.size(); at += kChannels) {
    T* const texel = &all[at];
    for (u32 c = 0; c < kColors; ++c) color[int(c)] = number_of(texel[c]);
    if (!f(color, kChannels % 2 == 0 ? number_of(texel[kChannels - 1]) : 1)) continue;
    for (u32 c = 0; c < kColors; ++c) put_number(texel[c], color[int(c)]);
  }
}
template <class T, class F>
void change_colors_of(Canvas& canvas, const F& f) {
  switch (canvas.image.channels) {
    case 1:
      return change_colors_of<T, 1>(canvas, f);
    case 2:
      return change_colors_of<T, 2>(canvas, f);
    case 3:
      return change_colors_of<T, 3>(canvas, f);
    default:
      return change_colors_of<T, 4>(canvas, f);
  }
}

/// Calls f(colors, alpha) for each texel with its color components, which it may change.
template <class F>
void change_colors(Canvas& canvas, const F& f) {
  switch (canvas.image.type) {
    case TexelType::kU8:
      return change_colors_of<u8>(canvas, f);
    case TexelType::kU16:
      return change_colors_of<u16>(canvas, f);
    case TexelType::kF16:
      return change_colors_of<Half>(canvas, f);
    case TexelType::kF32:
      return change_colors_of<float>(canvas, f);
  }
}

glm::dmat3 xyz_from(const Chromaticities& at) {
  const auto xyz = [&](std::size_t i) {
    const double x = double(at[2 * i]), y = double(at[2 * i + 1]);
    return glm::dvec3(x / y, 1, (1 - x - y) / y);
  };
  const glm::dmat3 primaries(xyz(0), xyz(1), xyz(2));
  const glm::dvec3 scale = glm::inverse(primaries) * xyz(3);
  return {primaries[0] * scale[0], primaries[1] * scale[1], primaries[2] * scale[2]};
}

}  // namespace

Canvas picked(Canvas canvas, std::span<const u32> channels, const PictureSource& source) {
  if (channels.size() == canvas.image.channels && std::ranges::is_sorted(channels)) return canvas;
  ImageData layout = canvas.image;
  layout.channels = u32(channels.size());
  Canvas result(layout, source);
  const u32 size = component_bytes(layout.type);
  const std::byte* from = canvas.texels.data();
  for (std::byte* to = result.texels.data(); to != result.texels.data() + result.texels.size();
       from += canvas.texel_size()) {
    for (const u32 channel : channels) to = std::copy_n(from + channel * size, size, to);
  }
  return result;
}

void place(const Canvas& pixels, Window at, Canvas& canvas) {
  const std::size_t texel = canvas.texel_size();
  const i64 left = std::max<i64>(at.x, 0);
  const i64 right = std::min<i64>(i64(at.x) + pixels.image.width, canvas.image.width);
  const i64 top = std::max<i64>(at.y, 0);
  const i64 bottom = std::min<i64>(i64(at.y) + pixels.image.height, canvas.image.height);
  if (left >= right) return;
  for (i64 y = top; y < bottom; ++y) {
    std::memcpy(
        canvas.row(u32(y)) + u64(left) * texel,
        pixels.texels.data() + u64(y - at.y) * pixels.row_bytes() + u64(left - at.x) * texel,
        u64(right - left) * texel);
  }
}

Canvas upright(Canvas canvas, u32 orientation, const PictureSource& source) {
  const bool transposed = orientation >= 5;
  const bool right_to_left =
      orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool bottom_to_top =
      orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  ImageData layout = canvas.image;
  if (transposed) std::swap(layout.width, layout.height);
  Canvas turned(layout, source);
  const std::size_t texel = canvas.texel_size();
  for (u32 y = 0; y < layout.height; ++y) {
    for (u32 x = 0; x < layout.width; ++x) {
      u32 from_x = transposed ? y : x, from_y = transposed ? x : y;
      if (right_to_left) from_x = canvas.image.width - 1 - from_x;
      if (bottom_to_top) from_y = canvas.image.height - 1 - from_y;
      std::memcpy(turned.row(y) + x * texel, canvas.row(from_y) + from_x * texel, texel);
    }
  }
  return turned;
}

void make_alpha_straight(Canvas& canvas) {
  const TexelType type = canvas.image.type;
  const double one = type == TexelType::kU8 ? 255 : type == TexelType::kU16 ? 65535 : 1;
  change_colors(canvas, [&](glm::dvec3& color, double alpha) {
    if (!(alpha > 0 && alpha < one)) return false;
    color *= one / alpha;
    return true;
  });
}

std::optional<glm::dmat3> rec709_from(const Chromaticities& file) {
  constexpr Chromaticities kRec709 = {0.64f, 0.33f, 0.30f, 0.60f, 0.15f, 0.06f, 0.3127f, 0.3290f};
  constexpr float kSame = 1e-3f;
  const auto same = [](float a, float b) { return std::abs(a - b) < kSame; };
  if (std::ranges::equal(file, kRec709, same)) return std::nullopt;
  const glm::dmat3 matrix = glm::inverse(xyz_from(kRec709)) * xyz_from(file);
  for (int c = 0; c < 3; ++c) {
    if (!std::isfinite(matrix[c][0] + matrix[c][1] + matrix[c][2])) return std::nullopt;
  }
  return matrix;
}

void transform_colors(Canvas& canvas, const glm::dmat3& matrix) {
  change_colors(canvas, [&](glm::dvec3& color, double) {
    color = matrix * color;
    return true;
  });
}

void scale_colors(Canvas& canvas, double factor) {
  change_colors(canvas, [&](glm::dvec3& color, double) {
    color *= factor;
    return true;
  });
}

}  // namespace heliograph::assets
