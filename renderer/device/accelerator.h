// Additions of a backend to a resident scene: the structures that its rays go through.
#pragma once

#include <memory>

#include "renderer/base/box.h"
#include "renderer/device/backend.h"

namespace heliograph::resident {

struct DeviceMesh;
class Placement;

/// Structure over one mesh. Who traces it keeps alive the arrays it was made from.
class MeshAccelerator {
 public:
  virtual ~MeshAccelerator() = default;
  [[nodiscard]] virtual u64 bytes() const = 0;
  [[nodiscard]] virtual Box bounds() const = 0;  // object space, at any time
};

/// Structure over all instances of a placement.
class SceneAccelerator {
 public:
  virtual ~SceneAccelerator() = default;
  [[nodiscard]] virtual Box bounds() const = 0;  // world, over the placement's span
  /// Bytes of what static entities have of their own and another of the same backend, or null, does
  /// not share.
  [[nodiscard]] virtual u64 static_bytes_beside(const SceneAccelerator* other) const = 0;
};

/// An earlier placement, and what stays of it in a later one.
struct Kept {
  const Placement* before;  // null: nothing
  /// True if all slots of a chunk of instances are as they were, under the same numbers.
  [[nodiscard]] bool chunk(const Placement& now, u32 chunk) const;
  /// The slot of `before` that shows the same mesh in the same places to the same rays, or kNone.
  [[nodiscard]] u32 slot(const Placement& now, u32 slot) const;
};

/// Thread: any.
class Accelerator {
 public:
  virtual ~Accelerator() = default;
  /// Fails with RESOURCE_EXHAUSTED, and as the interrupt does.
  [[nodiscard]] virtual Expected<std::shared_ptr<const MeshAccelerator>> build(
      const DeviceMesh& mesh, const Interrupt& interrupt) const = 0;
  /// The result does not depend on what was kept. Fails with RESOURCE_EXHAUSTED, and as the
  /// interrupt does.
  [[nodiscard]] virtual Expected<std::shared_ptr<const SceneAccelerator>> build(
      const Snapshot& snapshot, const Placement& placement, const Kept& kept,
      const Interrupt& interrupt) const = 0;
};

}  // namespace heliograph::resident
