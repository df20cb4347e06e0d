// The bundled studio: a dome of soft boxes; the same texels as the Python client's.
#include "wire/studio.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <vector>

#include "wire/companions.h"
#include "wire/convert.h"
#include "wire/uploads.h"

namespace heliograph::client::wire {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr int kWidth = 512;
constexpr double kEdgeDegrees = 2.5;

struct SoftBox {
  double azimuth, elevation, half_width, half_height;  // degrees
  std::array<double, 3> radiance;
};
constexpr std::array<SoftBox, 4> kBoxes{{
    {35, 48, 24, 18, {13.0, 12.4, 11.6}},  // key
    {-70, 30, 14, 26, {3.6, 3.9, 4.4}},    // fill
    {165, 35, 9, 30, {7.0, 7.2, 7.6}},     // rim
    {-140, 62, 16, 10, {5.0, 5.0, 5.0}},   // top
}};

double radians(double degrees) { return degrees * (kPi / 180); }

/// 0 outside, 1 inside, smooth over the edge's width.
double edge(double inside) {
  const double t = std::clamp(inside / kEdgeDegrees + 0.5, 0.0, 1.0);
  return t * t * (3 - 2 * t);
}

std::array<double, 3> radiance(double elevation, double azimuth) {
  const double up = std::sin(radians(elevation));
  const double room = up > 0 ? 0.42 + 0.30 * up : 0.42 - 0.26 * std::min(1.0, -3 * up);
  std::array<double, 3> out{room, room * 0.995, room * 0.985};
  for (const SoftBox& box : kBoxes) {
    double across = std::fmod(azimuth - box.azimuth + 180, 360);
    if (across < 0) across += 360;
    across = std::abs(across - 180) * std::cos(radians(elevation));
    const double shape =
        edge(box.half_width - across) * edge(box.half_height - std::abs(elevation - box.elevation));
    for (std::size_t c = 0; c < 3; ++c) out[c] += shape * box.radiance[c];
  }
  return out;
}

}  // namespace

Array studio_dome() {
  constexpr int kHeight = kWidth / 2;
  std::vector<Half> texels;
  texels.reserve(std::size_t(kWidth) * kHeight * 3);
  for (int y = 0; y < kHeight; ++y)
    for (int x = 0; x < kWidth; ++x)
      for (const double value :
           radiance(90 - (y + 0.5) * (180.0 / kHeight), 180 - (x + 0.5) * (360.0 / kWidth)))
        texels.push_back(Half::of(value));
  return {std::move(texels), {kHeight, kWidth, 3}};
}

DomeTexture dome_texture(const Image& image, Draft& draft) {
  DomeTexture out;
  put_image(image, draft, &out.message);
  const std::string stem =
      image.path.empty() ? "array" : readable(std::filesystem::path(image.path).stem().string());
  out.name = "dome/" + stem + "-" + short_hash(out.message.texels().SerializeAsString());
  if (!image.wrap_v) out.message.set_wrap_v(v1::Texture::WRAP_CLAMP);
  if (!out.message.has_encoding()) out.message.set_encoding(v1::Texture::ENCODING_LINEAR);
  return out;
}

}  // namespace heliograph::client::wire
