// A scene on its way to the device: what takes long is made elsewhere. Used by jobs and queries.
#pragma once

#include <optional>

#include "renderer/device/backend.h"

namespace heliograph {

/// Thread: the device's, but for the errands. Lifetime: of the backend, and until its errands ran.
class Preparer {
 public:
  Preparer(Backend& backend, SceneAt scene, const Interrupt& interrupt)
      : backend_(backend), scene_(std::move(scene)), interrupt_(interrupt) {}
  Preparer(const Preparer&) = delete;
  Preparer& operator=(const Preparer&) = delete;

  /// Errands to do before the next call; none: take() is quick.
  [[nodiscard]] std::vector<Errand> next();
  [[nodiscard]] Expected<std::shared_ptr<const DeviceScene>> take();

 private:
  Backend& backend_;
  const SceneAt scene_;
  const Interrupt& interrupt_;
  std::optional<double> seconds_;  // of all but pieces, once they are known
  std::optional<Expected<DeviceScenes>> made_;
};

}  // namespace heliograph
