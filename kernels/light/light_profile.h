// Luminaires whose intensity differs by direction. Called by light.h and by who integrates a
// profile.
//
// A profile is a texture over directions of the light's frame: rows by the angle to -z, 0 in the
// first and pi in the last; columns by the angle about +z from +x towards +y, 0 in the first.
#pragma once

#include "kernels/geometry/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A flat light's least cosine: seen more from the side, it does not get brighter any more.
inline constexpr float kProfileCosine = 0.01f;

/// The profile in a direction of the light's frame, linearly between its angles. d: unit.
KERNEL vec3 profile_intensity(TextureView profile, vec3 d) {
  profile.nearest = false;
  profile.wrap_u = Wrap::kRepeat;
  profile.wrap_v = Wrap::kClamp;
  const float below = 2 * atan2_turns(std::sqrt(d.x * d.x + d.y * d.y), -d.z);
  const float row = (below * float(profile.height - 1) + 0.5f) / float(profile.height);
  const float column = atan2_turns(d.y, d.x) + 0.5f / float(profile.width);
  return vec3(sample_texture<true>(profile, vec2(column, 1 - row)));
}

/// Radiance of a point of a light's shape in a direction, relative to a light's that shows the same
/// area to all sides: flat shapes make up for their cosine.
///
/// out   unit, world, leaves the light
KERNEL vec3 profile_share(const SceneView& scene, u32 profile, const Surface& s, vec3 out) {
  const mat4x3& world = s.pose.world_from_object;
  const vec3 z = normalize_or(world[2], vec3(0, 0, 1));
  const vec3 x = normalize_or(world[0] - z * dot(world[0], z), vec3(1, 0, 0));
  const vec3 right = cross(z, x);
  const vec3 y = dot(right, world[1]) < 0 ? -right : right;
  const vec3 intensity =
      profile_intensity(scene.textures[profile], vec3(dot(out, x), dot(out, y), dot(out, z)));
  if (is_round(s.mesh->shape)) return intensity;
  return intensity / max2(std::fabs(dot(out, s.ng)), kProfileCosine);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
