#include "renderer/lights/casters.h"

#include <algorithm>
#include <numeric>
#include <utility>

#include "kernels/scene/ray.h"

namespace heliograph::resident {
namespace {

constexpr float kProbability = 0.2f;  // measured on W1
constexpr float kSpread = 0.5f;       // of an image, in slopes alpha; wider is no better (W1)
constexpr float kDistant = 1e5f;      // radii of the scene that a sun is away
constexpr u32 kMostWeighed = 64;      // lights that each mirror is weighed against

float mirror_share(const kernels::MaterialValues& material) {
  return material.metallic > 0.5f ? 1.0f : 0.25f;  // glass reflects less
}

std::vector<kernels::CasterView> all_casters(const Placement& placement, const Materials& materials,
                                             std::span<const u32> slots) {
  const Structure& structure = *placement.structure;
  std::vector<kernels::CasterView> casters;
  for (const u32 slot : slots) {
    const kernels::InstanceView instance = placement.instance(slot);
    const DeviceMesh& mesh = *placement.meshes[instance.mesh];
    const auto parts =
        std::span(structure.part_materials).subspan(instance.first_part, mesh.topology->part_count);
    const auto material =
        std::ranges::find_if(parts, [&](u32 row) { return focuses(materials.materials[row]); });
    if (!(instance.visibility & kernels::kDiffuseRay) || mesh.rest.empty()) continue;
    const mat4x3& world = instance.world_from_object;
    const vec3 half = 0.5f * (mesh.rest.upper - mesh.rest.lower);
    const kernels::MaterialValues& values = materials.materials[*material].constant;
    casters.push_back(
        {.center = world * vec4(0.5f * (mesh.rest.lower + mesh.rest.upper), 1),
         .radius = std::max({half.x * glm::length(world[0]), half.y * glm::length(world[1]),
                             half.z * glm::length(world[2])}),
         .mirror = mirror_share(values),
         .spread = kSpread * values.roughness * values.roughness});
  }
  return casters;
}

/// A light as casters show it, and what it gives.
struct CastLight {
  kernels::CastLightView view;
  double power;     // as a light tree counts it
  bool is_distant;  // then it is what it gives to a square metre
};
double size_of(const Box& scene) { return 0.5 * glm::length(scene.upper - scene.lower); }

std::vector<CastLight> all_lights(const Lights& lights, const Box& scene) {
  std::vector<CastLight> found;
  for (const kernels::LightBounds& bounds : lights.tree->bounds)
    found.push_back({{.center = 0.5f * (bounds.lower + bounds.upper),
                      .radius = 0.5f * glm::length(bounds.upper - bounds.lower)},
                     double(bounds.power),
                     false});
  const vec3 middle = 0.5f * (scene.lower + scene.upper);
  const float distance = kDistant * float(size_of(scene));
  for (const kernels::SunView& sun : lights.suns)
    found.push_back({{.center = middle + distance * sun.direction,
                      .radius = distance * std::sqrt(2 * sun.one_minus_cos)},
                     2 * M_PI * M_PI * double(sun.one_minus_cos * kernels::luminance(sun.radiance)),
                     true});
  return found;
}

/// Light that a caster catches.
double caught(const kernels::CasterView& caster, const CastLight& light) {
  const double size2 = double(caster.radius) * double(caster.radius);
  if (light.is_distant) return size2 * light.power;
  const glm::dvec3 d(light.view.center - caster.center);
  return light.power * size2 / (glm::dot(d, d) + size2);
}

/// Leaves the strongest `most`, in the order in which they were. Returns how much they stand out:
/// from 1, where they are all, to 0, where they have no more than half of the strength.
template <class T>
float keep_strongest(std::vector<T>& all, std::span<const double> strength, u32 most) {
  constexpr double kCrowd = 0.5;
  if (all.size() <= most) return 1;
  std::vector<u32> order(all.size());
  std::iota(order.begin(), order.end(), 0);
  std::ranges::sort(order, {}, [&](u32 i) { return std::pair(-strength[i], i); });
  const double whole = std::accumulate(strength.begin(), strength.end(), 0.0);
  order.resize(most);
  std::ranges::sort(order);
  double kept = 0;
  for (u32 i = 0; i < most; ++i) {
    kept += strength[order[i]];
    all[i] = all[order[i]];
  }
  all.resize(most);
  return whole > 0 ? float(std::max(kept / whole - kCrowd, 0.0) / (1 - kCrowd)) : 0;
}

}  // namespace

Casters find_casters(const Placement& placement, const Materials& materials,
                     std::span<const u32> slots, const Lights& lights) {
  Casters found{.casters = all_casters(placement, materials, slots)};
  if (found.casters.empty()) return found;
  std::vector<CastLight> cast = all_lights(lights, placement.bounds);
  std::vector<double> powers;
  const double size = size_of(placement.bounds);
  for (const CastLight& light : cast)
    powers.push_back(light.power * (light.is_distant ? size * size : 1));
  keep_strongest(cast, powers, kMostWeighed);
  std::vector<double> catches, gives(cast.size());
  for (const kernels::CasterView& caster : found.casters) {
    double sum = 0;
    for (std::size_t i = 0; i < cast.size(); ++i) {
      const double one = caught(caster, cast[i]);
      sum += one;
      gives[i] += one;
    }
    catches.push_back(sum);
  }
  const float standing = keep_strongest(found.casters, catches, kernels::kMostCasters);
  if (!(standing > 0)) return {};
  const float shown = keep_strongest(cast, gives, kernels::kMostCastLights);
  for (kernels::CasterView& caster : found.casters) caster.mirror *= shown;
  for (const CastLight& light : cast) found.lights.push_back(light.view);
  found.probability = kProbability * standing * (1 - lights.dome_share);
  return found;
}

}  // namespace heliograph::resident
