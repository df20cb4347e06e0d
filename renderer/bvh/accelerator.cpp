#include "renderer/bvh/accelerator.h"

#include "renderer/bvh/build.h"
#include "renderer/bvh/instance_box.h"
#include "renderer/resident/parallel.h"

namespace heliograph::bvh {
namespace {

using kernels::kNone;
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

/// Rounding of a ray's way into an instance moves its box by less.
Box widened(const Box& box) {
  const vec3 margin = glm::max(glm::abs(box.lower), glm::abs(box.upper)) * 0x1p-21f;
  return box.empty() ? box : Box{box.lower - margin, box.upper + margin};
}

kernels::BvhInstance item_of(const Placement& placement, u32 slot) {
  const kernels::InstanceView& view = placement.instances[slot];
  const u32 mesh = placement.mesh_of_slot[slot];
  const kernels::MeshBvh bvh = bvh_of(*placement.meshes[mesh]).view();
  kernels::BvhInstance item{};
  const mat4x3& m = view.object_from_world;
  for (int k = 0; k < 3; ++k) item.object_from_world[k] = {m[0][k], m[1][k], m[2][k], m[3][k]};
  item.nodes = bvh.nodes;
  item.triangles = bvh.triangles;
  item.instance = slot;
  item.mesh = mesh;
  item.visibility = view.visibility;
  item.flags =
      (view.segments > 0 ? u32(kernels::kBvhMoves) : 0) | (bvh.nodes ? 0 : u32(kernels::kBvhShape));
  return item;
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

kernels::BvhView BvhScene::view() const {
  return {top.empty() ? nullptr : top.data(), items.data(), meshes.data(), item_of_instance.data(),
          u32(items.size())};
}

kernels::BvhView view(const Placement& placement) {
  const BvhScene* scene = bvh_of(placement);
  return scene ? scene->view() : kernels::BvhView{};
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
    const Snapshot&, const Placement& placement, const resident::Kept&,
    const Interrupt& interrupt) const {
  auto made = std::make_shared<BvhScene>();
  for (const auto& mesh : placement.meshes) made->meshes.push_back(bvh_of(*mesh).view());
  const u32 count = u32(placement.instances.size());
  std::vector<Box> boxes(count);
  resident::parallel_ranges(count, 256u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) {
      const Box object = placement.meshes[placement.mesh_of_slot[i]]->accelerator->bounds();
      // Keys of what rays do not meet may have no pose.
      boxes[i] = placement.instances[i].segments > 0 && placement.instances[i].visibility
                     ? moving_box(object, placement.keys_of(i))
                     : placed_box(object, placement.instances[i].world_from_object);
    }
  });
  HELIO_TRY(interrupt.status());
  for (u32 i = 0; i < count; ++i) {
    made->box.extend(boxes[i]);
    boxes[i] = placement.instances[i].visibility ? widened(boxes[i]) : Box{};
  }
  auto tree = build_tree(boxes, kOverInstances, interrupt);
  if (!tree) return std::unexpected(std::move(tree).error());
  if (!tree->items.empty()) made->top = std::move(tree->nodes);
  std::vector<u32>& order = tree->items;
  made->item_of_instance.assign(count, kNone);
  for (u32 i = 0; i < order.size(); ++i) made->item_of_instance[order[i]] = i;
  for (u32 i = 0; i < count; ++i)
    if (made->item_of_instance[i] == kNone) {
      made->item_of_instance[i] = u32(order.size());
      order.push_back(i);
    }
  made->items.resize(count);
  resident::parallel_ranges(count, 1024u, [&](u32 begin, u32 end) {
    for (u32 i = begin; i < end; ++i) made->items[i] = item_of(placement, order[i]);
  });
  return made;
}

}  // namespace heliograph::bvh
