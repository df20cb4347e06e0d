// Box-filtered levels, encoded like their source.
#include "renderer/derived/mips.h"

#include <cmath>
#include <cstring>

#include "kernels/material/texture.h"
#include "renderer/base/half.h"
#include "renderer/base/parallel.h"
#include "renderer/derived/materials.h"

namespace heliograph::resident {
namespace {

using kernels::TexelType;
using kernels::TextureView;

/// The source texels that one texel of the next level covers along an axis, and their weights.
struct Span {
  u32 first, count;  // 2, or 3 where the source is odd
  float weights[3];
};

Span span_of(u32 index, u32 size, u32 source) {
  const double scale = double(source) / size;
  const double begin = index * scale, end = begin + scale;
  Span span{u32(begin), 0, {}};
  for (u32 i = span.first; i < source && i < end - 1e-9 && span.count < 3; ++i)
    span.weights[span.count++] =
        float((std::min(end, i + 1.0) - std::max(begin, double(i))) / scale);
  return span;
}

float linear_to_srgb(float x) {
  return x <= 0.0031308f ? 12.92f * x : 1.055f * std::pow(x, 1 / 2.4f) - 0.055f;
}

/// Writes a channel of a texel.
void store(const TextureView& to, u64 i, float value, bool srgb) {
  auto* bytes = static_cast<std::byte*>(const_cast<void*>(to.texels));
  if (srgb) value = linear_to_srgb(std::max(value, 0.0f));
  const auto put = [&](auto x) { std::memcpy(bytes + i * sizeof x, &x, sizeof x); };
  const auto integer = [&](float most) { return std::lrint(kernels::clamp01(value) * most); };
  switch (to.type) {
    case TexelType::kU8:
      return put(u8(integer(255)));
    case TexelType::kU16:
      return put(u16(integer(65535)));
    case TexelType::kF16:
      return put(half_of_float(value));
    case TexelType::kF32:
      return put(value);
  }
}

/// One row of a level from the level before.
void shrink_row(const TextureView& from, const TextureView& to, u32 y) {
  const Span rows = span_of(y, to.height, from.height);
  const bool has_alpha = to.channels == 2 || to.channels == 4;
  for (u32 x = 0; x < to.width; ++x) {
    const Span columns = span_of(x, to.width, from.width);
    vec4 sum(0);
    for (u32 j = 0; j < rows.count; ++j)
      for (u32 i = 0; i < columns.count; ++i)
        sum += kernels::load_rgba(from, u64(rows.first + j) * from.width + columns.first + i) *
               (rows.weights[j] * columns.weights[i]);
    const u64 at = (u64(y) * to.width + x) * to.channels;
    for (u32 c = 0; c < to.channels; ++c) {
      const bool alpha = has_alpha && c + 1u == to.channels;
      store(to, at + c, alpha ? sum.w : sum[int(c)], to.srgb && !alpha);
    }
  }
}

std::shared_ptr<Mips> make_mips(TextureView from) {
  auto mips = std::make_shared<Mips>();
  mips->texels.resize(kernels::mip_bytes(from));
  std::byte* next = mips->texels.data();
  while (kernels::has_coarser(from)) {
    TextureView to = from;
    to.width = kernels::half_size(from.width);
    to.height = kernels::half_size(from.height);
    to.texels = next;
    parallel_for(to.height, [&](u32 y) { shrink_row(from, to, y); });
    next += kernels::texture_bytes(to);
    from = to;
  }
  return mips;
}

}  // namespace

std::shared_ptr<const Mips> mips_of(const Texture& texture, const TextureView& view,
                                    DerivedCache& cache) {
  if (texture.nearest || !kernels::has_coarser(view)) return nullptr;
  return cache.get<Mips>(key_of(Derived::kMips, texture), {texture.image->texels},
                         [&] { return make_mips(view); });
}

bool needs_mips(const Texture& texture, const DerivedCache& cache) {
  return !texture.nearest && kernels::has_coarser(view_of(texture)) &&
         !cache.contains(key_of(Derived::kMips, texture));
}

}  // namespace heliograph::resident
