#include "renderer/placement/surfaces.h"

#include <algorithm>
#include <numeric>

#include "kernels/material/material.h"
#include "renderer/base/parallel.h"

namespace heliograph::resident {
namespace {

bool may_be_hole(const kernels::MaterialView& material) {
  return material.alpha_mode != kernels::AlphaMode::kOpaque;
}

constexpr float kRoughest = 0.3f;  // rougher ones gain less than the longer paths cost (W1)

enum Trait : u8 { kHole = 1, kFocuses = 2 };

/// Traits of the material table's rows.
std::vector<u8> traits_of(const Materials& materials) {
  std::vector<u8> traits;
  for (const kernels::MaterialView& material : materials.materials)
    traits.push_back(u8((may_be_hole(material) ? kHole : 0) | (focuses(material) ? kFocuses : 0)));
  return traits;
}

/// Traits of the slots: those of any of their parts.
std::vector<u8> traits_of(const Structure& structure, const std::vector<u8>& of_material) {
  std::vector<u8> traits(structure.slots.size());
  constexpr std::size_t kGrain = 4096;
  parallel_ranges(traits.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const Slot& slot = structure.slots[i];
      const u32 parts = structure.meshes[slot.mesh]->topology->part_count;
      for (u32 part = 0; part < parts; ++part)
        traits[i] |= of_material[structure.part_materials[slot.first_part + part]];
    }
  });
  return traits;
}

}  // namespace

bool focuses(const kernels::MaterialView& material) {
  constexpr kernels::ParameterSet kDecisive = kernels::parameters(
      MaterialParameter::metallic, MaterialParameter::transmission, MaterialParameter::roughness);
  const kernels::MaterialValues& m = material.constant;
  return (material.textured & kDecisive) == 0 && m.roughness <= kRoughest &&
         std::max(m.metallic, m.transmission) > 0.5f && !material.passable && !material.unlit;
}

std::shared_ptr<const Surfaces> make_surfaces(const Structure& structure,
                                              const Materials& materials, const Surfaces* before) {
  auto surfaces = std::make_shared<Surfaces>();
  std::vector<u8> used(materials.materials.size());
  for (const u32 row : structure.part_materials) used[row] = 1;
  const std::vector<u8> of_material = traits_of(materials);
  u8 all = 0;
  for (std::size_t row = 0; row < used.size(); ++row) {
    if (!used[row]) continue;
    kernels::accumulate_features(surfaces->all, materials.materials[row]);
    all |= of_material[row];
  }
  if (all == 0) return surfaces;
  std::vector<u8> traits = traits_of(structure, of_material);
  for (u32 i = 0; i < traits.size(); ++i)
    if (traits[i] & kFocuses) surfaces->focusing.push_back(i);
  if (!(all & kHole)) return surfaces;
  for (u8& trait : traits) trait &= kHole;
  if (before && before->holes && *before->holes == traits)
    surfaces->holes = before->holes;
  else
    surfaces->holes = std::make_shared<const std::vector<u8>>(std::move(traits));
  return surfaces;
}

}  // namespace heliograph::resident
