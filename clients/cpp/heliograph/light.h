// Lights, portals and visibility: plain values that entities carry. docs/lights.md.
#pragma once

#include <optional>

#include "heliograph/material.h"
#include "heliograph/pose.h"
#include "heliograph/ref.h"

namespace heliograph::client {

/// Light that an entity's mesh gives off, besides its material's emission; a shape about the
/// entity's origin; or, with a sun_angle, a sun. Discs, rectangles, cones and suns shine along the
/// entity's -Z.
struct Light {
  enum class Unit : int {
    kRadiance = 1,      // W sr^-1 m^-2
    kPower = 2,         // W over all emitting sides, each channel
    kLuminance = 3,     // cd m^-2
    kLumen = 4,         // lm over all emitting sides
    kIrradiance = 5,    // W m^-2 on a surface that faces the sun; suns only
    kIlluminance = 6,   // lx, the same
    kIntensity = 7,     // W/sr along the axis; shapes only
    kCandela = 8,       // cd, the same
    kProfileScale = 9,  // factor of the profile's own candela
  };
  enum class Shape : int { kMesh = 1, kSphere = 2, kDisc = 3, kRectangle = 4 };

  double intensity = 1;  // in `unit`
  Unit unit = Unit::kRadiance;
  Color color{1};
  double exposure = 0;     // stops
  double temperature = 0;  // kelvin; 0: none
  bool two_sided = false;
  std::optional<TextureUse> texture{};  // multiplies the radiance
  Shape shape = Shape::kMesh;
  std::optional<double> radius{};  // metres, of a sphere or disc; 1
  std::optional<double> width{};   // metres, of a rectangle along x; 1
  std::optional<double> height{};  // metres, along y; 1
  double inner_cone_angle = 0;     // radians, half angles about the axis: whole strength within,
  double outer_cone_angle = 0;     // none beyond; 0: no spot light
  double sun_angle = 0;            // radians, angular diameter of a sun (ours: 0.0093); 0: no sun
  std::optional<Ref> profile{};    // a texture of intensities by direction; shapes without a cone

  static Light of(double intensity, Unit unit) {
    Light out;
    out.intensity = intensity;
    out.unit = unit;
    return out;
  }
};

/// A rectangle about the entity's origin that the dome shines through along the entity's -Z axis:
/// it marks where light comes in, so that rooms are less noisy. Metres along x and y.
struct Portal {
  double width = 1;
  double height = 1;
};

/// Visibility of an entity's surface, by kind of ray.
struct Visibility {
  bool camera = true;
  bool diffuse = true;
  bool glossy = true;
  bool transmission = true;
  bool shadow = true;
  bool volume = true;
};

}  // namespace heliograph::client
