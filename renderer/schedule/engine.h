// The renderer as a service in-process: takes jobs from any thread, runs them on its device.
#pragma once

#include <functional>
#include <future>
#include <memory>
#include <stop_token>

#include "renderer/device/backend.h"
#include "renderer/frame/check.h"

namespace heliograph {

/// Cost of a job.
struct Spent {
  u64 samples = 0;            // of all pixels; a centre plane's ray counts as one
  u64 rays = 0;               // of the cameras that were done
  double seconds = 0;         // of the devices
  double helper_seconds = 0;  // of them, of devices that helped the one that had the job
  double waited_seconds =
      0;                     // from submit() until the device first had it, or until it was refused
  double aside_seconds = 0;  // away from the device: derived data, scenes, planes made of others
};

/// Receiver of a job's results. Calls come in order, one at a time, from the thread of the job's
/// device or from a worker, and must not block.
class JobSink {
 public:
  virtual ~JobSink() = default;
  virtual void progress(const Progress& progress) = 0;
  virtual void frame(std::shared_ptr<const Frame> frame) = 0;  // several a camera when progressive
  /// The last call. CANCELLED, DEADLINE_EXCEEDED, or what went wrong.
  virtual void done(Status status, const Spent& spent) = 0;
};

struct EngineOptions {
  std::string backend = "embree";
  u32 devices = 0;  // of its kind, the first ones; 0: all that are there
  BackendOptions device;
  JobLimits limits;
  std::chrono::milliseconds slice{10};  // how long a job has the device where others wait
  double credit = 0.5;    // seconds of the device that one may be served ahead of the others
  double turn = 0.05;     // seconds of the device that one goes on for among equals
  double little = 0.002;  // seconds of the device: a job that had less may be short
  /// Samples of all pixels of a picture: one that takes as many is rendered by all idle devices.
  u64 spread_samples = 16'000'000;
};

/// Work that waits and runs.
struct Load {
  u32 jobs = 0;
  double seconds_a_job = 0;  // of the device, a moving mean
  double still_seconds = 0;  // how long a slice that runs now has taken; 0: none runs
  bool is_lost = false;      // every device was lost and is not back yet
  u32 losses = 0;            // of devices, since the engine was made
  std::string lost_because;  // what the last attempt to have a lost one again failed with
  /// Every device was lost, and none comes back in this process.
  bool needs_new_process = false;
};

/// Owns: a backend and a thread for each device, and the workers beside them. Thread: any.
/// Jobs share the devices by their origins, slice by slice (fair_queue.h), each on the device that
/// began it, with the help of idle ones (spread.h); a cancelled or expired job, waiting or running,
/// ends within a slice. Jobs of one session may end in another order. Pictures do not depend on the
/// device.
///
/// Long work that needs no device is done by the workers (workers.h), while the device has other
/// jobs: derived data and scenes before a job, labels and planes of large pictures after it.
///
/// Work that cannot be left half way is one slice, however long: a query or labels on a GPU.
///
/// When a backend reports its device as lost, work that had begun there ends with UNAVAILABLE, a
/// new backend is made, as often as it takes, and what waits goes on: all of it is in its
/// snapshots. Where that cannot work in this process it is not tried again.
class Engine {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<Engine>> create(const EngineOptions& options);
  ~Engine();  // cancels what runs, answers what waits with UNAVAILABLE

  /// Checks the job against its snapshot (cameras, size, flow) and queues it. The sink lives until
  /// done(). FAILED_PRECONDITION when it is on_device and the backend has no such memory.
  [[nodiscard]] Status submit(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
                              std::stop_token stop);
  /// Queues a query; `done` is called once, from a device's thread.
  void submit(std::shared_ptr<const QueryJob> query,
              std::function<void(Expected<QueryResult>)> done, std::stop_token stop);

  [[nodiscard]] std::string_view backend_name() const;
  [[nodiscard]] std::string cpu_features() const;
  [[nodiscard]] u32 devices() const;
  [[nodiscard]] u64 derived_bytes() const;
  [[nodiscard]] u64 scenes_made_again() const;  // Backend::scenes_made_again()
  [[nodiscard]] u64 uploaded_bytes() const;     // Backend::uploaded_bytes()
  [[nodiscard]] MemoryUse memory() const;       // of all devices
  [[nodiscard]] Load load() const;
  /// Backend::shared_memory() of the device as it is now: another one after a loss.
  [[nodiscard]] std::shared_ptr<SharedMemorySource> shared_memory() const;

 private:
  class Impl;
  explicit Engine(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace heliograph
