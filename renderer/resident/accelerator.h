// What a backend adds to a resident scene: the structures that its rays go through.
#pragma once

#include <memory>
#include <span>

#include "renderer/engine/backend.h"
#include "renderer/resident/box.h"

namespace heliograph::resident {

struct DeviceMesh;
struct Placement;

/// Of one mesh. Who traces it keeps alive the arrays it was made from.
class MeshAccelerator {
 public:
  virtual ~MeshAccelerator() = default;
  [[nodiscard]] virtual u64 bytes() const = 0;
  [[nodiscard]] virtual Box bounds() const = 0;  // object space, at any time
};

/// Of all instances of a placement.
class SceneAccelerator {
 public:
  virtual ~SceneAccelerator() = default;
  [[nodiscard]] virtual Box bounds() const = 0;  // world, over the placement's span
};

/// An earlier placement and what stays of it.
struct Kept {
  const Placement* before;     // null: nothing
  std::span<const u32> slots;  // by slot: the one of `before` that shows the same mesh in the same
                               // places to the same rays, or kNone
};

/// Thread: any.
class Accelerator {
 public:
  virtual ~Accelerator() = default;
  /// Fails with RESOURCE_EXHAUSTED.
  [[nodiscard]] virtual Expected<std::shared_ptr<const MeshAccelerator>> build(
      const DeviceMesh& mesh) const = 0;
  /// The result does not depend on what was kept. Fails with RESOURCE_EXHAUSTED, and as the
  /// interrupt says.
  [[nodiscard]] virtual Expected<std::shared_ptr<const SceneAccelerator>> build(
      const Snapshot& snapshot, const Placement& placement, const Kept& kept,
      const Interrupt& interrupt) const = 0;
};

}  // namespace heliograph::resident
