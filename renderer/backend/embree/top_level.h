// The instances of a placement as one Embree scene.
#pragma once

#include "renderer/backend/embree/static_group.h"
#include "renderer/backend/embree/tracer.h"
#include "renderer/placement/placement.h"
#include "renderer/resident/scene.h"

namespace heliograph::embree {

struct TopLevel final : SceneAccelerator {
  std::shared_ptr<const std::vector<RTCScene>> instance_scenes;  // by slot
  ChunkedArray<GeometryHandle> geometries;                       // by slot; null: in the group
  std::shared_ptr<const StaticGroup> group;                      // its number in the scene: slots
  SceneHandle scene;

  [[nodiscard]] Box bounds() const override;
  [[nodiscard]] u64 static_bytes_beside(const SceneAccelerator* other) const override;
};

/// Meshes and top levels of Embree.
class EmbreeAccelerator final : public Accelerator {
 public:
  /// static_triangles   at most so many in the static group
  EmbreeAccelerator(RTCDevice device, u64 static_triangles)
      : device_(device), static_triangles_(static_triangles) {}

  [[nodiscard]] Expected<std::shared_ptr<const MeshAccelerator>> build(
      const DeviceMesh& mesh, const Interrupt& interrupt) const override;
  [[nodiscard]] Expected<std::shared_ptr<const SceneAccelerator>> build(
      const Snapshot& snapshot, const Placement& placement, const Kept& kept,
      const Interrupt& interrupt) const override;

 private:
  RTCDevice device_;
  u64 static_triangles_;
};

/// What rays meet of a placement; `view` is of its instances.
[[nodiscard]] TracedScene traced(const Placement& placement, const kernels::SceneView& view);
[[nodiscard]] inline TracedScene traced(const ResidentScene& scene) {
  return traced(scene.placement(), scene.view());
}

}  // namespace heliograph::embree
