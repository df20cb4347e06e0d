// Scenes while they are used, and who makes and keeps them.
#pragma once

#include <atomic>
#include <mutex>

#include "renderer/derived/flat_rows.h"
#include "renderer/device/backend.h"
#include "renderer/resident/kept_scenes.h"

namespace heliograph::resident {

/// A scene while it is used. Immutable.
class ResidentScene final : public DeviceScene {
 public:
  /// flat   makes the array of instances
  ResidentScene(std::shared_ptr<const SceneState> state,
                const FlatRows<kernels::InstanceView>& flat, const MeshBuilder& builder)
      : state_(std::move(state)), flat_(flat), builder_(builder) {}

  /// View that the kernels read on the host: it has the array of instances once it is first asked
  /// for. Thread: any.
  [[nodiscard]] const kernels::SceneView& view() const;
  /// The same where somebody else has that array: its instances are null.
  [[nodiscard]] const kernels::SceneView& view_without_instances() const { return state_->view(); }
  [[nodiscard]] const Snapshot& snapshot() const { return state_->snapshot(); }
  [[nodiscard]] const TimeSpan& span() const { return state_->span(); }
  [[nodiscard]] const ScenePieces& pieces() const { return state_->pieces(); }
  [[nodiscard]] const Placement& placement() const { return *pieces().placement; }
  [[nodiscard]] const Structure& structure() const { return *placement().structure; }
  [[nodiscard]] const Lights& lights() const { return *pieces().lights; }
  [[nodiscard]] SceneSummary summary() const override;
  /// Fails as the interrupt does. Thread: any, while the store is there.
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

/// Makes scenes, and keeps those used last to start from. Thread: any.
class SceneStore {
 public:
  enum class Copies : u8 { kNever, kOfEach };
  /// cache_bytes   of the scenes kept and of derived data
  /// copies        whether the device keeps a copy of each scene, which holds it
  SceneStore(const Accelerator& accelerator, DerivedCache& cache, u64 cache_bytes,
             Copies copies = Copies::kNever)
      : accelerator_(accelerator),
        cache_(cache),
        builder_(accelerator, cache),
        limit_(cache_bytes),
        kept_(copies == Copies::kOfEach ? 1 : 0) {}

  [[nodiscard]] Expected<std::shared_ptr<const ResidentScene>> prepare(
      const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
      const Interrupt& interrupt);
  /// The same of several at once, in their order. Only the last is kept to start from.
  [[nodiscard]] Expected<DeviceScenes> prepare_all(std::span<const SceneAt> scenes,
                                                   const Interrupt& interrupt);
  /// Frees a scene that is used no more, if that is so, while the next one is made: tables of many
  /// objects take a millisecond.
  void free_later(std::shared_ptr<const ResidentScene> scene);
  /// True if it is kept; if not, let_go() will never name it.
  [[nodiscard]] bool keeps(const ResidentScene& scene) const;
  /// Scenes that were dropped since the last call and are still held: drop their copies.
  [[nodiscard]] std::vector<std::shared_ptr<const ResidentScene>> let_go();
  /// Returns what prepare() would have to make.
  [[nodiscard]] Preparation preparation(const SceneAt& wanted) const;
  [[nodiscard]] u64 bytes() const { return bytes_.load(std::memory_order_relaxed) + flat_.bytes(); }
  /// Scenes that were made again, as there had been no room to keep them.
  [[nodiscard]] u64 made_again() const { return made_again_.load(std::memory_order_relaxed); }

 private:
  using State = KeptScenes::State;
  /// A state, from one like it or null: it may be that one. Thread: any.
  [[nodiscard]] Expected<State> make(const SceneAt& wanted, const State& before,
                                     const Interrupt& interrupt) const;
  [[nodiscard]] Expected<std::shared_ptr<const Structure>> structure_of(const Snapshot& snapshot,
                                                                        const State& before) const;
  /// Frees what was left to it, and what is of scenes that are gone.
  void free_dead();
  /// Drops what nobody uses until all that is kept has room.
  void make_room();
  /// The scene of a state, which is kept if it is new.
  [[nodiscard]] std::shared_ptr<const ResidentScene> scene_of(const State& state);

  const Accelerator& accelerator_;
  DerivedCache& cache_;
  const MeshBuilder builder_;
  const u64 limit_;
  FlatRows<kernels::InstanceView> flat_;
  mutable std::mutex mutex_;
  KeptScenes kept_;                                         // by mutex_
  KeptScenes::Dropped dropped_;                             // the same
  std::vector<std::shared_ptr<const ResidentScene>> gone_;  // the same
  std::atomic<u64> bytes_{0}, made_again_{0};
};

}  // namespace heliograph::resident
