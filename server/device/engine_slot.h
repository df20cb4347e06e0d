// The engine while it starts, and the pixel that shows that it renders.
#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <thread>

#include "renderer/schedule/engine.h"
#include "server/os/log.h"

namespace heliograph::server {

/// Owns: the engine, and the thread that makes it while the daemon already takes connections.
/// Thread: any.
class EngineSlot {
 public:
  /// `first` is called once, from the starting or the device thread, when the first pixel is there
  /// or is known not to come.
  EngineSlot(EngineOptions options, const Log& log, std::function<void(Status)> first);
  ~EngineSlot();

  /// Waits for the engine, so call it on the work pool. UNAVAILABLE when it could not be made.
  [[nodiscard]] Expected<Engine*> wait() const;
  /// Null while it starts.
  [[nodiscard]] const Engine* get() const { return engine_now_; }
  /// Renders one pixel of a scene that is always prepared, as a tenant of its own: it waits for a
  /// slice of others at most. `done` is called once, from the device thread or
  /// from here. Only when get() gives an engine.
  void probe(std::function<void(Status)> done);

 private:
  using ProbeJob = Expected<std::shared_ptr<const RenderJob>>;
  [[nodiscard]] ProbeJob probe_job() const;
  void start(const EngineOptions& options);
  void finish(const Status& status);

  const Log& log_;
  // What the device has of the probe's scene stays there.
  const std::shared_ptr<const SceneLife> probe_life_ = std::make_shared<const SceneLife>(true);
  const ProbeJob probe_job_ = probe_job();
  const std::function<void(Status)> first_;
  std::unique_ptr<Engine> engine_;
  std::atomic<Engine*> engine_now_ = nullptr;
  std::promise<Expected<Engine*>> promise_;
  std::shared_future<Expected<Engine*>> future_;
  std::atomic<bool> closing_ = false;  // then work that is refused is no fault
  std::thread thread_;
};

/// When a job that runs will have made room: the seconds a job takes.
[[nodiscard]] double retry_seconds(const Engine& engine);

}  // namespace heliograph::server
