// A snapshot in a span of time, resident: pieces that scenes share, and the view kernels read.
#pragma once

#include <atomic>
#include <mutex>

#include "renderer/engine/backend.h"
#include "renderer/resident/flat_rows.h"
#include "renderer/resident/lights.h"
#include "renderer/resident/volumes.h"

namespace heliograph::resident {

/// Immutable. Each piece is a pure function of parts of the snapshot and is shared with the scenes
/// that have the same parts.
struct ScenePieces {
  std::shared_ptr<const Placement> placement;
  std::shared_ptr<const Volumes> volumes;
  std::shared_ptr<const Materials> materials;
  std::shared_ptr<const Surfaces> surfaces;
  std::shared_ptr<const Lights> lights;
};

/// All of a scene but the array of its instances. Immutable.
class SceneState {
 public:
  SceneState(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span, ScenePieces pieces);

  /// Its instances are null.
  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] const Snapshot& snapshot() const { return *snapshot_; }
  [[nodiscard]] const TimeSpan& span() const { return span_; }
  [[nodiscard]] const ScenePieces& pieces() const { return pieces_; }
  [[nodiscard]] const Placement& placement() const { return *pieces_.placement; }
  /// What it has and another, or null, does not share.
  [[nodiscard]] u64 bytes_beside(const SceneState* other) const;

 private:
  std::shared_ptr<const Snapshot> snapshot_;
  TimeSpan span_;
  ScenePieces pieces_;
  std::vector<kernels::MeshView> meshes_;
  std::vector<kernels::VolumeView> volumes_;  // the pieces', with their light groups
  std::vector<kernels::CasterView> casters_;
  std::vector<kernels::CastLightView> cast_lights_;
  kernels::SceneView view_{};
};

/// A scene while it is used. Immutable.
class ResidentScene final : public DeviceScene {
 public:
  /// flat   makes the array of instances
  ResidentScene(std::shared_ptr<const SceneState> state,
                const FlatRows<kernels::InstanceView>& flat, const MeshBuilder& builder)
      : state_(std::move(state)), flat_(flat), builder_(builder) {}

  /// What the kernels read on the host: it has the array of instances from when it is first asked
  /// for. Thread: any.
  [[nodiscard]] const kernels::SceneView& view() const;
  /// The same where somebody else has that array: its instances are null.
  [[nodiscard]] const kernels::SceneView& view_elsewhere() const { return state_->view(); }
  [[nodiscard]] const Snapshot& snapshot() const { return state_->snapshot(); }
  [[nodiscard]] const TimeSpan& span() const { return state_->span(); }
  [[nodiscard]] const ScenePieces& pieces() const { return state_->pieces(); }
  [[nodiscard]] const Placement& placement() const { return *pieces().placement; }
  [[nodiscard]] const Structure& structure() const { return *placement().structure; }
  [[nodiscard]] const Lights& lights() const { return *pieces().lights; }
  /// Fails as the interrupt says. Thread: any, while the store is there.
  [[nodiscard]] Expected<const LabelFrames*> labels(const Interrupt& interrupt) const {
    return placement().labels(snapshot(), builder_, interrupt);
  }
  /// ProbeContext::rest_boxes. Likewise.
  [[nodiscard]] Expected<std::span<const kernels::RestBoxView>> rest_boxes(
      const Interrupt& interrupt) const;

 private:
  const std::shared_ptr<const SceneState> state_;
  const FlatRows<kernels::InstanceView> flat_;
  const MeshBuilder& builder_;
  Lazy<std::vector<kernels::RestBoxView>> rest_boxes_;
  mutable std::once_flag made_;
  mutable std::shared_ptr<const kernels::InstanceView> instances_;
  mutable kernels::SceneView view_{};
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
  /// Frees a scene that is used no more, if that is so, while the next one is made: tables of many
  /// objects take a millisecond.
  void free_later(std::shared_ptr<const ResidentScene> scene);
  /// Whether prepare() would find the derived data of meshes and dome made.
  [[nodiscard]] bool ready(const Snapshot& snapshot) const;
  /// Makes that data.
  [[nodiscard]] Status warm(const Snapshot& snapshot) const;
  /// Thread: any.
  [[nodiscard]] u64 bytes() const { return bytes_.load(std::memory_order_relaxed) + flat_.bytes(); }

 private:
  using State = std::shared_ptr<const SceneState>;
  struct Recent {
    State state;
    std::weak_ptr<const ResidentScene> scene;  // of it, if it is used
  };
  [[nodiscard]] State nearest(const Snapshot& snapshot, const TimeSpan& span) const;
  /// A state, from one like it or null: it may be that one. Thread: any.
  [[nodiscard]] Expected<State> make(const SceneAt& wanted, const State& before,
                                     const Interrupt& interrupt) const;
  [[nodiscard]] Expected<std::shared_ptr<const Structure>> structure_of(const Snapshot& snapshot,
                                                                        const State& before) const;
  /// Frees what was left to it. Where no more may be kept, drops the oldest but `used`.
  void make_room(const State& used);
  /// The scene of a state, which is kept if it is new.
  [[nodiscard]] std::shared_ptr<const ResidentScene> scene_of(const State& state);

  const Accelerator& accelerator_;
  DerivedCache& cache_;
  const MeshBuilder builder_;
  const u64 limit_;
  FlatRows<kernels::InstanceView> flat_;
  mutable std::mutex mutex_;
  std::vector<Recent> recent_;                              // the last is the latest; by mutex_
  std::vector<std::shared_ptr<const ResidentScene>> gone_;  // by mutex_
  std::atomic<u64> bytes_{0};
};

}  // namespace heliograph::resident
