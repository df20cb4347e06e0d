// Planck's law through the eye's matching functions.
#include "renderer/derived/black_body.h"

#include <cmath>

#include "kernels/core/math.h"

namespace heliograph::resident {
namespace {

/// Gaussian with different widths on the two sides.
double lobe(double x, double mean, double below, double above) {
  const double t = (x - mean) / (x < mean ? below : above);
  return std::exp(-0.5 * t * t);
}

/// CIE XYZ, up to a factor.
glm::dvec3 relative_xyz(double kelvin) {
  // CIE 1931 colour matching functions as sums of lobes.
  // Source: Wyman, Sloan & Shirley 2013, "Simple Analytic Approximations to the CIE XYZ Color
  // Matching Functions", JCGT 2(2), equation 4.
  glm::dvec3 xyz(0);
  for (double nm = 360; nm <= 830; nm += 5) {
    const double power = std::pow(nm * 1e-3, -5) / std::expm1(1.438776877e7 / (nm * kelvin));
    xyz.x += power * (1.056 * lobe(nm, 599.8, 37.9, 31.0) + 0.362 * lobe(nm, 442.0, 16.0, 26.7) -
                      0.065 * lobe(nm, 501.1, 20.4, 26.2));
    xyz.y += power * (0.821 * lobe(nm, 568.8, 46.9, 40.5) + 0.286 * lobe(nm, 530.9, 16.3, 31.1));
    xyz.z += power * (1.217 * lobe(nm, 437.0, 11.8, 36.0) + 0.681 * lobe(nm, 459.0, 26.0, 13.8));
  }
  return xyz;
}

BlackBodyTable make_table() {
  BlackBodyTable table;
  for (u32 i = 0; i < table.size(); ++i) {
    constexpr double kHottest = 1e6;  // for the first entry, which is of 1 / kelvin = 0
    const double kelvin = i == 0 ? kHottest : 1 / (double(i) * double(kernels::kBlackBodyStep));
    table[i] = vec4(planckian_color(kelvin), float(std::log(black_body_luminance(kelvin))));
  }
  return table;
}

}  // namespace

vec3 planckian_color(double kelvin) {
  const glm::dvec3 xyz = relative_xyz(kelvin);
  const glm::dvec3 red(3.2404542, -1.5371385, -0.4985314), green(-0.9692660, 1.8760108, 0.0415560),
      blue(0.0556434, -0.2040259, 1.0572252);
  const vec3 rgb = glm::max(
      vec3(glm::dot(red, xyz), glm::dot(green, xyz), glm::dot(blue, xyz)) / float(xyz.y), vec3(0));
  return rgb / kernels::luminance(rgb);
}

double black_body_luminance(double kelvin) {
  // 2 h c^2 in W m^2 sr^-1, with wavelengths in micrometres and steps of 5 nm.
  constexpr double kScale = 1.191042972e-16 * 1e30 * 5e-9;
  return kScale * relative_xyz(kelvin).y;
}

const BlackBodyTable& black_body_table() {
  static const BlackBodyTable table = make_table();
  return table;
}

}  // namespace heliograph::resident
