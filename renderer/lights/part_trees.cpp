// Derived data of emitting meshes.
#include "renderer/lights/part_trees.h"

#include <bit>

#include "kernels/core/warp.h"
#include "kernels/material/texture.h"
#include "renderer/derived/materials.h"

namespace heliograph::resident {
namespace {

using kernels::LightBounds;
using kernels::LightNode;

/// Bounds of a triangle at all its times; the area is that of the middle.
LightBounds bounds_of(const DeviceMesh& mesh, uvec3 t) {
  const vec3* middle = mesh.middle();
  LightBounds all = kernels::triangle_bounds(middle[t.x], middle[t.y], middle[t.z]);
  if (mesh.segments == 0) return all;
  all.cos_spread = -1;
  for (u32 step = 0; step <= mesh.segments; ++step)
    for (const u32 vertex : {t.x, t.y, t.z}) {
      const vec3 p = mesh.positions[u64(step) * mesh.topology->vertex_count + vertex];
      all.lower = glm::min(all.lower, p);
      all.upper = glm::max(all.upper, p);
    }
  return all;
}
/// The mean luminance of a map over a triangle.
class MapMean {
 public:
  MapMean(const EmissionMap& map, const MeshTopology& topology)
      : map_(map), topology_(topology), view_(map.texture ? view_of(*map.texture) : View{}) {}

  [[nodiscard]] float operator()(u32 triangle) const {
    if (!map_.texture) return 1;
    const ArrayOf<vec2>& uvs = map_.use.uv_set == 1 ? topology_.uvs1 : topology_.uvs;
    const uvec3 t = topology_.triangles[triangle];
    const auto place = [&](u32 v) {
      return map_.use.uv_transform * vec3(uvs.empty() ? vec2(0) : uvs[v], 1);
    };
    const vec2 a = place(t.x), ab = place(t.y) - a, ac = place(t.z) - a;
    const float texels =
        0.5f * std::abs(ab.x * ac.y - ab.y * ac.x) * float(view_.width) * float(view_.height);
    const u32 points = u32(std::clamp(4 * texels, 16.0f, 1024.0f));
    double sum = 0;
    for (u32 i = 0; i < points; ++i) {
      // Roberts 2018, "The Unreasonable Effectiveness of Quasirandom Sequences": R2.
      const vec2 u(float(std::fmod((i + 0.5) * 0.7548776662466927, 1)),
                   float(std::fmod((i + 0.5) * 0.5698402909980532, 1)));
      const vec2 b = kernels::sample_triangle(u);
      const vec4 texel = kernels::sample_texture<true>(view_, a + ab * b.x + ac * b.y);
      const vec3 color = glm::max(vec3(texel * map_.use.scale + map_.use.offset), vec3(0));
      sum += double(kernels::luminance(color));
    }
    return float(sum / points);
  }

 private:
  using View = kernels::TextureView;
  const EmissionMap& map_;
  const MeshTopology& topology_;
  View view_;
};

/// Appends the tree of one part, whose triangles are given.
void add_part(PartTrees& trees, const DeviceMesh& mesh, const MapMean& mean,
              std::span<const u32> triangles) {
  constexpr float kLeast = 0.02f;  // of the mean radiosity
  std::vector<LightBounds> elements;
  std::vector<float> radiosity(triangles.size());
  elements.reserve(triangles.size());
  double area = 0, power = 0;
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    elements.push_back(bounds_of(mesh, mesh.topology->triangles[triangles[k]]));
    radiosity[k] = mean(triangles[k]);
    area += double(elements.back().power);
    power += double(elements.back().power * radiosity[k]);
  }
  const float least = area > 0 && power > 0 ? kLeast * float(power / area) : 1;
  for (std::size_t k = 0; k < triangles.size(); ++k) {
    radiosity[k] = std::max(radiosity[k], least);
    elements[k].power *= radiosity[k];
  }
  const u32 first_node = u32(trees.nodes.size()), first_entry = u32(trees.entries.size());
  trees.roots.push_back(first_node);
  trees.offsets.push_back(first_entry + u32(triangles.size()));
  LightBounds all;
  if (!elements.empty()) {
    const LightTree tree = build_light_tree(elements, kernels::kLeafTriangles);
    trees.nodes.insert(trees.nodes.end(), tree.nodes.begin(), tree.nodes.end());
    for (const u32 i : tree.order) {
      trees.entry_of_triangle[triangles[i]] = u32(trees.entries.size());
      trees.entries.push_back({triangles[i], radiosity[i], elements[i].power, 0});
    }
    for (u32 n = first_node; n < trees.nodes.size(); ++n) {
      LightNode& node = trees.nodes[n];
      if (node.parent != kernels::kNone) node.parent += first_node;
      node.first += node.count > 0 ? first_entry : first_node;
      for (u32 k = 0; k < node.count; ++k) trees.entries[node.first + k].leaf = n;
    }
    all = tree.bounds;
  }
  trees.bounds.push_back(all);
}

/// 64-bit FNV-1a of what decides on the values of a map.
u64 map_hash(const EmissionMap& map, const MeshTopology& topology) {
  const Texture& texture = *map.texture;
  const auto [serial, layout, srgb, nearest, _] = key_of(Derived::kMappedParts, texture).from;
  const auto bits = [](float x) { return u64(std::bit_cast<u32>(x)); };
  const glm::mat3x2& m = map.use.uv_transform;
  u64 hash = 0xcbf29ce484222325ull;
  for (const u64 word : {serial, layout, srgb, nearest, u64(texture.wrap_u), u64(texture.wrap_v),
                         u64(map.use.uv_set), bits(map.use.scale), bits(map.use.offset),
                         bits(m[0].x), bits(m[0].y), bits(m[1].x), bits(m[1].y), bits(m[2].x),
                         bits(m[2].y), topology.uvs.serial(), topology.uvs1.serial()})
    hash = (hash ^ word) * 0x100000001b3ull;
  return hash;
}

}  // namespace

std::shared_ptr<const PartTrees> part_trees(const DeviceMesh& mesh, const EmissionMap& map,
                                            DerivedCache& cache) {
  const MeshTopology& topology = *mesh.topology;
  DerivedKey key{Derived::kParts,
                 {mesh.positions.serial(), topology.triangles.serial(), topology.parts.serial(), 0,
                  u64(topology.part_count) | u64(topology.vertex_count) << 32}};
  Sources sources{mesh.positions.buffer(), topology.triangles.buffer()};
  if (!topology.parts.empty()) sources.push_back(topology.parts.buffer());
  if (map.texture) {
    key.kind = Derived::kMappedParts;
    key.from[3] = map_hash(map, topology);
    sources.push_back(map.texture->image->texels);
  }
  return cache.get<PartTrees>(key, std::move(sources), [&] {
    auto trees = std::make_shared<PartTrees>();
    std::vector<std::vector<u32>> parts(topology.part_count);
    for (u32 i = 0; i < topology.triangles.size(); ++i)
      parts[topology.parts.empty() ? 0 : topology.parts[i]].push_back(i);
    trees->entry_of_triangle.resize(topology.triangles.size());
    trees->offsets.push_back(0);
    const MapMean mean(map, topology);
    for (const auto& triangles : parts) add_part(*trees, mesh, mean, triangles);
    return trees;
  });
}

}  // namespace heliograph::resident
