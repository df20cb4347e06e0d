// Units, colour temperature, and what shapes and cones make of them.
#include "renderer/lights/light_strength.h"

#include <cmath>

#include "renderer/derived/black_body.h"

namespace heliograph::resident {
namespace {

constexpr double kLumensPerWatt = 683;
constexpr double kSharpestCone = 1e-3;  // difference of cosines; KHR_lights_punctual

/// Area of the unit sphere under a linear map that is not similar: the mean of |cof(M) n| over 4
/// pi.
double ellipsoid_area(const mat3& m) {
  constexpr int kDirections = 4096;  // of a spherical Fibonacci lattice; errors below 1e-4
  const mat3 cofactor(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
  double sum = 0;
  for (int i = 0; i < kDirections; ++i) {
    const double z = 1 - (2 * i + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double phi = i * M_PI * (3 - std::sqrt(5.0));
    const vec3 n(r * std::cos(phi), r * std::sin(phi), z);
    sum += double(glm::length(cofactor * n));
  }
  return 4 * M_PI * sum / kDirections;
}

/// Integrals of a cone's share over directions, plain and times the cosine to the axis, 1/sr.
glm::dvec2 cone_integrals(const LightCone& cone) {
  const double from = double(cone.cosine), slope = double(cone.scale);
  const double full = std::min(1.0, from + 1 / slope), rise = full - from;
  const double third = slope * slope * std::pow(rise, 3) / 3;
  const double fourth = slope * slope * std::pow(rise, 4) / 4;
  return 2 * M_PI * glm::dvec2(third + 1 - full, fourth + from * third + (1 - full * full) / 2);
}

/// What a radiance of 1 makes of a light in its unit, in watts where that is photometric.
double unit_per_radiance(const Light& light, const LightExtent& extent) {
  switch (light.unit) {
    case LightUnit::kRadiance:
    case LightUnit::kLuminance:
      return 1;
    case LightUnit::kPower:
    case LightUnit::kLumen:
      return extent.flux;
    case LightUnit::kIntensity:
    case LightUnit::kCandela:
      return extent.intensity;
    case LightUnit::kProfileScale:
      return extent.area;
    case LightUnit::kIrradiance:
    case LightUnit::kIlluminance:
      return M_PI * std::pow(std::sin(0.5 * double(light.sun_angle)), 2);
  }
  return 1;
}

bool is_photometric(LightUnit unit) {
  return unit == LightUnit::kLuminance || unit == LightUnit::kLumen ||
         unit == LightUnit::kIlluminance || unit == LightUnit::kCandela ||
         unit == LightUnit::kProfileScale;
}

}  // namespace

std::optional<double> area_scale(const mat4x3& m) {
  const vec3 x = m[0], y = m[1], z = m[2];
  const float s = glm::dot(x, x), tolerance = 1e-4f * s;
  const bool similar = std::abs(glm::dot(y, y) - s) < tolerance &&
                       std::abs(glm::dot(z, z) - s) < tolerance &&
                       std::abs(glm::dot(x, y)) < tolerance &&
                       std::abs(glm::dot(x, z)) < tolerance && std::abs(glm::dot(y, z)) < tolerance;
  return similar ? std::optional<double>(s) : std::nullopt;
}

double part_area(const DeviceMesh& mesh, const PartTrees& trees, const mat4x3& world, u32 part) {
  if (const auto scale = area_scale(world)) return *scale * double(trees.bounds[part].power);
  double area = 0;
  const mat3 linear(world);
  const vec3* positions = mesh.middle();
  for (u32 i = trees.offsets[part]; i < trees.offsets[part + 1]; ++i) {
    const uvec3 t = mesh.topology->triangles[trees.entries[i].triangle];
    const vec3 a = positions[t.x];
    area +=
        0.5 * glm::length(glm::cross(linear * (positions[t.y] - a), linear * (positions[t.z] - a)));
  }
  return area;
}

LightCone cone_of(const Light& light) {
  if (light.outer_cone_angle == 0) return {};
  const double outer = std::cos(double(light.outer_cone_angle));
  const double inner = std::cos(double(light.inner_cone_angle));
  return {float(outer), float(1 / std::max(kSharpestCone, inner - outer))};
}

LightExtent mesh_extent(double area, bool two_sided) {
  return {.flux = M_PI * area * (two_sided ? 2 : 1), .intensity = area, .area = area};
}

/// Of the profile's intensities times an area, all of them or those to the front.
LightExtent profile_extent(const ProfileSums& profile, double area, bool all) {
  const double sum = profile.front + (all ? profile.back : 0);
  return {.flux = area * sum, .intensity = area * profile.peak, .area = area};
}

LightExtent shape_extent(const Light& light, const mat4x3& world_from_shape,
                         const ProfileSums* profile) {
  const LightCone cone = cone_of(light);
  const glm::dvec2 integrals = cone.scale > 0 ? cone_integrals(cone) : glm::dvec2(0);
  if (light.shape == LightShape::kSphere) {
    const auto similar = area_scale(world_from_shape);
    const double area = similar ? 4 * M_PI * *similar : ellipsoid_area(mat3(world_from_shape));
    // A convex body shows a quarter of its area in the mean (Cauchy).
    if (profile) return profile_extent(*profile, area / 4, true);
    return {cone.scale > 0 ? area / 4 * integrals.x : M_PI * area, area / 4, area / 4};
  }
  const double unit = light.shape == LightShape::kDisc ? M_PI : 1;
  const double area =
      unit * double(glm::length(glm::cross(world_from_shape[0], world_from_shape[1])));
  if (profile) return profile_extent(*profile, area, light.two_sided);
  if (cone.scale > 0) return {area * integrals.y, area, area};
  return mesh_extent(area, light.two_sided);
}

vec3 light_radiance(const Light& light, const LightExtent& extent) {
  double scale = double(light.intensity) * std::exp2(double(light.exposure));
  if (is_photometric(light.unit)) scale /= kLumensPerWatt;
  const double unit = unit_per_radiance(light, extent);
  scale = unit > 0 ? scale / unit : 0;
  const vec3 tint = light.temperature > 0 ? planckian_color(double(light.temperature)) : vec3(1);
  return light.color * tint * float(scale);
}

}  // namespace heliograph::resident
