// Meshes as Embree scenes.
#pragma once

#include "renderer/backend/embree/embree.h"
#include "renderer/backend/embree/support.h"
#include "renderer/placement/mesh.h"

namespace heliograph::embree {

struct EmbreeMesh final : MeshAccelerator {
  explicit EmbreeMesh(const DeviceMesh& mesh) : view(mesh.view()), strands(mesh.strands) {}
  // Inputs of primitives that are no triangles, computed ray by ray. Whoever traces it has its
  // positions, those at rest, and its triangles.
  kernels::MeshView view;
  std::shared_ptr<const Strands> strands;
  SceneHandle scene;
  Support support;  // of triangles' vertices, at all times; of other shapes there is none
  u64 bytes_ = 0;
  [[nodiscard]] u64 bytes() const override { return bytes_; }
  [[nodiscard]] Box bounds() const override { return bounds_of(scene.get()); }
};

/// Fails with RESOURCE_EXHAUSTED, and as the interrupt does. Thread: any.
[[nodiscard]] Expected<std::shared_ptr<const EmbreeMesh>> build_mesh(const DeviceMesh& mesh,
                                                                     RTCDevice device,
                                                                     const Interrupt& interrupt);

/// Embree's part of a resident mesh.
[[nodiscard]] inline const EmbreeMesh& embree_mesh(const DeviceMesh& mesh) {
  return static_cast<const EmbreeMesh&>(*mesh.accelerator);
}

}  // namespace heliograph::embree
