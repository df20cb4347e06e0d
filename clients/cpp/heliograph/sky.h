// A clear sky and its sun, computed from the air; the same numbers as the Python client's. Used by
// Edits::sky.
#pragma once

#include "heliograph/array.h"
#include "heliograph/pose.h"

namespace heliograph::client {

struct Air {
  double aerosol = 1;   // haze, [0, 20]; 0: none, 1: clear air
  double albedo = 0.3;  // of the ground, which fills the lower half, [0, 1]
  int width = 512;      // of the picture, pixels: a multiple of 4, at least 8
  double height = 0;    // of the eye above the ground, metres, [0, 50000]
};

struct Sky {
  Array radiance{};        // (H, W, 3) f32, W sr^-1 m^-2, lat-long, row 0 at +Z; without the sun
  Color sun_irradiance{};  // W m^-2 on a surface that faces the sun
  Vec3 sun_direction{};    // to the sun
};

constexpr double kSunAngle = 0.0093;  // radians, angular diameter

/// Light of air without clouds. elevation, azimuth: of the sun, radians; the azimuth from +X to +Y.
/// Single scattering is integrated along each direction, all further ones are isotropic (Hillaire
/// 2020).
Sky sky(double elevation, double azimuth = 0, const Air& air = {});

}  // namespace heliograph::client
