// A resident scene in device memory.
#pragma once

#include "renderer/backend/cuda/build.h"
#include "renderer/backend/cuda/mirror.h"
#include "renderer/backend/cuda/place.h"
#include "renderer/backend/cuda/recent.h"
#include "renderer/resident/scene.h"

namespace heliograph::cuda {

using namespace resident;

/// The meshes of a placement with the trees over them.
struct MeshCopies {
  explicit MeshCopies(Mirror& mirror) : copies(mirror) {}
  std::vector<std::shared_ptr<const DeviceMesh>> of;
  Copies copies;
  std::vector<kernels::MeshView> views;    // as the device has them
  std::vector<kernels::MeshBvh> trees;     // the same
  std::vector<const DeviceMemory*> built;  // those that the device has built; null: others
  const kernels::MeshView* view_table = nullptr;
  const kernels::MeshBvh* tree_table = nullptr;
};

/// Materials and textures.
struct MaterialCopies {
  explicit MaterialCopies(Mirror& mirror) : copies(mirror) {}
  std::shared_ptr<const Materials> of;
  Copies copies;
  const kernels::TextureView* textures = nullptr;
  const kernels::MaterialView* materials = nullptr;
  const kernels::TextureUseView* uses = nullptr;
};

class CudaScene;

/// Tools for making copies.
struct CopyContext {
  Mirror& mirror;
  const TreeBuilder& builder;
  const InstancePlacer& placer;
  Recent<CudaScene>& others;                 // may have some of them
  std::shared_ptr<const CudaScene> sibling;  // may, too; null: none is there
  /// Takes what is of one scene alone, and is to be finished before that is used. It may live
  /// longer than the scene, so no array of the host is known by it.
  std::shared_ptr<Copies> own;
};

/// Immutable. Holds the scene on the host, too: what the copies were made from.
class CudaScene final : public DeviceScene {
 public:
  /// Uploads what no other scene has yet. Fails with RESOURCE_EXHAUSTED.
  [[nodiscard]] static Expected<std::shared_ptr<const CudaScene>> create(
      std::shared_ptr<const ResidentScene> host, const CopyContext& context);
  /// Makes what create() needs of the host alone. Thread: any.
  static void make_host_trees(const ResidentScene& host);

  [[nodiscard]] SceneSummary summary() const override { return host_->summary(); }
  [[nodiscard]] const std::shared_ptr<const ResidentScene>& host() const { return host_; }
  /// Pointers are the device's.
  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] const kernels::BvhView& bvh() const { return bvh_; }
  /// SceneView::volumes as the device has them.
  [[nodiscard]] std::span<const kernels::VolumeView> volumes() const { return volumes_; }

 private:
  CudaScene(std::shared_ptr<const ResidentScene> host, const CopyContext& context)
      : host_(std::move(host)), own_(context.own), copies_(context.mirror) {}
  [[nodiscard]] Status find_meshes(const CopyContext& context);
  [[nodiscard]] Status find_materials(const CopyContext& context);
  /// like   another one with the same entities; null: there is none
  [[nodiscard]] Status copy_instances(const InstancePlacer& placer, const CudaScene* like);
  void copy_lights();
  void copy_dome();
  void copy_volumes();
  void copy_bvh(const TreeBuilder& builder, const CudaScene* like);
  [[nodiscard]] kernels::BvhView built_top(const TreeBuilder& builder, const CudaScene* like);
  [[nodiscard]] kernels::BvhView copy_top();

  std::shared_ptr<const ResidentScene> host_;
  const std::shared_ptr<Copies> own_;  // of what nobody else may have
  Copies copies_;                      // of the host's arrays, which live as long as this does
  kernels::SceneView view_{};
  kernels::BvhView bvh_{};
  // Slots that the device made instances of; null: the host did.
  const kernels::SlotView* slots_ = nullptr;
  const mat4x3* world_ = nullptr;
  const DeviceMemory* top_ = nullptr;  // a tree that the device built; null: there is none
  std::shared_ptr<const MeshCopies> meshes_;
  std::shared_ptr<const MaterialCopies> materials_;
  std::vector<kernels::VolumeView> volumes_;
};

}  // namespace heliograph::cuda
