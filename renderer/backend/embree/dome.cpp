// Sampling tables of environment pictures.
#include <tbb/parallel_for.h>

#include "kernels/texture.h"
#include "kernels/warp.h"
#include "renderer/backend/embree/lights.h"

namespace heliograph::embree {
namespace {

constexpr float kBrightest = 1e9f;  // an infinite texel must not swallow the whole density

/// One row of the picture, decoded; what cannot be light is 0.
void load_row(const kernels::TextureView& view, u32 y, std::vector<vec3>& out) {
  out.resize(view.width);
  for (u32 x = 0; x < view.width; ++x) {
    const vec4 texel = kernels::as_radiance(kernels::load_rgba(view, u64(y) * view.width + x));
    out[x] = glm::min(vec3(texel), vec3(kBrightest));
  }
}

float luminance(vec3 c) { return glm::dot(c, vec3(0.2126f, 0.7152f, 0.0722f)); }

/// Share of a texel and of its two neighbours in the mean of the bilinear interpolant over it.
constexpr float kSide = 0.125f, kMiddle = 0.75f;

/// A row of DomeView::column_guide.
void guide_row(const float* cdf, u32 width, kernels::u16* guide) {
  for (u32 i = 0; i < kernels::kDomeGuide; ++i)
    guide[i] = kernels::u16(kernels::choose(cdf, width, float(i) / kernels::kDomeGuide).index);
}

}  // namespace

std::shared_ptr<const DomeTables> dome_tables(const Texture& texture, DerivedCache& cache) {
  const ImageData& image = *texture.image;
  const DerivedKey key{Derived::kDome, {image.texels->serial(), texture.srgb, texture.nearest}};
  return cache.get<DomeTables>(key, {image.texels}, [&] {
    auto tables = std::make_shared<DomeTables>();
    const kernels::TextureView view{.texels = image.texels->bytes().data(),
                                    .width = image.width,
                                    .height = image.height,
                                    .channels = u8(image.channels),
                                    .type = kernels::TexelType(image.type),
                                    .srgb = texture.srgb};
    const u32 w = image.width, h = image.height;
    const float side = texture.nearest ? 0 : kSide, middle = texture.nearest ? 1 : kMiddle;
    tables->column_cdf.resize(std::size_t(w) * h);
    if (w <= 1u << 16) tables->column_guide.resize(std::size_t(kernels::kDomeGuide) * h);
    std::vector<double> rows(h);
    std::vector<glm::dvec3> integrals(h);
    tbb::parallel_for(0u, h, [&](u32 y) {
      std::vector<vec3> above, here, below, mean(w);
      load_row(view, y ? y - 1 : 0, above);
      load_row(view, y, here);
      load_row(view, y + 1 < h ? y + 1 : y, below);
      for (u32 x = 0; x < w; ++x) mean[x] = middle * here[x] + side * (above[x] + below[x]);
      float* cdf = tables->column_cdf.data() + std::size_t(y) * w;
      const double solid_angle =
          (std::cos(M_PI * y / h) - std::cos(M_PI * (y + 1) / h)) * 2 * M_PI / w;
      std::vector<double> sums(w);
      double sum = 0;
      for (u32 x = 0; x < w; ++x) {
        const vec3 texel =
            middle * mean[x] + side * (mean[x ? x - 1 : w - 1] + mean[x + 1 < w ? x + 1 : 0]);
        integrals[y] += glm::dvec3(texel) * solid_angle;
        sums[x] = sum += luminance(texel);
      }
      for (u32 x = 0; x < w; ++x) cdf[x] = sum > 0 ? float(sums[x] / sum) : float(x + 1) / float(w);
      if (!tables->column_guide.empty())
        guide_row(cdf, w, tables->column_guide.data() + std::size_t(y) * kernels::kDomeGuide);
      rows[y] = sum * solid_angle;
    });
    double total = 0;
    glm::dvec3 integral(0);
    for (u32 y = 0; y < h; ++y) {
      rows[y] = total += rows[y];
      integral += integrals[y];
    }
    tables->row_cdf.resize(h);
    for (u32 y = 0; y < h; ++y)
      tables->row_cdf[y] = total > 0 ? float(rows[y] / total) : float(y + 1) / float(h);
    tables->integral = vec3(integral);
    return tables;
  });
}

}  // namespace heliograph::embree
