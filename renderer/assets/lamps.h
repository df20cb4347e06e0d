// Lights and cameras of models, in our terms. Used by glTF and by the formats of assimp.
//
// A point light is a small sphere of its candela, a spot light one with its cone, a directional
// light a sun.
#pragma once

#include <string>

#include "renderer/assets/builder.h"

namespace heliograph::assets {

inline constexpr float kSunAngle = 0.0093f;  // radians, our sun's angular diameter

/// A light in the shape of a sphere of 1 cm.
[[nodiscard]] Light small_sphere();

/// Below an entity; the light shines along -Z there.
struct Place {
  u32 entity;
  mat4x3 pose{1};
};
/// An entity of its own, which camera and shadow rays do not meet and labels leave out.
void put_light(Builder& builder, LightPatch light, const std::string& name, const Place& place);

/// A camera of 1080 lines. yfov: radians, in (0, pi); aspect: width by height.
[[nodiscard]] Camera perspective_camera(double yfov, double aspect);
/// Half of what is seen, metres.
[[nodiscard]] Camera orthographic_camera(double xmag, double ymag);

}  // namespace heliograph::assets
