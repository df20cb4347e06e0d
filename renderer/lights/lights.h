// Lights: the entities' lights, emissive materials and the dome, and how often each is sampled.
#pragma once

#include "renderer/derived/materials.h"
#include "renderer/lights/light_strength.h"
#include "renderer/lights/part_trees.h"
#include "renderer/lights/portals.h"
#include "renderer/placement/placement.h"

namespace heliograph::resident {

/// Density of a dome's texture over directions and its integrals.
struct DomeTables {
  std::vector<float> row_cdf;
  std::vector<float> column_cdf;
  std::vector<kernels::u16> guides;  // empty for pictures larger than its numbers reach
  vec3 integral{0};                  // of the texture over the sphere
  [[nodiscard]] u64 bytes() const {
    return (row_cdf.size() + column_cdf.size()) * sizeof(float) + guides.size() * 2;
  }
};
[[nodiscard]] std::shared_ptr<const DomeTables> dome_tables(const Texture& texture,
                                                            DerivedCache& cache);

/// The tree over the lights of a scene: a function of their bounds.
struct TopTree {
  std::vector<kernels::LightBounds> bounds;  // by light
  std::vector<kernels::LightNode> nodes;     // a leaf's entry is a light
  std::vector<u32> leaves;                   // by light
};

struct Lights {
  std::vector<kernels::LightView> lights;
  std::vector<kernels::FlatTriangle> flat_triangles;  // of those that are flat
  std::shared_ptr<const TopTree> tree;
  std::shared_ptr<const std::vector<u32>> part_lights;         // null: there are no lights
  std::shared_ptr<const std::vector<u32>> emitters;            // slots that may emit, ascending
  std::vector<std::shared_ptr<const PartTrees>> part_trees;    // by mesh of the placement, or null
  std::vector<std::shared_ptr<const PartTrees>> mapped_trees;  // those of emission maps
  std::vector<kernels::SunView> suns;
  std::vector<std::vector<kernels::MotionKey>> sun_keys;  // by sun; empty: it stands still
  std::vector<std::string> groups;  // the structure's, then those of suns and the dome
  float sky_power = 0;              // of the dome and the suns, as kernels::importance() counts
  float dome_share = 0;             // of the power of all that emits
  kernels::DomeView dome{};
  std::shared_ptr<const DomeTables> dome_tables;  // null: constant
  std::vector<kernels::PortalView> portals;
  std::vector<std::shared_ptr<const PortalMap>> portal_maps;

  /// True if there is any.
  [[nodiscard]] bool any() const {
    return !lights.empty() || !suns.empty() || dome.radiance != vec3(0);
  }
};

/// Sources that lights are made of.
struct LightSources {
  const Snapshot& snapshot;
  const Placement& placement;
  const std::shared_ptr<const Materials>& materials;
};
/// Earlier ones.
struct LightsBefore {
  LightSources of;
  std::shared_ptr<const Lights> lights;
};
/// Takes over what `before`, or null, has of the same sources; the result does not depend on it.
[[nodiscard]] std::shared_ptr<const Lights> make_lights(const LightSources& sources,
                                                        const LightsBefore* before,
                                                        DerivedCache& cache);

}  // namespace heliograph::resident
