// Trees over instances, built on the device.
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
};

/// A tree over instances as it lies in one piece of device memory.
[[nodiscard]] kernels::BvhView view_of_top(const DeviceMemory& top, const BuildInput& input);

/// Starts the programs that build. Thread: the device's.
class TopBuilder {
 public:
  [[nodiscard]] static Expected<TopBuilder> create(std::shared_ptr<Context> context);
  /// The tree is there for what the device does next; nothing waits. Fails with RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> build(const BuildInput& input) const;

 private:
  explicit TopBuilder(std::shared_ptr<Context> context) : context_(std::move(context)) {}
  [[nodiscard]] Status launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch) const;
  [[nodiscard]] Status launch(FunctionHandle program, LaunchSize size, BuildLaunch& launch,
                              u32 argument) const;
  [[nodiscard]] Status sort(BuildLaunch& launch) const;
  [[nodiscard]] Status run(BuildLaunch& launch) const;

  std::shared_ptr<Context> context_;
  FunctionHandle boxes_ = nullptr, keys_ = nullptr, leaves_ = nullptr, clusters_ = nullptr,
                 level_ = nullptr, items_ = nullptr;
  FunctionHandle count_ = nullptr, scan_ = nullptr, move_ = nullptr;  // of the sort
};

}  // namespace heliograph::cuda
