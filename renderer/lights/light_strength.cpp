// Units, colour temperature, and what shapes and cones make of them.
#include "renderer/lights/light_strength.h"

#include <cmath>

#include "kernels/geometry/shape.h"
#include "renderer/derived/black_body.h"
#include "renderer/scene/light_shapes.h"

namespace heliograph::resident {
namespace {

constexpr double kLumensPerWatt = 683;
constexpr double kSharpestCone = 1e-3;  // difference of cosines; KHR_lights_punctual

/// Integrals of a cone's share over directions, plain and times the cosine to the axis, 1/sr.
glm::dvec2 cone_integrals(const LightCone& cone) {
  const double from = double(cone.cosine), slope = double(cone.scale);
  const double full = std::min(1.0, from + 1 / slope), rise = full - from;
  const double third = slope * slope * std::pow(rise, 3) / 3;
  const double fourth = slope * slope * std::pow(rise, 4) / 4;
  return 2 * M_PI * glm::dvec2(third + 1 - full, fourth + from * third + (1 - full * full) / 2);
}

/// Strength of a light in its unit for a radiance of 1, in watts where that is photometric.
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

/// Extent of the profile's intensities times an area, all of them or those to the front.
LightExtent profile_extent(const ProfileSums& profile, double area, bool all) {
  const double sum = profile.front + (all ? profile.back : 0);
  return {.flux = area * sum, .intensity = area * profile.peak, .area = area};
}

LightExtent shape_extent(const Light& light, const mat4x3& world_from_shape,
                         const ProfileSums* profile) {
  const LightCone cone = cone_of(light);
  const glm::dvec2 integrals = cone.scale > 0 ? cone_integrals(cone) : glm::dvec2(0);
  const double area = shape_area(light.shape, world_from_shape);
  if (kernels::is_round(primitive_of(light.shape))) {
    // It shows a quarter of its area in the mean (Cauchy).
    if (profile) return profile_extent(*profile, area / 4, true);
    return {cone.scale > 0 ? area / 4 * integrals.x : M_PI * area, area / 4, area / 4};
  }
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
