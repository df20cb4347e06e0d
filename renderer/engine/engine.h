// The renderer as a service in-process: takes jobs from any thread, runs them on its device.
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <stop_token>

#include "renderer/engine/backend.h"
#include "renderer/engine/check.h"

namespace heliograph {

/// Who receives a job's results. Calls come from the device thread, in order, and must not block.
class JobSink {
 public:
  virtual ~JobSink() = default;
  virtual void progress(const Progress& progress) = 0;
  virtual void frame(std::shared_ptr<const Frame> frame) = 0;  // several a camera when progressive
  /// The last call. CANCELLED, DEADLINE_EXCEEDED, or what went wrong.
  virtual void done(Status status) = 0;
};

struct EngineOptions {
  std::string backend = "embree";
  BackendOptions device;
  std::string denoiser = "libOpenImageDenoise.so.2";  // or a path, or "off"
  JobLimits limits;
  std::chrono::milliseconds slice{
      10};  // the longest the device runs without asking whether to stop
};

/// Owns: a backend, its device thread, and one that makes derived data. Thread: any. Jobs run one
/// at a time in the order in which their derived data is ready, in slices; a cancelled or expired
/// job, queued or running, ends within a slice.
class Engine {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<Engine>> create(const EngineOptions& options);
  ~Engine();  // cancels what runs, answers what waits with UNAVAILABLE

  /// Checks the job against its snapshot (cameras, size, flow) and queues it. The sink lives until
  /// done().
  [[nodiscard]] Status submit(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
                              std::stop_token stop);
  /// Queues a query; `done` is called once, from the device thread.
  void submit(std::shared_ptr<const QueryJob> query,
              std::function<void(Expected<QueryResult>)> done, std::stop_token stop);

  [[nodiscard]] std::string_view backend_name() const;
  [[nodiscard]] std::string cpu_features() const;
  [[nodiscard]] u64 derived_bytes() const;
  [[nodiscard]] u32 queued() const;

 private:
  class Impl;
  explicit Engine(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace heliograph
