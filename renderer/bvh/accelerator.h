// Meshes and scenes as trees that kernels::BvhTracer walks, in host memory. Used by the CUDA
// backend, which uploads them.
#pragma once

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

/// The tree over the instances of a placement.
struct BvhScene final : resident::SceneAccelerator {
  std::vector<kernels::BvhNode> top;        // empty: rays meet nothing
  std::vector<kernels::BvhInstance> items;  // of all slots; their pointers are to host memory
  std::vector<u32> item_of_instance;        // by slot
  std::vector<kernels::MeshBvh> meshes;     // by number in Placement::meshes
  Box box;

  [[nodiscard]] Box bounds() const override { return box; }
  /// Lifetime: of this and of the placement's meshes.
  [[nodiscard]] kernels::BvhView view() const;
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
/// The tree over a placement's instances; null: there are none.
[[nodiscard]] inline const BvhScene* bvh_of(const resident::Placement& placement) {
  return static_cast<const BvhScene*>(placement.accelerator.get());
}

/// What a BvhTracer reads of a placement besides the SceneView. Lifetime: of the placement.
[[nodiscard]] kernels::BvhView view(const resident::Placement& placement);

}  // namespace heliograph::bvh
