#include "renderer/lights/same_lights.h"

#include <algorithm>

namespace heliograph::resident {

bool has_same_slots(const LightSources& now, const LightsBefore& before) {
  return before.of.placement.structure == now.placement.structure &&
         before.of.materials == now.materials;
}

bool has_same_sources(const LightSources& now, const LightsBefore& before) {
  const Placement &a = now.placement, &b = before.of.placement;
  const Structure& structure = *a.structure;
  if (!has_same_slots(now, before) || now.snapshot.dome != before.of.snapshot.dome ||
      !structure.suns.empty() || !structure.portals.empty() || a.meshes != b.meshes ||
      a.bounds.lower != b.bounds.lower || a.bounds.upper != b.bounds.upper)
    return false;
  return std::ranges::all_of(*before.lights->emitters, [&](u32 slot) {
    const u32 entity = structure.slots[slot].entity;
    return a.slots[slot].segments == 0 && same_bytes(a.instance(slot), b.instance(slot)) &&
           now.snapshot.entities.at(entity) == before.of.snapshot.entities.at(entity);
  });
}

bool has_same_parts(std::span<const kernels::LightView> a, std::span<const kernels::LightView> b) {
  return std::ranges::equal(a, b, [](const auto& x, const auto& y) {
    return x.instance == y.instance && x.part == y.part;
  });
}

std::shared_ptr<const std::vector<u32>> part_lights_of(const Structure& structure,
                                                       std::span<const kernels::LightView> lights) {
  std::vector<u32> table(structure.part_materials.size(), kNone);
  for (u32 i = 0; i < lights.size(); ++i)
    table[structure.slots[lights[i].instance].first_part + lights[i].part] = i;
  return std::make_shared<const std::vector<u32>>(std::move(table));
}

}  // namespace heliograph::resident
