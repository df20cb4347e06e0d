// HELIO_PLANES: the only list of outputs, and the parts that they are read from. One row makes a
// plane: dtype, channels, unit, documentation, EXR names, wire layout and what a job must trace
// derive from it.
#pragma once

#include <type_traits>

#include "kernels/scene/ray.h"

namespace heliograph::kernels {

/// Ways in which a plane's value comes about.
enum class Fold : u8 {
  kMean,    // averaged over samples with the pixel filter, by path.h
  kCentre,  // one ray through the pixel's centre, by probe_pixel()
  kFilm,    // read from the accumulation
  kPost,    // computed from other planes of the frame
};

// Parts of a probe: values at the first surface that the ray through a pixel's centre meets. Each
// part is found out by itself, where a plane wants it. World space unless a name states another.
struct ProbeHit {
  bool hit;
  float distance;
  vec3 p_world;
  vec3 p_camera;          // OpenCV camera frame
  vec3 geometric_normal;  // faces the viewer
  vec2 barycentric;
  u32 instance_label;
  u32 category;
  u32 part;
  u32 material_id;
  u32 primitive;
};
struct ProbeShading {
  vec3 normal;         // shading normal, faces the viewer
  vec3 normal_camera;  // OpenCV camera frame
  vec3 tangent;
};
struct ProbeUv {
  vec2 uv;
};
struct ProbeMaterial {
  MaterialValues material;  // after textures, but for alpha
  vec3 emission;            // radiance towards the viewer
};
struct ProbeOpacity {
  float opacity;
};
struct ProbeRest {
  vec3 object_coordinates;
  vec3 nocs;
};
struct ProbeForward {
  vec2 flow_forward;
  u8 flow_forward_valid;
  u8 flow_forward_visible;
  vec3 scene_flow;
};
struct ProbeBackward {
  vec2 flow_backward;
  u8 flow_backward_valid;
  u8 flow_backward_visible;
};
struct ProbeStereo {
  float disparity;
  u8 disparity_visible;
};
struct Probe : ProbeHit,
               ProbeShading,
               ProbeUv,
               ProbeMaterial,
               ProbeOpacity,
               ProbeRest,
               ProbeForward,
               ProbeBackward,
               ProbeStereo {};

// Parts of a sample of a pixel: those of every program, and those that plain ones do not make
// (platform.h, kRich).
struct SamplePlain {
  vec3 radiance{0};
  float alpha = 0;
  bool hit = false;  // the camera ray met something
  vec2 caught{0};    // light on a shadow catcher, with and without other entities
  u32 rays = 0;
  vec3 albedo{0};  // guides
  vec3 normal{0};
};
inline constexpr u32 kLightPlanes = 12;
struct alignas(16) SampleRich {
  vec3 light[kLightPlanes];  // in the order of the planes
  vec3 diffuse_color;
  float open;  // of the hemisphere
};

// Sources of planes that no sample or probe has a value for.
struct SampleCount {};
struct SquareSum {};
struct CatcherSums {};
struct GroupSums {};
struct StillFilm {};
/// Source of a post plane: the planes that it is computed from.
template <auto... Planes>
struct Inputs {};
/// The value of a plane that has none of its own in its part.
struct Elsewhere {};

// X(NAME, type, channels, fold, unit, part, value). part: the one type above that the plane is read
// from; whoever fills a film looks up which parts are wanted. value: of `from`, which is that part.
#define HELIO_PLANES(X)                                                                    \
  X(BEAUTY, float, 4, kMean, "W sr^-1 m^-2", SamplePlain, vec4(from.radiance, from.alpha)) \
  X(ALBEDO_MEAN, float, 3, kMean, "1", SamplePlain, from.albedo)                           \
  X(NORMAL_MEAN, float, 3, kMean, "1", SamplePlain, from.normal)                           \
  X(VARIANCE, float, 1, kFilm, "(W sr^-1 m^-2)^2", SquareSum, Elsewhere{})                 \
  X(SAMPLES, u32, 1, kFilm, "1", SampleCount, Elsewhere{})                                 \
  X(DEPTH, float, 1, kCentre, "m", ProbeHit, from.hit ? from.p_camera.z : INFINITY)        \
  X(DISTANCE, float, 1, kCentre, "m", ProbeHit, from.hit ? from.distance : INFINITY)       \
  X(POSITION, float, 3, kCentre, "m", ProbeHit, from.p_world)                              \
  X(POSITION_CAMERA, float, 3, kCentre, "m", ProbeHit, from.p_camera)                      \
  X(NORMAL, float, 3, kCentre, "1", ProbeShading, from.normal)                             \
  X(NORMAL_CAMERA, float, 3, kCentre, "1", ProbeShading, from.normal_camera)               \
  X(GEOMETRIC_NORMAL, float, 3, kCentre, "1", ProbeHit, from.geometric_normal)             \
  X(TANGENT, float, 3, kCentre, "1", ProbeShading, from.tangent)                           \
  X(UV, float, 2, kCentre, "1", ProbeUv, from.uv)                                          \
  X(BARYCENTRIC, float, 2, kCentre, "1", ProbeHit, from.barycentric)                       \
  X(BASE_COLOR, float, 3, kCentre, "1", ProbeMaterial, from.material.base_color)           \
  X(ROUGHNESS, float, 1, kCentre, "1", ProbeMaterial, from.material.roughness)             \
  X(METALLIC, float, 1, kCentre, "1", ProbeMaterial, from.material.metallic)               \
  X(TRANSMISSION, float, 1, kCentre, "1", ProbeMaterial, from.material.transmission)       \
  X(OPACITY, float, 1, kCentre, "1", ProbeOpacity, from.opacity)                           \
  X(EMISSION, float, 3, kCentre, "W sr^-1 m^-2", ProbeMaterial, from.emission)             \
  X(INSTANCE, u32, 1, kCentre, "label", ProbeHit, from.instance_label)                     \
  X(SEMANTIC, u32, 1, kCentre, "class", ProbeHit, from.category)                           \
  X(PART, u32, 1, kCentre, "part", ProbeHit, from.part)                                    \
  X(MATERIAL, u32, 1, kCentre, "index", ProbeHit, from.material_id)                        \
  X(PRIMITIVE, u32, 1, kCentre, "index", ProbeHit, from.primitive)                         \
  X(OBJECT_COORDINATES, float, 3, kCentre, "1", ProbeRest, from.object_coordinates)        \
  X(NOCS, float, 3, kCentre, "1", ProbeRest, from.nocs)                                    \
  X(FLOW_FORWARD, float, 2, kCentre, "px", ProbeForward, from.flow_forward)                \
  X(FLOW_BACKWARD, float, 2, kCentre, "px", ProbeBackward, from.flow_backward)             \
  X(FLOW_FORWARD_VALID, u8, 1, kCentre, "1", ProbeForward, from.flow_forward_valid)        \
  X(FLOW_BACKWARD_VALID, u8, 1, kCentre, "1", ProbeBackward, from.flow_backward_valid)     \
  X(FLOW_FORWARD_VISIBLE, u8, 1, kCentre, "1", ProbeForward, from.flow_forward_visible)    \
  X(FLOW_BACKWARD_VISIBLE, u8, 1, kCentre, "1", ProbeBackward, from.flow_backward_visible) \
  X(SCENE_FLOW, float, 3, kCentre, "m", ProbeForward, from.scene_flow)                     \
  X(DISPARITY, float, 1, kCentre, "px", ProbeStereo, from.disparity)                       \
  X(DISPARITY_VISIBLE, u8, 1, kCentre, "1", ProbeStereo, from.disparity_visible)           \
  X(COVERAGE, float, 1, kMean, "1", SamplePlain, from.hit)                                 \
  X(DIRECT_DIFFUSE, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[0])            \
  X(INDIRECT_DIFFUSE, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[1])          \
  X(DIRECT_GLOSSY, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[2])             \
  X(INDIRECT_GLOSSY, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[3])           \
  X(DIRECT_TRANSMISSION, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[4])       \
  X(INDIRECT_TRANSMISSION, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[5])     \
  X(DIRECT_SUBSURFACE, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[6])         \
  X(INDIRECT_SUBSURFACE, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[7])       \
  X(DIRECT_VOLUME, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[8])             \
  X(INDIRECT_VOLUME, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[9])           \
  X(EMISSION_LIGHT, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[10])           \
  X(ENVIRONMENT_LIGHT, float, 3, kMean, "W sr^-1 m^-2", SampleRich, from.light[11])        \
  X(AMBIENT_OCCLUSION, float, 1, kMean, "1", SampleRich, from.open)                        \
  X(COST, float, 1, kMean, "rays", SamplePlain, from.rays)                                 \
  X(DENOISED, float, 4, kPost, "W sr^-1 m^-2", DenoiserInputs, Elsewhere{})                \
  X(BEAUTY_GROUP, float, 3, kMean, "W sr^-1 m^-2", GroupSums, Elsewhere{})                 \
  X(SHADOW_CATCHER, float, 1, kFilm, "1", CatcherSums, Elsewhere{})                        \
  X(SENSOR_RGB, float, 3, kPost, "1", RgbSensorInputs, Elsewhere{})                        \
  X(SENSOR_MOSAIC, float, 1, kPost, "1", RgbSensorInputs, Elsewhere{})                     \
  X(SENSOR_DEPTH, float, 1, kPost, "m", DepthSensorInputs, Elsewhere{})                    \
  X(IOR, float, 1, kCentre, "1", ProbeMaterial, from.material.ior)                         \
  X(DIFFUSE_COLOR, float, 3, kMean, "1", SampleRich, from.diffuse_color)                   \
  X(BEAUTY_STILL, float, 4, kMean, "W sr^-1 m^-2", StillFilm, Elsewhere{})

enum class Plane : u32 {
#define HELIO_PLANE(NAME, ...) NAME,
  HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
      kCount
};
inline constexpr u32 kPlanes = u32(Plane::kCount);

using DenoiserInputs = Inputs<Plane::BEAUTY, Plane::ALBEDO_MEAN, Plane::NORMAL_MEAN>;
using RgbSensorInputs = Inputs<Plane::BEAUTY>;
using DepthSensorInputs =
    Inputs<Plane::DEPTH, Plane::DISTANCE, Plane::NORMAL_CAMERA, Plane::BASE_COLOR, Plane::ROUGHNESS,
           Plane::METALLIC, Plane::TRANSMISSION>;

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

/// All planes that are read from one part.
template <class Part>
KERNEL constexpr PlaneSet planes_from() {
  PlaneSet set = 0;
#define HELIO_PLANE(NAME, type, channels, fold, unit, part, ...) \
  if (std::is_same_v<Part, part>) set |= plane_bit(Plane::NAME);
  HELIO_PLANES(HELIO_PLANE)
#undef HELIO_PLANE
  return set;
}

/// Planes that a plane with this part is computed from.
template <class Part>
inline constexpr PlaneSet kInputs = 0;
template <auto... Planes>
inline constexpr PlaneSet kInputs<Inputs<Planes...>> = (plane_bit(Planes) | ...);

}  // namespace heliograph::kernels
