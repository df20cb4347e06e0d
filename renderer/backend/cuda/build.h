// Trees over instances and over triangles, built on the device.
#pragma once

#include "renderer/backend/cuda/build_launch.h"
#include "renderer/backend/cuda/context.h"

namespace heliograph::cuda {

/// The instances of a scene as the device has them.
struct BuildInput {
  const kernels::InstanceView* instances;
  const kernels::MotionKey* motion_keys;
  const kernels::MeshBvh* meshes;
  u32 count;                                    // of instances, at least 1
  std::span<const kernels::BvhBox> mesh_boxes;  // the host's; object space, at all times
  const u32* left_out = nullptr;                // a bit for each that the tree is not over; or null
  u32 left_out_count = 0;
  /// A tree over as many instances, most of them where these are; null: there is none.
  const DeviceMemory* before = nullptr;
  /// True if there is a tree.
  [[nodiscard]] bool has_tree() const { return left_out_count < count; }
};

/// A tree over instances as it lies in one piece of device memory.
[[nodiscard]] kernels::BvhView view_of_top(const DeviceMemory& top, const BuildInput& input);

/// The same of a tree over the triangles of a mesh, whose arrays are the device's.
[[nodiscard]] kernels::MeshBvh view_of_mesh(const DeviceMemory& tree,
                                            const kernels::MeshView& mesh);

/// A tree over the same triangles elsewhere.
struct MeshBefore {
  const DeviceMemory* tree = nullptr;  // null: there is none
  kernels::MeshView mesh{};            // whose it is
};

/// Starts the programs that build. Thread: the device's.
class TreeBuilder {
 public:
  [[nodiscard]] static Expected<TreeBuilder> create(std::shared_ptr<Context> context);
  /// The tree is there for what the device does next; nothing waits. That of before is refitted, if
  /// the device finds it good enough. Fails with RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> build(const BuildInput& input) const;

  /// The same over triangles, at least one, of a mesh whose arrays are the device's.
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> build(
      const kernels::MeshView& mesh, const MeshBefore& before = {}) const;

 private:
  /// Input of a kind of tree, and where it begins and ends.
  struct Kind {
    FunctionHandle boxes, items, refit;
    float item_cost;
  };
  explicit TreeBuilder(std::shared_ptr<Context> context) : context_(std::move(context)) {}
  [[nodiscard]] Status launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch) const;
  [[nodiscard]] Status launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch,
                              u32 argument) const;
  [[nodiscard]] Status sort(BuildLaunch& launch) const;
  /// Memory for a build over `count` boxes, and where its parts lie.
  [[nodiscard]] Expected<DeviceMemory> work(u64 count, u64 mesh_boxes, BuildLaunch& launch) const;
  [[nodiscard]] Status run(const Kind& kind, BuildLaunch& launch) const;

  std::shared_ptr<Context> context_;
  FunctionHandle triangle_boxes_ = nullptr, triangles_ = nullptr;
  FunctionHandle boxes_ = nullptr, keys_ = nullptr, leaves_ = nullptr, clusters_ = nullptr,
                 nodes_ = nullptr, items_ = nullptr;
  FunctionHandle refit_items_ = nullptr, refit_triangles_ = nullptr, refit_nodes_ = nullptr;
  FunctionHandle pass_ = nullptr, few_ = nullptr;  // of the sort
  u32 node_blocks_ = 0;                            // of build_nodes that the device runs at once
};

}  // namespace heliograph::cuda
