// The instances of a placement as one Embree scene.
#pragma once

#include "renderer/backend/embree/instance_geometry.h"
#include "renderer/backend/embree/static_group.h"
#include "renderer/backend/embree/tracer.h"
#include "renderer/placement/placement.h"
#include "renderer/resident/scene.h"

namespace heliograph::embree {

/// The instances of a chunk of slots.
struct InstanceChunk {
  InstanceGeometry still;              // by row; without a box: those of the group, those that move
  std::vector<GeometryHandle> moving;  // by row; null: all others
  Box bounds;                          // of all of them
};

struct TopLevel final : SceneAccelerator {
  std::shared_ptr<const std::vector<RTCScene>> instance_scenes;  // by slot
  std::vector<std::shared_ptr<const InstanceChunk>> chunks;
  std::shared_ptr<const StaticGroup> group;
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

/// Placement as rays meet it; `view` is of its instances.
[[nodiscard]] TracedScene traced(const Placement& placement, const kernels::SceneView& view);
[[nodiscard]] inline TracedScene traced(const ResidentScene& scene) {
  return traced(scene.placement(), scene.view());
}

}  // namespace heliograph::embree
