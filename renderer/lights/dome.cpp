// Sampling tables of environment pictures.
#include "kernels/core/warp.h"
#include "kernels/material/texture.h"
#include "renderer/base/parallel.h"
#include "renderer/derived/materials.h"
#include "renderer/lights/lights.h"

namespace heliograph::resident {
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

// A sky of less contrast is sampled as it is: rounding must not decide.
constexpr double kLeastExcess = 0.01;

/// Share of a texel and of its two neighbours in the mean of the bilinear interpolant over it.
constexpr float kSide = 0.125f, kMiddle = 0.75f;

/// The luminance of each texel of row y, as bilinear interpolation spreads it; the sum of the row's
/// radiance.
glm::dvec3 luminances(const kernels::TextureView& view, u32 y, bool nearest, float* out) {
  const u32 w = view.width, h = view.height;
  const float side = nearest ? 0 : kSide, middle = nearest ? 1 : kMiddle;
  std::vector<vec3> above, here, below, mean(w);
  load_row(view, y ? y - 1 : 0, above);
  load_row(view, y, here);
  load_row(view, y + 1 < h ? y + 1 : y, below);
  for (u32 x = 0; x < w; ++x) mean[x] = middle * here[x] + side * (above[x] + below[x]);
  glm::dvec3 sum(0);
  for (u32 x = 0; x < w; ++x) {
    const vec3 texel =
        middle * mean[x] + side * (mean[x ? x - 1 : w - 1] + mean[x + 1 < w ? x + 1 : 0]);
    sum += glm::dvec3(texel);
    out[x] = kernels::luminance(texel);
  }
  return sum;
}

/// From luminances to their running sums, normalised; returns the sum. Only what exceeds `floor`
/// counts: the rest is found by scattered rays, which multiple importance sampling weighs
/// accordingly.
///
/// Source: Karlík et al. 2019, "MIS Compensation: Optimizing Sampling Techniques in Multiple
/// Importance Sampling", section 5.1, with the mean over the sphere as the floor.
double accumulate(std::span<float> row, double floor) {
  std::vector<double> sums(row.size());
  double sum = 0;
  for (std::size_t x = 0; x < row.size(); ++x)
    sums[x] = sum += std::max(0.0, double(row[x]) - floor);
  for (std::size_t x = 0; x < row.size(); ++x)
    row[x] = sum > 0 ? float(sums[x] / sum) : float(x + 1) / float(row.size());
  return sum;
}

/// A row of DomeView::guides.
void make_guide(const float* cdf, u32 count, kernels::u16* guide) {
  for (u32 i = 0; i < kernels::kDomeGuide; ++i)
    guide[i] = kernels::u16(kernels::choose(cdf, count, float(i) / kernels::kDomeGuide).index);
}

}  // namespace

std::shared_ptr<const DomeTables> dome_tables(const Texture& texture, DerivedCache& cache) {
  const ImageData& image = *texture.image;
  return cache.get<DomeTables>(key_of(Derived::kDome, texture), {image.texels}, [&] {
    auto tables = std::make_shared<DomeTables>();
    const kernels::TextureView view{.texels = image.texels->bytes().data(),
                                    .width = image.width,
                                    .height = image.height,
                                    .channels = u8(image.channels),
                                    .type = kernels::TexelType(image.type),
                                    .srgb = texture.srgb};
    const u32 w = image.width, h = image.height;
    tables->column_cdf.resize(std::size_t(w) * h);
    if (std::max(w, h) <= 1u << 16)
      tables->guides.resize(std::size_t(kernels::kDomeGuide) * (h + 1));
    const auto guide = [&](u32 y) {
      return tables->guides.data() + std::size_t(y) * kernels::kDomeGuide;
    };
    const auto row = [&](u32 y) { return tables->column_cdf.data() + std::size_t(y) * w; };
    const auto solid_angle = [&](u32 y) {  // of a texel
      return (std::cos(M_PI * y / h) - std::cos(M_PI * (y + 1) / h)) * 2 * M_PI / w;
    };
    std::vector<glm::dvec3> integrals(h);
    parallel_for(h, [&](u32 y) {
      integrals[y] = luminances(view, y, texture.nearest, row(y)) * solid_angle(y);
    });
    glm::dvec3 integral(0);
    for (const glm::dvec3& of_row : integrals) integral += of_row;
    const double mean = kernels::luminance(vec3(integral)) / (4 * M_PI);
    double excess = 0;  // over the mean, integrated
    for (u32 y = 0; y < h; ++y)
      for (u32 x = 0; x < w; ++x)
        excess += std::max(0.0, double(row(y)[x]) - mean) * solid_angle(y);
    const double floor = excess > kLeastExcess * 4 * M_PI * mean ? mean : 0;
    std::vector<double> rows(h);
    parallel_for(h, [&](u32 y) {
      rows[y] = accumulate({row(y), w}, floor) * solid_angle(y);
      if (!tables->guides.empty()) make_guide(row(y), w, guide(y));
    });
    double total = 0;
    for (double& sum : rows) sum = total += sum;
    tables->row_cdf.resize(h);
    for (u32 y = 0; y < h; ++y)
      tables->row_cdf[y] = total > 0 ? float(rows[y] / total) : float(y + 1) / float(h);
    if (!tables->guides.empty()) make_guide(tables->row_cdf.data(), h, guide(h));
    tables->integral = vec3(integral);
    return tables;
  });
}

}  // namespace heliograph::resident
