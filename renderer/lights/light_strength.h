// From a light's strength to its radiance. Called by lights.cpp.
#pragma once

#include "renderer/lights/light_profile.h"
#include "renderer/lights/part_trees.h"

namespace heliograph::resident {

/// Measures that a light's strength is spread over.
struct LightExtent {
  double flux = 0;       // W over all emitting sides, for a radiance of 1
  double intensity = 0;  // W/sr along the axis (spheres: in the mean over directions; with a
                         // profile: in its strongest direction), for the same
  double area = 0;       // m^2 that shows from there
};

/// A mesh's area in m^2, one side of it.
[[nodiscard]] LightExtent mesh_extent(double area, bool two_sided);
/// A light's shape, whose unit shape has this pose. profile: null, or the light's.
[[nodiscard]] LightExtent shape_extent(const Light& light, const mat4x3& world_from_shape,
                                       const ProfileSums* profile = nullptr);

/// Radiance of a light in each channel, before its texture, its cone and its profile; suns need no
/// extent.
[[nodiscard]] vec3 light_radiance(const Light& light, const LightExtent& extent);
/// The fall-off of a spot light, as kernels::LightView has it.
struct LightCone {
  float cosine = 0;  // where it ends
  float scale = 0;   // 0: no cone
};
[[nodiscard]] LightCone cone_of(const Light& light);

/// Area of a part of a mesh in the world, m^2.
[[nodiscard]] double part_area(const DeviceMesh& mesh, const PartTrees& trees, const mat4x3& world,
                               u32 part);

}  // namespace heliograph::resident
