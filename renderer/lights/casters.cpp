#include "renderer/lights/casters.h"

#include <algorithm>

#include "kernels/scene/ray.h"

namespace heliograph::resident {
namespace {

constexpr float kProbability = 0.2f;  // measured on W1
constexpr float kSpread = 0.5f;       // of an image, in slopes alpha; wider is no better (W1)
constexpr float kDistant = 1e5f;      // radii of the scene that a sun is away

float mirror_share(const kernels::MaterialValues& material) {
  return material.metallic > 0.5f ? 1.0f : 0.25f;  // glass reflects less
}

}  // namespace

std::vector<kernels::CasterView> find_casters(const Placement& placement,
                                              const Materials& materials,
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
    if (casters.size() == kernels::kMostCasters) return {};
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

std::vector<kernels::CastLightView> find_cast_lights(const Lights& lights, const Box& scene) {
  std::vector<kernels::CastLightView> found;
  if (lights.lights.size() + lights.suns.size() > kernels::kMostCastLights || scene.empty())
    return found;
  for (const kernels::LightBounds& bounds : lights.tree->bounds)
    found.push_back({.center = 0.5f * (bounds.lower + bounds.upper),
                     .radius = 0.5f * glm::length(bounds.upper - bounds.lower)});
  const vec3 middle = 0.5f * (scene.lower + scene.upper);
  const float distance = kDistant * 0.5f * glm::length(scene.upper - scene.lower);
  for (const kernels::SunView& sun : lights.suns)
    found.push_back({.center = middle + distance * sun.direction,
                     .radius = distance * std::sqrt(2 * sun.depth)});
  return found;
}

float caster_probability(const Lights& lights) { return kProbability * (1 - lights.dome_share); }

}  // namespace heliograph::resident
