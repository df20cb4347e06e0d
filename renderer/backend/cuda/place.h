// Instances, made on the device.
#pragma once

#include "renderer/backend/cuda/context.h"
#include "renderer/backend/cuda/place_launch.h"

namespace heliograph::cuda {

/// Starts the program that makes them. Thread: the device's.
class InstancePlacer {
 public:
  [[nodiscard]] static Expected<InstancePlacer> create(std::shared_ptr<Context> context);
  /// The instances are there for what the device does next; nothing waits.
  [[nodiscard]] Status place(PlaceLaunch launch) const;

 private:
  InstancePlacer(std::shared_ptr<Context> context, FunctionHandle program)
      : context_(std::move(context)), program_(program) {}

  std::shared_ptr<Context> context_;
  FunctionHandle program_;
};

}  // namespace heliograph::cuda
