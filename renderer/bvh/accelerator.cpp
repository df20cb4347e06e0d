#include "renderer/bvh/accelerator.h"

#include <cassert>
#include <numeric>

#include "kernels/bvh_box.h"
#include "renderer/bvh/build.h"
#include "renderer/resident/parallel.h"

namespace heliograph::bvh {
namespace {

using resident::DeviceMesh;
using resident::Placement;

constexpr TreeOptions kOverTriangles{.item_cost = 0.3f};
// To enter an instance costs the ray's way into its space and the first node there.
constexpr TreeOptions kOverInstances{.item_cost = 2};

/// Boxes of triangles, over all times.
std::vector<Box> triangle_boxes(const DeviceMesh& mesh) {
  const ArrayOf<uvec3>& triangles = mesh.topology->triangles;
  std::vector<Box> boxes(triangles.size());
  resident::parallel_ranges(triangles.size(), std::size_t(4096), [&](auto begin, auto end) {
    for (u32 step = 0; step <= mesh.segments; ++step) {
      const vec3* positions = mesh.positions.data() + u64(step) * mesh.topology->vertex_count;
      for (auto i = begin; i < end; ++i) {
        const uvec3 t = triangles[i];
        for (int k = 0; k < 3; ++k) boxes[i].extend(positions[t[k]]);
      }
    }
  });
  return boxes;
}

std::vector<kernels::BvhTriangle> triangles_of(const DeviceMesh& mesh,
                                               std::span<const u32> numbers) {
  std::vector<kernels::BvhTriangle> out(numbers.size());
  const vec3* positions = mesh.positions.data();
  resident::parallel_ranges(numbers.size(), std::size_t(4096), [&](auto begin, auto end) {
    for (auto i = begin; i < end; ++i) {
      const uvec3 t = mesh.topology->triangles[numbers[i]];
      const vec3 a = positions[t.x];
      out[i] = {a, numbers[i], positions[t.y] - a, 0, positions[t.z] - a, 0};
    }
  });
  return out;
}

Box shape_box(kernels::Shape shape) {
  const float z = shape == kernels::Shape::kSphere ? 1 : 0;
  return {vec3(-1, -1, -z), vec3(1, 1, z)};
}

Box of(const kernels::BvhBox& box) { return {box.lower, box.upper}; }

/// The boxes of all slots.
///
/// box_of   of a slot's InstanceView, its keys and its mesh's box
template <class F>
std::vector<Box> boxes_of(const Placement& placement, F&& box_of) {
  const u32 count = u32(placement.instances.size());
  std::vector<Box> boxes(count);
  resident::parallel_ranges(count, 256u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) {
      const Box mesh = placement.meshes[placement.mesh_of_slot[i]]->accelerator->bounds();
      boxes[i] = of(box_of(placement.instances[i], placement.motion_keys.data(),
                           kernels::BvhBox{mesh.lower, mesh.upper}));
    }
  });
  return boxes;
}

/// order   slots by item
BvhTop top_of(const Placement& placement, std::span<const kernels::MeshBvh> meshes,
              std::span<const u32> order) {
  BvhTop top;
  const u32 count = u32(order.size());
  top.items.resize(count);
  top.item_of_instance.resize(count);
  resident::parallel_ranges(count, 1024u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) {
      const kernels::InstanceView& instance = placement.instances[order[i]];
      top.items[i] = kernels::bvh_instance(instance, order[i], meshes[instance.mesh]);
      top.item_of_instance[order[i]] = i;
    }
  });
  return top;
}

BvhTop tree_of(const Placement& placement, std::span<const kernels::MeshBvh> meshes) {
  const std::vector<Box> boxes = boxes_of(placement, kernels::ray_box);
  auto tree = build_tree(boxes, kOverInstances, {});
  assert(tree);  // only an interrupt makes it fail
  const bool is_empty = tree->items.empty();
  for (u32 i = 0; i < boxes.size(); ++i)
    if (boxes[i].empty()) tree->items.push_back(i);
  BvhTop top = top_of(placement, meshes, tree->items);
  if (!is_empty) top.nodes = std::move(tree->nodes);
  return top;
}

}  // namespace

u64 BvhMesh::bytes() const {
  return nodes.size() * sizeof(kernels::BvhNode) + triangles.size() * sizeof(kernels::BvhTriangle) +
         triangle_numbers.size() * sizeof(u32);
}

kernels::MeshBvh BvhMesh::view() const {
  return {nodes.empty() ? nullptr : nodes.data(), triangles.empty() ? nullptr : triangles.data(),
          triangle_numbers.empty() ? nullptr : triangle_numbers.data()};
}

BvhScene::BvhScene(const Placement& placement) {
  for (const auto& mesh : placement.meshes) meshes_.push_back(bvh_of(*mesh).view());
  for (const Box& box : boxes_of(placement, kernels::instance_box)) box_.extend(box);
}

kernels::BvhView BvhScene::view(const BvhTop& top) const {
  return {top.nodes.empty() ? nullptr : top.nodes.data(), top.items.data(), meshes_.data(),
          top.item_of_instance.data(), u32(top.items.size())};
}

const BvhTop& BvhScene::world(const Placement& placement) const {
  std::call_once(made_world_,
                 [&] { resident::run_alone([&] { world_ = tree_of(placement, meshes_); }); });
  return world_;
}

const BvhTop& BvhScene::objects(const Placement& placement) const {
  std::call_once(made_objects_, [&] {
    std::vector<u32> slots(placement.instances.size());
    std::iota(slots.begin(), slots.end(), 0u);
    resident::run_alone([&] { objects_ = top_of(placement, meshes_, slots); });
  });
  return objects_;
}

kernels::BvhView world_view(const Placement& placement) {
  const BvhScene* scene = bvh_of(placement);
  return scene ? scene->view(scene->world(placement)) : kernels::BvhView{};
}
kernels::BvhView objects_view(const Placement& placement) {
  const BvhScene* scene = bvh_of(placement);
  return scene ? scene->view(scene->objects(placement)) : kernels::BvhView{};
}

Expected<std::shared_ptr<const resident::MeshAccelerator>> BvhAccelerator::build(
    const DeviceMesh& mesh) const {
  auto made = std::make_shared<BvhMesh>();
  if (mesh.shape() != kernels::Shape::kTriangles) {
    made->box = shape_box(mesh.shape());
    return made;
  }
  const std::vector<Box> boxes = triangle_boxes(mesh);
  for (const Box& box : boxes) made->box.extend(box);
  auto tree = build_tree(boxes, kOverTriangles, {});
  if (!tree) return std::unexpected(std::move(tree).error());
  made->nodes = std::move(tree->nodes);
  if (mesh.segments > 0)
    made->triangle_numbers = std::move(tree->items);
  else
    made->triangles = triangles_of(mesh, tree->items);
  return made;
}

Expected<std::shared_ptr<const resident::SceneAccelerator>> BvhAccelerator::build(
    const Snapshot&, const Placement& placement, const resident::Kept&, const Interrupt&) const {
  return std::make_shared<BvhScene>(placement);
}

}  // namespace heliograph::bvh
