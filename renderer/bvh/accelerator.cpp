#include "renderer/bvh/accelerator.h"

#include <cassert>
#include <numeric>

#include "kernels/bvh/bvh_box.h"
#include "renderer/base/parallel.h"
#include "renderer/bvh/build.h"

namespace heliograph::bvh {
namespace {

using resident::DeviceMesh;
using resident::Placement;

constexpr u32 kRows = ChunkedArray<u32>::kRows;
constexpr TreeOptions kOverTriangles{.item_cost = 0.3f};
// To enter an instance costs the ray's way into its space and the first node there.
constexpr TreeOptions kOverInstances{.item_cost = 2};

Box of(const kernels::BvhBox& box) { return {box.lower, box.upper}; }

/// Boxes of primitives, over all times.
std::vector<Box> primitive_boxes(const DeviceMesh& mesh) {
  const kernels::MeshView view = mesh.view();
  std::vector<Box> boxes(view.triangle_count);
  parallel_ranges(view.triangle_count, 4096u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) boxes[i] = of(kernels::primitive_box(view, i));
  });
  return boxes;
}

Box bounds_of(const DeviceMesh& mesh) {
  constexpr u32 kChunk = 1 << 15;
  const kernels::MeshView view = mesh.view();
  std::vector<Box> chunks((view.triangle_count + kChunk - 1) / kChunk);
  parallel_for(u32(chunks.size()), [&](u32 c) {
    const u32 end = std::min((c + 1) * kChunk, view.triangle_count);
    for (u32 key = 0; key <= view.segments; ++key)
      for (u32 i = c * kChunk; i < end; ++i) kernels::bound_primitive(view, i, key, chunks[c]);
  });
  Box box;
  for (const Box& chunk : chunks) box.extend(chunk);
  return box;
}

std::vector<kernels::BvhTriangle> triangles_of(const DeviceMesh& mesh,
                                               std::span<const u32> numbers) {
  const kernels::MeshView view = mesh.view();
  std::vector<kernels::BvhTriangle> out(numbers.size());
  parallel_ranges(numbers.size(), std::size_t(4096), [&](auto begin, auto end) {
    for (auto i = begin; i < end; ++i) out[i] = kernels::bvh_triangle(view, numbers[i]);
  });
  return out;
}

BvhTree make_tree(const DeviceMesh& mesh) {
  auto made = build_tree(primitive_boxes(mesh), kOverTriangles, {});
  assert(made);  // only an interrupt makes it fail
  BvhTree tree;
  tree.nodes = std::move(made->nodes);
  if (kernels::has_packed_triangles(mesh.view()))
    tree.triangles = triangles_of(mesh, made->items);
  else
    tree.triangle_numbers = std::move(made->items);
  return tree;
}

kernels::MeshBvh view_of(const BvhTree& tree) {
  return {tree.nodes.empty() ? nullptr : tree.nodes.data(),
          tree.triangles.empty() ? nullptr : tree.triangles.data(),
          tree.triangle_numbers.empty() ? nullptr : tree.triangle_numbers.data()};
}

kernels::BvhBox mesh_box(const Placement& placement, u32 slot) {
  const Box box = placement.mesh(slot).accelerator->bounds();
  return {box.lower, box.upper};
}

/// Box of the instance of a slot. For what does not move it takes no instance.
Box box_of(const Placement& placement, u32 slot) {
  const kernels::SlotView& view = placement.slots[slot];
  const kernels::MotionKey* keys = placement.motion_keys.data();
  const kernels::BvhBox mesh = mesh_box(placement, slot);
  if (view.segments > 0) return of(kernels::instance_box(placement.instance(slot), keys, mesh));
  const mat4x3 world = placement.mesh_pose(slot);
  return of(kernels::placed_box(mesh, kernels::usable_pose(world) ? world : mat4x3(1)));
}

/// Boxes in which rays look for each slot.
std::vector<Box> ray_boxes(const Placement& placement) {
  const auto& instances = placement.instances();
  std::vector<Box> boxes(instances.size());
  parallel_ranges(u32(boxes.size()), 256u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i)
      boxes[i] =
          of(kernels::ray_box(instances[i], placement.motion_keys.data(), mesh_box(placement, i)));
  });
  return boxes;
}

/// order   slots by item
BvhTop top_of(const Placement& placement, std::span<const kernels::MeshBvh> meshes,
              std::span<const u32> order) {
  BvhTop top;
  const auto& instances = placement.instances();
  const u32 count = u32(order.size());
  top.items.resize(count);
  top.item_of_instance.resize(count);
  parallel_ranges(count, 1024u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) {
      const kernels::InstanceView& instance = instances[order[i]];
      top.items[i] = kernels::bvh_instance(instance, order[i], meshes[instance.mesh]);
      top.item_of_instance[order[i]] = i;
    }
  });
  return top;
}

