// A resident scene in device memory.
#pragma once

#include "renderer/backend/cuda/build.h"
#include "renderer/backend/cuda/mirror.h"
#include "renderer/resident/scene.h"

namespace heliograph::cuda {

using namespace resident;

/// Immutable. Holds the scene on the host, too: what the copies were made from.
class CudaScene final : public DeviceScene {
 public:
  /// Uploads what no other scene has yet. Fails with RESOURCE_EXHAUSTED.
  [[nodiscard]] static Expected<std::shared_ptr<const CudaScene>> create(
      std::shared_ptr<const ResidentScene> host, Mirror& mirror, const TreeBuilder& builder);

  [[nodiscard]] const std::shared_ptr<const ResidentScene>& host() const { return host_; }
  /// Pointers are the device's.
  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] const kernels::BvhView& bvh() const { return bvh_; }
  /// SceneView::volumes as the device has them.
  [[nodiscard]] std::span<const kernels::VolumeView> volumes() const { return volumes_; }

 private:
  CudaScene(std::shared_ptr<const ResidentScene> host, Mirror& mirror)
      : host_(std::move(host)), copies_(mirror) {}
  void copy_meshes();
  void copy_materials();
  void copy_lights();
  void copy_dome();
  void copy_volumes();
  [[nodiscard]] std::vector<kernels::MeshBvh> copy_trees(const TreeBuilder& builder);
  void copy_bvh(const TreeBuilder& builder);
  void copy_top(std::span<const kernels::MeshBvh> meshes);

  std::shared_ptr<const ResidentScene> host_;
  Copies copies_;
  kernels::SceneView view_{};
  kernels::BvhView bvh_{};
  std::vector<kernels::MeshView> meshes_;  // as the device has them
  std::vector<kernels::VolumeView> volumes_;
};

}  // namespace heliograph::cuda
