// Meshes and scenes as trees that kernels::BvhTracer walks, in host memory. Used by the CUDA
// backend, which uploads them.
#pragma once

#include <mutex>

#include "kernels/bvh.h"
#include "renderer/resident/accelerator.h"
#include "renderer/resident/placement.h"

namespace heliograph::bvh {

using resident::Box;

/// The tree over one mesh. Without nodes: the mesh is a shape.
struct BvhMesh final : resident::MeshAccelerator {
  std::vector<kernels::BvhNode> nodes;
  std::vector<kernels::BvhTriangle> triangles;  // in the order of leaves; empty: it deforms
  std::vector<u32> triangle_numbers;            // in the order of leaves, of a mesh that deforms
  Box box;

  [[nodiscard]] u64 bytes() const override;
  [[nodiscard]] Box bounds() const override { return box; }
  /// Lifetime: of this.
  [[nodiscard]] kernels::MeshBvh view() const;
};

/// The instances of a placement as rays enter them.
struct BvhTop {
  std::vector<kernels::BvhNode> nodes;      // empty: there is no tree, or rays meet nothing
  std::vector<kernels::BvhInstance> items;  // of all slots; their pointers are to host memory
  std::vector<u32> item_of_instance;        // by slot
};

/// The tree over the instances of a placement, for rays on the host. Made when it is first asked
/// for: where rays are traced elsewhere, few frames ask. Thread: any.
class BvhScene final : public resident::SceneAccelerator {
 public:
  explicit BvhScene(const resident::Placement& placement);
  [[nodiscard]] Box bounds() const override { return box_; }
  /// For rays of the world.
  ///
  /// placement   the one that this is of
  [[nodiscard]] const BvhTop& world(const resident::Placement& placement) const;
  /// For rays within one instance, without a tree: in the order of slots.
  [[nodiscard]] const BvhTop& objects(const resident::Placement& placement) const;
  /// Of one of the two. Lifetime: of the placement.
  [[nodiscard]] kernels::BvhView view(const BvhTop& top) const;

 private:
  Box box_;
  std::vector<kernels::MeshBvh> meshes_;  // by number in Placement::meshes
  mutable std::once_flag made_world_, made_objects_;
  mutable BvhTop world_, objects_;
};

/// Thread: any. Structures depend neither on threads nor on what was kept.
class BvhAccelerator final : public resident::Accelerator {
 public:
  [[nodiscard]] Expected<std::shared_ptr<const resident::MeshAccelerator>> build(
      const resident::DeviceMesh& mesh) const override;
  [[nodiscard]] Expected<std::shared_ptr<const resident::SceneAccelerator>> build(
      const Snapshot& snapshot, const resident::Placement& placement, const resident::Kept& kept,
      const Interrupt& interrupt) const override;
};

/// The tree that a resident mesh has.
[[nodiscard]] inline const BvhMesh& bvh_of(const resident::DeviceMesh& mesh) {
  return static_cast<const BvhMesh&>(*mesh.accelerator);
}
/// Null: there are no instances.
[[nodiscard]] inline const BvhScene* bvh_of(const resident::Placement& placement) {
  return static_cast<const BvhScene*>(placement.accelerator.get());
}

// What a BvhTracer reads of a placement besides the SceneView: BvhScene's two, or nothing where
// there are no instances. Lifetime: of the placement.
[[nodiscard]] kernels::BvhView world_view(const resident::Placement& placement);
[[nodiscard]] kernels::BvhView objects_view(const resident::Placement& placement);

}  // namespace heliograph::bvh
