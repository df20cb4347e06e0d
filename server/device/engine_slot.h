// Starts the engine in the background and renders probe pixels that show that it works.
#pragma once

#include <atomic>
#include <functional>
#include <future>
#include <memory>
#include <thread>

#include "renderer/schedule/engine.h"
#include "server/os/log.h"

namespace heliograph::server {

/// Owns: the engine, and the thread that makes it while the daemon already accepts connections.
/// Thread: any.
class EngineSlot {
 public:
  /// first   called once, from the starting or the device thread, when the first pixel was rendered
  /// or failed
  EngineSlot(EngineOptions options, const Log& log, std::function<void(Status)> first);
  ~EngineSlot();

  /// Waits until the engine is made; call it on the work pool. UNAVAILABLE when it could not be
  /// made.
  [[nodiscard]] Expected<Engine*> wait() const;
  /// Returns the engine; null while it starts.
  [[nodiscard]] const Engine* get() const { return engine_now_; }
  /// Renders one pixel of a scene that is always prepared, as a tenant of its own: it waits for at
  /// most one time slice of other jobs. `done` is called once, from the device thread or the
  /// caller's. Requires get() != null.
  void probe(std::function<void(Status)> done);

 private:
  using ProbeJob = Expected<std::shared_ptr<const RenderJob>>;
  [[nodiscard]] ProbeJob probe_job() const;
  void start(const EngineOptions& options);
  void finish(const Status& status);

  const Log& log_;
  // Keeps the probe's scene resident on the device.
  const std::shared_ptr<const SceneLife> probe_life_ = std::make_shared<const SceneLife>(true);
  const ProbeJob probe_job_ = probe_job();
  const std::function<void(Status)> first_;
  std::unique_ptr<Engine> engine_;
  std::atomic<Engine*> engine_now_ = nullptr;
  std::promise<Expected<Engine*>> promise_;
  std::shared_future<Expected<Engine*>> future_;
  std::atomic<bool> closing_ = false;  // while true, refused work is no fault
  std::thread thread_;
};

/// Returns after how many seconds a running job will probably have made room: the mean duration of
/// a job.
[[nodiscard]] double retry_seconds(const Engine& engine);

}  // namespace heliograph::server
