// A snapshot in a span of time, resident: pieces that scenes share, and the view kernels read.
#pragma once

#include <atomic>
#include <mutex>

#include "renderer/engine/backend.h"
#include "renderer/resident/lights.h"
#include "renderer/resident/volumes.h"

namespace heliograph::resident {

/// Immutable. Each piece is a pure function of parts of the snapshot and is shared with the scenes
/// that have the same parts.
struct ScenePieces {
  std::shared_ptr<const Placement> placement;
  std::shared_ptr<const Volumes> volumes;
  std::shared_ptr<const Materials> materials;
  std::shared_ptr<const Lights> lights;
};
class ResidentScene final : public DeviceScene {
 public:
  ResidentScene(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span, ScenePieces pieces);

  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] const Snapshot& snapshot() const { return *snapshot_; }
  [[nodiscard]] const TimeSpan& span() const { return span_; }
  [[nodiscard]] const Placement& placement() const { return *pieces_.placement; }
  [[nodiscard]] const Structure& structure() const { return *pieces_.placement->structure; }
  [[nodiscard]] const Lights& lights() const { return *pieces_.lights; }
  [[nodiscard]] u64 bytes() const;  // of its own, what it shares not counted

  [[nodiscard]] const ScenePieces& pieces() const { return pieces_; }

 private:
  std::shared_ptr<const Snapshot> snapshot_;
  TimeSpan span_;
  ScenePieces pieces_;
  std::vector<kernels::InstanceView> instances_;  // the placement's, with flags of the materials
  std::vector<kernels::MeshView> meshes_;
  std::vector<kernels::VolumeView> volumes_;  // the pieces', with their light groups
  std::vector<kernels::CasterView> casters_;
  std::vector<kernels::CastLightView> cast_lights_;
  kernels::SceneView view_{};
};

/// Makes scenes, and keeps the last ones to start from. Thread: any.
class SceneStore {
 public:
  /// cache_bytes   of the scenes kept
  SceneStore(const Accelerator& accelerator, DerivedCache& cache, u64 cache_bytes)
      : accelerator_(accelerator),
        cache_(cache),
        builder_(accelerator, cache),
        limit_(cache_bytes) {}

  [[nodiscard]] Expected<std::shared_ptr<const ResidentScene>> prepare(
      const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
      const Interrupt& interrupt);
  /// The same of several at once, in their order. Only the last is kept to start from.
  [[nodiscard]] Expected<DeviceScenes> prepare_all(std::span<const SceneAt> scenes,
                                                   const Interrupt& interrupt);
  /// Whether prepare() would find the derived data of meshes and dome made.
  [[nodiscard]] bool ready(const Snapshot& snapshot) const;
  /// Makes that data.
  [[nodiscard]] Status warm(const Snapshot& snapshot) const;
  /// Thread: any.
  [[nodiscard]] u64 bytes() const { return bytes_.load(std::memory_order_relaxed); }

 private:
  [[nodiscard]] std::shared_ptr<const ResidentScene> nearest(const Snapshot& snapshot,
                                                             const TimeSpan& span) const;
  /// A scene, from one like it: it may be that one. Thread: any.
  [[nodiscard]] Expected<std::shared_ptr<const ResidentScene>> make(
      const SceneAt& scene, const std::shared_ptr<const ResidentScene>& before,
      const Interrupt& interrupt) const;
  void keep(std::shared_ptr<const ResidentScene> scene);

  const Accelerator& accelerator_;
  DerivedCache& cache_;
  const MeshBuilder builder_;
  const u64 limit_;
  mutable std::mutex mutex_;
  std::vector<std::shared_ptr<const ResidentScene>> recent_;  // the last is the latest; by mutex_
  std::atomic<u64> bytes_{0};
};

}  // namespace heliograph::resident
