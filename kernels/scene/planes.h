// HELIO_PLANES: the only list of outputs, and what a probe ray knows. One row makes a plane: dtype,
// channels, unit, documentation, EXR names and wire layout derive from it.
#pragma once

#include "kernels/scene/ray.h"

namespace heliograph::kernels {

/// How a plane's value comes about.
enum class Fold : u8 {
  kMean,    // averaged over samples with the pixel filter, by path.h
  kCentre,  // one ray through the pixel's centre, by probe_pixel()
  kFilm,    // read from the accumulation
  kPost,    // computed from other planes of the frame
};

/// What one centre ray knows of the first surface it meets. World space unless a name says
/// otherwise.
struct Probe {
  bool hit;
  float distance;
  vec3 p_world;
  vec3 p_camera;          // OpenCV camera frame
  vec3 normal;            // shading normal, faces the viewer
  vec3 normal_camera;     // OpenCV camera frame
  vec3 geometric_normal;  // faces the viewer
  vec3 tangent;
  vec2 uv;
  vec2 barycentric;
  MaterialValues material;  // after textures; alpha is the opacity
  vec3 emission;            // radiance towards the viewer
  u32 instance_label;
  u32 category;
  u32 part;
  u32 material_id;
  u32 primitive;
  vec3 object_coordinates;
  vec3 nocs;
  vec2 flow_forward;
  vec2 flow_backward;
  u8 flow_forward_valid;
  u8 flow_backward_valid;
  u8 flow_forward_visible;
  u8 flow_backward_visible;
  vec3 scene_flow;
  float disparity;
  u8 disparity_visible;
};

// X(NAME, type, channels, fold, unit, expression on `const Probe& p` for kCentre, 0 otherwise)
#define HELIO_PLANES(X)                                                  \
  X(BEAUTY, float, 4, kMean, "W sr^-1 m^-2", 0)                          \
  X(ALBEDO_MEAN, float, 3, kMean, "1", 0)                                \
  X(NORMAL_MEAN, float, 3, kMean, "1", 0)                                \
  X(VARIANCE, float, 1, kFilm, "(W sr^-1 m^-2)^2", 0)                    \
  X(SAMPLES, u32, 1, kFilm, "1", 0)                                      \
  X(DEPTH, float, 1, kCentre, "m", p.hit ? p.p_camera.z : INFINITY)      \
  X(DISTANCE, float, 1, kCentre, "m", p.hit ? p.distance : INFINITY)     \
  X(POSITION, float, 3, kCentre, "m", p.p_world)                         \
  X(POSITION_CAMERA, float, 3, kCentre, "m", p.p_camera)                 \
  X(NORMAL, float, 3, kCentre, "1", p.normal)                            \
  X(NORMAL_CAMERA, float, 3, kCentre, "1", p.normal_camera)              \
  X(GEOMETRIC_NORMAL, float, 3, kCentre, "1", p.geometric_normal)        \
  X(TANGENT, float, 3, kCentre, "1", p.tangent)                          \
  X(UV, float, 2, kCentre, "1", p.uv)                                    \
  X(BARYCENTRIC, float, 2, kCentre, "1", p.barycentric)                  \
  X(BASE_COLOR, float, 3, kCentre, "1", p.material.base_color)           \
  X(ROUGHNESS, float, 1, kCentre, "1", p.material.roughness)             \
  X(METALLIC, float, 1, kCentre, "1", p.material.metallic)               \
  X(TRANSMISSION, float, 1, kCentre, "1", p.material.transmission)       \
  X(OPACITY, float, 1, kCentre, "1", p.material.alpha)                   \
  X(EMISSION, float, 3, kCentre, "W sr^-1 m^-2", p.emission)             \
  X(INSTANCE, u32, 1, kCentre, "label", p.instance_label)                \
  X(SEMANTIC, u32, 1, kCentre, "class", p.category)                      \
  X(PART, u32, 1, kCentre, "part", p.part)                               \
  X(MATERIAL, u32, 1, kCentre, "index", p.material_id)                   \
  X(PRIMITIVE, u32, 1, kCentre, "index", p.primitive)                    \
  X(OBJECT_COORDINATES, float, 3, kCentre, "1", p.object_coordinates)    \
  X(NOCS, float, 3, kCentre, "1", p.nocs)                                \
  X(FLOW_FORWARD, float, 2, kCentre, "px", p.flow_forward)               \
  X(FLOW_BACKWARD, float, 2, kCentre, "px", p.flow_backward)             \
  X(FLOW_FORWARD_VALID, u8, 1, kCentre, "1", p.flow_forward_valid)       \
  X(FLOW_BACKWARD_VALID, u8, 1, kCentre, "1", p.flow_backward_valid)     \
  X(FLOW_FORWARD_VISIBLE, u8, 1, kCentre, "1", p.flow_forward_visible)   \
  X(FLOW_BACKWARD_VISIBLE, u8, 1, kCentre, "1", p.flow_backward_visible) \
  X(SCENE_FLOW, float, 3, kCentre, "m", p.scene_flow)                    \
  X(DISPARITY, float, 1, kCentre, "px", p.disparity)                     \
  X(DISPARITY_VISIBLE, u8, 1, kCentre, "1", p.disparity_visible)         \
  X(COVERAGE, float, 1, kMean, "1", 0)                                   \
  X(DIRECT_DIFFUSE, float, 3, kMean, "W sr^-1 m^-2", 0)                  \
  X(INDIRECT_DIFFUSE, float, 3, kMean, "W sr^-1 m^-2", 0)                \
  X(DIRECT_GLOSSY, float, 3, kMean, "W sr^-1 m^-2", 0)                   \
  X(INDIRECT_GLOSSY, float, 3, kMean, "W sr^-1 m^-2", 0)                 \
  X(DIRECT_TRANSMISSION, float, 3, kMean, "W sr^-1 m^-2", 0)             \
  X(INDIRECT_TRANSMISSION, float, 3, kMean, "W sr^-1 m^-2", 0)           \
  X(DIRECT_SUBSURFACE, float, 3, kMean, "W sr^-1 m^-2", 0)               \
  X(INDIRECT_SUBSURFACE, float, 3, kMean, "W sr^-1 m^-2", 0)             \
  X(DIRECT_VOLUME, float, 3, kMean, "W sr^-1 m^-2", 0)                   \
  X(INDIRECT_VOLUME, float, 3, kMean, "W sr^-1 m^-2", 0)                 \
  X(EMISSION_LIGHT, float, 3, kMean, "W sr^-1 m^-2", 0)                  \
  X(ENVIRONMENT_LIGHT, float, 3, kMean, "W sr^-1 m^-2", 0)               \
  X(AMBIENT_OCCLUSION, float, 1, kMean, "1", 0)                          \
  X(COST, float, 1, kMean, "rays", 0)                                    \
  X(DENOISED, float, 4, kPost, "W sr^-1 m^-2", 0)                        \
  X(BEAUTY_GROUP, float, 3, kMean, "W sr^-1 m^-2", 0)                    \
  X(SHADOW_CATCHER, float, 1, kFilm, "1", 0)                             \
  X(SENSOR_RGB, float, 3, kPost, "1", 0)                                 \
  X(SENSOR_MOSAIC, float, 1, kPost, "1", 0)                              \
  X(SENSOR_DEPTH, float, 1, kPost, "m", 0)                               \
  X(BEAUTY_STILL, float, 4, kMean, "W sr^-1 m^-2", 0)

enum class Plane : u32 {
#define HELIO_PLANE(NAME, ...) NAME,
  HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
      kCount
};
inline constexpr u32 kPlanes = u32(Plane::kCount);

/// A set of planes, one bit each.
using PlaneSet = u64;
static_assert(kPlanes <= 64);
KERNEL constexpr PlaneSet plane_bit(Plane plane) { return PlaneSet(1) << u32(plane); }

/// All planes of one fold.
KERNEL constexpr PlaneSet planes_of(Fold fold) {
  PlaneSet set = 0;
#define HELIO_PLANE(NAME, type, channels, of, ...) \
  if (fold == Fold::of) set |= plane_bit(Plane::NAME);
  HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
  return set;
}

}  // namespace heliograph::kernels
