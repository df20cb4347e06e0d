#include "renderer/backend/embree/casters.h"

#include <algorithm>

#include "kernels/ray.h"

namespace heliograph::embree {
namespace {

constexpr float kRoughest = 0.3f;     // rougher ones gain less than the longer paths cost (W1)
constexpr float kProbability = 0.2f;  // measured on W1

/// Whether most of what a material gives off is reflected or refracted sharply. Textures are not
/// looked at.
bool focuses(const kernels::MaterialView& material) {
  constexpr u32 kDecisive = 1u << u32(MaterialParameter::metallic) |
                            1u << u32(MaterialParameter::transmission) |
                            1u << u32(MaterialParameter::roughness);
  const kernels::MaterialValues& m = material.constant;
  return (material.textured & kDecisive) == 0 && m.roughness <= kRoughest &&
         std::max(m.metallic, m.transmission) > 0.5f && !material.passable && !material.unlit;
}

}  // namespace

std::vector<kernels::CasterView> find_casters(const Placement& placement,
                                              const Materials& materials) {
  const Structure& structure = *placement.structure;
  std::vector<kernels::CasterView> casters;
  for (std::size_t i = 0; i < placement.instances.size(); ++i) {
    const kernels::InstanceView& instance = placement.instances[i];
    const DeviceMesh& mesh = *placement.meshes[instance.mesh];
    const auto parts =
        std::span(structure.part_materials).subspan(instance.first_part, mesh.topology->part_count);
    const bool caster = std::ranges::any_of(
        parts, [&](u32 material) { return focuses(materials.materials[material]); });
    if (!caster || !(instance.visibility & kernels::kDiffuseRay) || mesh.rest.empty()) continue;
    if (casters.size() == kernels::kMostCasters) return {};
    const mat4x3& world = instance.world_from_object;
    const vec3 half = 0.5f * (mesh.rest.upper - mesh.rest.lower);
    casters.push_back(
        {.center = world * vec4(0.5f * (mesh.rest.lower + mesh.rest.upper), 1),
         .radius = std::max({half.x * glm::length(world[0]), half.y * glm::length(world[1]),
                             half.z * glm::length(world[2])})});
  }
  return casters;
}

float caster_probability(const Lights& lights) {
  return kProbability * (1 - lights.dome.probability);
}

}  // namespace heliograph::embree
