// Meshes and scenes as trees that kernels::BvhTracer walks, in host memory. Used by the CUDA
// backend, which uploads them.
#pragma once

#include <mutex>

#include "kernels/bvh/bvh.h"
#include "renderer/bvh/static_tree.h"
#include "renderer/device/accelerator.h"
#include "renderer/placement/placement.h"

namespace heliograph::bvh {

using resident::Box;

/// A tree over the primitives of a mesh.
struct BvhTree {
  std::vector<kernels::BvhNode> nodes;          // empty: the mesh is a disc or a sphere
  std::vector<kernels::BvhTriangle> triangles;  // in the order of leaves; empty: see the next
  std::vector<u32> triangle_numbers;  // the same where they are not has_packed_triangles()
};

/// The tree over one mesh, for rays on the host. Of vertices that are an entity's own it is made
/// when it is first asked for, as BvhScene is. Thread: any.
class BvhMesh final : public resident::MeshAccelerator {
 public:
  explicit BvhMesh(const resident::DeviceMesh& mesh);
  [[nodiscard]] u64 bytes() const override { return bytes_; }
  [[nodiscard]] Box bounds() const override { return box_; }
  /// mesh   any that has this
  [[nodiscard]] const BvhTree& tree(const resident::DeviceMesh& mesh) const;

 private:
  Box box_;
  u64 bytes_ = 0;  // the tree's, whether it is made or not
  mutable std::once_flag made_;
  mutable BvhTree tree_;
};

/// The instances of a placement as rays enter them.
struct BvhTop {
  // Over those that are no members of the static group. Empty: there is no tree, or rays meet none.
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhInstance> items;  // of all slots; their pointers are to host memory
  std::vector<u32> item_of_instance;        // by slot
};

/// The tree over the instances of a placement, for rays on the host. Made when it is first asked
/// for: where rays are traced elsewhere, few frames ask. Thread: any.
class BvhScene final : public resident::SceneAccelerator {
 public:
  /// fixed   the placement's group, or null
  BvhScene(const resident::Placement& placement, const resident::Kept& kept,
           std::shared_ptr<const StaticGroup> fixed);
  [[nodiscard]] Box bounds() const override { return box_; }
  [[nodiscard]] u64 static_bytes_beside(const SceneAccelerator* other) const override;
  /// Null: there are no members.
  [[nodiscard]] const std::shared_ptr<const StaticGroup>& fixed() const { return fixed_; }
  /// For rays of the world.
  ///
  /// placement   the one that this is of
  [[nodiscard]] const BvhTop& world(const resident::Placement& placement) const;
  /// For rays within one instance, without a tree: in the order of slots.
  [[nodiscard]] const BvhTop& objects(const resident::Placement& placement) const;
  /// View of one of the two. Lifetime: of the placement.
  [[nodiscard]] kernels::BvhView view(const BvhTop& top) const;

 private:
  [[nodiscard]] std::span<const kernels::MeshBvh> meshes(
      const resident::Placement& placement) const;

  const std::shared_ptr<const StaticGroup> fixed_;
  std::vector<Box> chunks_;  // of the chunks of instances
  Box box_;
  mutable std::once_flag made_meshes_, made_world_, made_objects_;
  mutable std::vector<kernels::MeshBvh> meshes_;  // by number in Placement::meshes
  mutable BvhTop world_, objects_;
};

/// Thread: any. Structures depend neither on threads nor on what was kept.
class BvhAccelerator final : public resident::Accelerator {
 public:
  /// static_triangles   at most so many in the static group
  explicit BvhAccelerator(u64 static_triangles) : static_trees_(static_triangles) {}

  [[nodiscard]] Expected<std::shared_ptr<const resident::MeshAccelerator>> build(
      const resident::DeviceMesh& mesh, const Interrupt& interrupt) const override;
  [[nodiscard]] Expected<std::shared_ptr<const resident::SceneAccelerator>> build(
      const Snapshot& snapshot, const resident::Placement& placement, const resident::Kept& kept,
      const Interrupt& interrupt) const override;

 private:
  StaticTrees static_trees_;
};

/// The tree that a resident mesh has. Lifetime: of its accelerator.
[[nodiscard]] inline const BvhTree& tree_of(const resident::DeviceMesh& mesh) {
  return static_cast<const BvhMesh&>(*mesh.accelerator).tree(mesh);
}
/// Null: there are no instances.
[[nodiscard]] inline const BvhScene* bvh_of(const resident::Placement& placement) {
  return static_cast<const BvhScene*>(placement.accelerator.get());
}

// Parts of a placement that a BvhTracer reads besides the SceneView: BvhScene's two, or nothing if
// there are no instances. Lifetime: of the placement.
[[nodiscard]] kernels::BvhView world_view(const resident::Placement& placement);
[[nodiscard]] kernels::BvhView objects_view(const resident::Placement& placement);

}  // namespace heliograph::bvh
