// Sums over profiles.
#include "renderer/lights/light_profile.h"

#include <algorithm>
#include <cmath>

#include "kernels/light/light_profile.h"
#include "renderer/derived/materials.h"

namespace heliograph::resident {
namespace {

/// Integral of (value + slope * angle) sin(angle).
double integral(double value, double slope, double from, double to) {
  const auto primitive = [&](double a) {
    return slope * std::sin(a) - (value + slope * a) * std::cos(a);
  };
  return primitive(to) - primitive(from);
}

/// Over the directions within [from, to] of -z, of rows that are interpolated linearly.
double integral(const std::vector<double>& rows, double from, double to) {
  if (rows.size() == 1) return rows[0] * (std::cos(from) - std::cos(to));
  const double step = M_PI / double(rows.size() - 1);
  double sum = 0;
  for (std::size_t i = 0; i + 1 < rows.size(); ++i) {
    const double low = double(i) * step, slope = (rows[i + 1] - rows[i]) / step;
    const double a = std::max(low, from), b = std::min(low + step, to);
    if (a < b) sum += integral(rows[i] - slope * low, slope, a, b);
  }
  return sum;
}

}  // namespace

std::shared_ptr<const ProfileSums> profile_sums(const Texture& texture, DerivedCache& cache) {
  return cache.get<ProfileSums>(key_of(Derived::kProfile, texture), {texture.image->texels}, [&] {
    const kernels::TextureView view = view_of(texture);
    auto sums = std::make_shared<ProfileSums>();
    std::vector<double> rows(view.height);  // sums over the columns, which are even
    for (u32 y = 0; y < view.height; ++y) {
      for (u32 x = 0; x < view.width; ++x) {
        const vec4 texel = kernels::as_radiance(kernels::load_rgba(view, u64(y) * view.width + x));
        const double value = double(kernels::luminance(vec3(texel)));
        sums->peak = std::max(sums->peak, value);
        rows[y] += value * 2 * M_PI / view.width;
      }
    }
    sums->front = integral(rows, 0, M_PI / 2);
    sums->back = integral(rows, M_PI / 2, M_PI);
    return sums;
  });
}

}  // namespace heliograph::resident
