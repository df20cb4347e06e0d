// The half of a backend that every device has on the host: threads, and the store of its scenes.
#pragma once

#include "renderer/base/parallel.h"
#include "renderer/device/accelerator.h"
#include "renderer/resident/scene.h"

namespace heliograph::host {

class HostBackend : public Backend {
 public:
  void run(const std::function<void()>& f) override { run_in(arena_, f); }
  [[nodiscard]] Preparation preparation(const SceneAt& scene) const override {
    return store_.preparation(scene);
  }
  [[nodiscard]] Expected<DeviceScenes> prepare(std::span<const SceneAt> scenes,
                                               const Interrupt& interrupt) override {
    return store_.prepare_all(scenes, interrupt);
  }
  [[nodiscard]] DeviceUse use() const override {
    return {.derived_bytes = cache_.bytes() + store_.bytes(),
            .scenes_made_again = store_.made_again()};
  }

 protected:
  /// accelerator   kept until all else is gone
  HostBackend(std::shared_ptr<const resident::Accelerator> accelerator,
              const BackendOptions& options, resident::SceneStore::Copies copies)
      : accelerator_(std::move(accelerator)),
        cache_(options.cache_bytes),
        store_(*accelerator_, cache_, options.cache_bytes, copies),
        arena_(options.threads ? int(options.threads) : tbb::task_arena::automatic, 1,
               tbb::task_arena::priority::high) {}

  [[nodiscard]] resident::SceneStore& store() { return store_; }
  [[nodiscard]] tbb::task_arena& arena() { return arena_; }

 private:
  const std::shared_ptr<const resident::Accelerator> accelerator_;
  resident::DerivedCache cache_;
  resident::SceneStore store_;
  tbb::task_arena arena_;
};

}  // namespace heliograph::host