/// fixed   what is left out, or null
BvhTop tree_over(const Placement& placement, std::span<const kernels::MeshBvh> meshes,
                 const StaticGroup* fixed) {
  std::vector<Box> boxes = ray_boxes(placement);
  if (fixed)
    for (const u32 slot : fixed->slots) boxes[slot] = {};
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

BvhMesh::BvhMesh(const DeviceMesh& mesh) {
  box_ = bounds_of(mesh);
  if (kernels::is_whole(mesh.shape())) return;
  if (mesh.is_deformed()) {
    constexpr u64 kNodeBytes = 24;  // a triangle's share
    bytes_ = mesh.topology->triangles.size() * (sizeof(kernels::BvhTriangle) + kNodeBytes);
    return;
  }
  const BvhTree& made = tree(mesh);
  bytes_ = made.nodes.size() * sizeof(kernels::BvhNode) +
           made.triangles.size() * sizeof(kernels::BvhTriangle) +
           made.triangle_numbers.size() * sizeof(u32);
}

const BvhTree& BvhMesh::tree(const DeviceMesh& mesh) const {
  std::call_once(made_, [&] {
    if (kernels::is_whole(mesh.shape())) return;
    run_alone([&] { tree_ = make_tree(mesh); });
  });
  return tree_;
}

BvhScene::BvhScene(const Placement& placement, const resident::Kept& kept,
                   std::shared_ptr<const StaticGroup> fixed)
    : fixed_(std::move(fixed)), chunks_(placement.slots.chunk_count()) {
  const BvhScene* before = kept.before ? bvh_of(*kept.before) : nullptr;
  std::vector<u32> changed;
  for (u32 c = 0; c < chunks_.size(); ++c) {
    if (before && kept.chunk(placement, c))
      chunks_[c] = before->chunks_[c];
    else
      changed.push_back(c);
  }
  parallel_for(changed.size(), [&](std::size_t i) {
    const u32 first = changed[i] * kRows;
    for (u32 k = 0; k < placement.slots.chunk(changed[i]).size(); ++k)
      chunks_[changed[i]].extend(box_of(placement, first + k));
  });
  for (const Box& box : chunks_) box_.extend(box);
}

u64 BvhScene::static_bytes_beside(const SceneAccelerator* other) const {
  if (!fixed_) return 0;
  const auto* theirs = static_cast<const BvhScene*>(other);
  if (theirs && theirs->fixed_ && theirs->fixed_->tree == fixed_->tree) return 0;
  return fixed_->tree->bytes();
}

std::span<const kernels::MeshBvh> BvhScene::meshes(const Placement& placement) const {
  std::call_once(made_meshes_, [&] {
    for (const auto& mesh : placement.meshes) meshes_.push_back(view_of(tree_of(*mesh)));
  });
  return meshes_;
}

kernels::BvhView BvhScene::view(const BvhTop& top) const {
  return {top.nodes.empty() ? nullptr : top.nodes.data(),
          top.items.data(),
          meshes_.data(),
          top.item_of_instance.data(),
          u32(top.items.size()),
          fixed_ ? fixed_->view() : kernels::StaticBvh{}};
}

const BvhTop& BvhScene::world(const Placement& placement) const {
  std::call_once(made_world_, [&] {
    run_alone([&] { world_ = tree_over(placement, meshes(placement), fixed_.get()); });
  });
  return world_;
}

const BvhTop& BvhScene::objects(const Placement& placement) const {
  std::call_once(made_objects_, [&] {
    std::vector<u32> slots(placement.slots.size());
    std::iota(slots.begin(), slots.end(), 0u);
    run_alone([&] { objects_ = top_of(placement, meshes(placement), slots); });
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
    const DeviceMesh& mesh, const Interrupt& interrupt) const {
  HELIO_TRY(interrupt.status());
  return std::make_shared<BvhMesh>(mesh);
}

Expected<std::shared_ptr<const resident::SceneAccelerator>> BvhAccelerator::build(
    const Snapshot&, const Placement& placement, const resident::Kept& kept,
    const Interrupt& interrupt) const {
  const BvhScene* before = kept.before ? bvh_of(*kept.before) : nullptr;
  auto fixed = static_trees_.group(placement, kept, before ? before->fixed() : nullptr, interrupt);
  if (!fixed) return std::unexpected(std::move(fixed).error());
  return std::make_shared<BvhScene>(placement, kept, *std::move(fixed));
}

}  // namespace heliograph::bvh
