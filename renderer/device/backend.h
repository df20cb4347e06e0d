// What a device must do. Calls come from the one thread that owns the device, unless they say so.
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "renderer/base/error.h"
#include "renderer/device/errand.h"
#include "renderer/frame/frame.h"
#include "renderer/frame/interrupt.h"
#include "renderer/frame/query.h"
#include "renderer/frame/remarks.h"
#include "renderer/frame/shared_memory.h"
#include "renderer/scene/motion.h"

namespace heliograph {

/// A snapshot in a span of time, resident on the device. Immutable while anybody holds it.
class DeviceScene {
 public:
  virtual ~DeviceScene() = default;
  /// Valid as long as the scene.
  [[nodiscard]] virtual SceneSummary summary() const = 0;
};

/// What is to be resident.
struct SceneAt {
  std::shared_ptr<const Snapshot> snapshot;
  TimeSpan span;
};
using DeviceScenes = std::vector<std::shared_ptr<const DeviceScene>>;

/// One picture: a camera of a job. Scenes that no plane needs are null.
struct Shot {
  std::shared_ptr<const RenderJob> job;
  u32 camera = 0;                               // index into job->cameras
  std::shared_ptr<const DeviceScene> open;      // while the shutter is open: what samples see
  std::shared_ptr<const DeviceScene> still;     // at the label time: labels, and beauty_still
  std::shared_ptr<const DeviceScene> forward;   // a frame_interval later than `still`
  std::shared_ptr<const DeviceScene> backward;  // a frame_interval earlier
};

/// A part of a film's work. Pixels are in row-major order of 16x16 tiles, and the tiles of a
/// picture follow those of the one before.
struct WorkRange {
  u32 first_tile = 0;
  u32 tile_count = 0;
  u32 first_sample = 0;  // a multiple of 16 unless it continues within a block
  u32 sample_count = 0;
};

/// Tiles of one picture, in whole rows of them.
struct TileRun {
  u32 first = 0;
  u32 count = 0;
};

/// What the samples of a run have added up to: the film's sums of these pixels, array after array.
struct FilmPart {
  TileRun tiles;
  u32 samples = 0;     // that each tile has
  u64 rays = 0;        // traced for them
  double seconds = 0;  // of the device that traced them
  std::vector<std::byte> sums;
};

/// Jobs that wait for a device. Thread: any.
struct WaitingJobs {
  std::atomic<u32> all = 0;
  std::atomic<u32> fresh = 0;  // those that may be short, one for each scene
};

/// How long a job has a device.
struct Slice {
  TimePoint soon;                        // where a fresh job waits
  TimePoint end;                         // where another one waits
  TimePoint last;                        // where nobody does
  const WaitingJobs* waiting = nullptr;  // null: there may always be some that are not fresh

  /// As it looks now.
  [[nodiscard]] TimePoint ends() const {
    if (!waiting) return end;
    if (waiting->fresh.load(std::memory_order_relaxed) > 0) return soon;
    return waiting->all.load(std::memory_order_relaxed) > 0 ? end : last;
  }
  [[nodiscard]] bool is_over() const { return std::chrono::steady_clock::now() >= ends(); }
};

/// Mean relative standard errors of the pixels' luminance.
struct Noise {
  double mean = std::numeric_limits<double>::quiet_NaN();  // over the image
  std::vector<float> tiles;
};

/// Bytes of a device's own memory. Zeros: it works in the host's.
struct MemoryUse {
  u64 used = 0;
  u64 budget = 0;
};

/// The accumulating images of one shot or of several.
class Film {
 public:
  virtual ~Film() = default;
  [[nodiscard]] virtual u32 tiles() const = 0;            // of all pictures
  [[nodiscard]] virtual u32 tiles_across() const = 0;     // of one
  [[nodiscard]] virtual u32 samples(u32 tile) const = 0;  // taken so far
  [[nodiscard]] virtual u64 rays() const = 0;             // traced so far
  /// Share of the range that was left half way, as far as the device tells; 0 where none was.
  [[nodiscard]] virtual double share_of_range() const { return 0; }
};

class Backend {
 public:
  virtual ~Backend() = default;
  [[nodiscard]] virtual std::string_view name() const = 0;
  /// Feature level of the kernels and of the ray tracer, for the manifest: "x86-64-v3,
  /// embree 3.13.5 AVX2".
  [[nodiscard]] virtual std::string cpu_features() const = 0;

  /// What prepare() would have to make. Quick. Thread: any.
  [[nodiscard]] virtual Preparation preparation(const SceneAt& scene) const {
    (void)scene;
    return {};
  }
  /// The same as prepare_all(), by the threads of the caller's arena. Thread: any but the device's.
  [[nodiscard]] virtual Expected<DeviceScenes> prepare_elsewhere(std::span<const SceneAt> scenes,
                                                                 const Interrupt& interrupt) {
    return prepare_all(scenes, interrupt);
  }
  /// Uploads what changed against the nearest resident scene; derived data is cached by buffer
  /// serial.
  [[nodiscard]] virtual Expected<std::shared_ptr<const DeviceScene>> prepare(
      const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
      const Interrupt& interrupt) = 0;
  /// The same of several, in their order. Thread: any, where pictures_at_once() is above 1.
  [[nodiscard]] virtual Expected<DeviceScenes> prepare_all(std::span<const SceneAt> scenes,
                                                           const Interrupt& interrupt) {
    DeviceScenes made;
    for (const SceneAt& scene : scenes) {
      auto next = prepare(scene.snapshot, scene.span, interrupt);
      if (!next) return std::unexpected(std::move(next).error());
      made.push_back(*std::move(next));
    }
    return made;
  }
  /// f(i) for each i below `count`, in any order, by the threads that the backend has on the host.
  /// Thread: as prepare_all().
  virtual void for_each(u32 count, const std::function<void(u32)>& f) {
    for (u32 i = 0; i < count; ++i) f(i);
  }
  /// How many pictures of so many pixels one film may have.
  [[nodiscard]] virtual u32 pictures_at_once(u64 pixels) const {
    (void)pixels;
    return 1;
  }
  /// shots   at most pictures_at_once(), whose jobs differ in their snapshots and seeds alone, and
  ///         whose pictures have one size. Thread: as prepare_all(); a film may be destroyed by any
  [[nodiscard]] virtual Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) = 0;
  /// Traces the mean planes' samples of a range. Returns whether it is done: the slice may be over
  /// before. Then the next call for the film is the same again and goes on. The result does not
  /// depend on how work is split.
  [[nodiscard]] virtual Expected<bool> render(Film& film, const WorkRange& range,
                                              const Slice& slice, const Interrupt& interrupt) = 0;
  /// What a film of one picture has of a run whose tiles have the same samples. `rays` and
  /// `seconds` are left to the caller.
  [[nodiscard]] virtual Expected<FilmPart> take(Film& film, const TileRun& tiles) = 0;
  /// Sets it in the film of the same job, or of one with more centre planes, on another device of
  /// the same kind.
  [[nodiscard]] virtual Status put(Film& film, const FilmPart& part) = 0;
  /// Traces the centre planes of all tiles. Returns as render() does.
  [[nodiscard]] virtual Expected<bool> probe(Film& film, const Slice& slice,
                                             const Interrupt& interrupt) = 0;
  /// Label columns of each picture; the film's centre planes are complete.
  [[nodiscard]] virtual Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) = 0;
  /// The planes of film_planes() after the samples that each tile has, and DENOISED where the
  /// device makes it (denoiser()); then without those that nobody else reads (is_read_beside()).
  /// Each is that of all pictures one after the other, in the memory of the first shot's job. Of a
  /// job that is on_device those it asks for lie in the device's memory and are complete: nobody
  /// need wait for the device.
  [[nodiscard]] virtual Expected<std::vector<PlaneData>> resolve(Film& film) = 0;
  /// Who makes the plane DENOISED in resolve(), on the device, for the manifest; empty: nobody
  /// there, so the engine makes it on the host, from the planes that it is computed from. Fails
  /// with UNIMPLEMENTED and why where the device should and cannot: then the engine does for a job
  /// that is not on_device.
  [[nodiscard]] virtual Expected<std::string> denoiser() { return std::string(); }
  /// Of the device's memory, called from the device's thread; what it made may be destroyed by any.
  /// Null where the device's memory is the host's, and on_device means nothing.
  [[nodiscard]] virtual std::shared_ptr<SharedMemorySource> shared_memory() const {
    return nullptr;
  }
  /// Whether labels_elsewhere(), resolve_elsewhere() and query_elsewhere() may be called: labels(),
  /// resolve() and query() by the threads of the caller's arena. Thread: any.
  [[nodiscard]] virtual bool finishes_elsewhere() const { return false; }
  [[nodiscard]] virtual Expected<std::vector<std::vector<Column>>> labels_elsewhere(
      Film& film, const Interrupt& interrupt) {
    return labels(film, interrupt);
  }
  [[nodiscard]] virtual Expected<std::vector<PlaneData>> resolve_elsewhere(Film& film) {
    return resolve(film);
  }
  /// From the variance of a film of one picture, which its job asked for (measures_noise); needs 2
  /// samples a pixel.
  [[nodiscard]] virtual Noise noise(const Film& film) = 0;

  [[nodiscard]] virtual Expected<QueryResult> query(const QueryJob& job,
                                                    const Interrupt& interrupt) = 0;
  [[nodiscard]] virtual Expected<QueryResult> query_elsewhere(const QueryJob& job,
                                                              const Interrupt& interrupt) {
    return query(job, interrupt);
  }
  /// Bytes of derived data resident now.
  [[nodiscard]] virtual u64 derived_bytes() const = 0;
  /// Scenes that were made again, as there had been no room to keep them. Thread: any.
  [[nodiscard]] virtual u64 scenes_made_again() const { return 0; }
  /// Bytes copied to the device since it was opened; 0: it works in the host's memory.
  /// Thread: any.
  [[nodiscard]] virtual u64 uploaded_bytes() const { return 0; }
  /// Thread: any.
  [[nodiscard]] virtual MemoryUse memory() const { return {}; }
  /// Whether the device is gone for good, so that every call fails. What it made may then only be
  /// destroyed.
  [[nodiscard]] virtual bool is_lost() const { return false; }
  /// Gives up what a lost device has, so that another backend finds it free. The last call from the
  /// device's thread.
  virtual void abandon() {}
};

struct BackendOptions {
  u32 index = 0;                     // of the device among those of its kind
  u32 threads = 0;                   // 0: all
  u64 cache_bytes = 4ull << 30;      // of scenes and derived data nobody uses
  u64 static_triangles = 4'000'000;  // of static entities, traced as one mesh
  u64 memory_bytes = 0;              // of a device's own memory; 0: most of what is free there
  std::string denoiser = "libOpenImageDenoise.so.2";  // or a path, or "off"
};

/// Names: "embree". The only function that knows backends. UNAVAILABLE: there is no device now;
/// FAILED_PRECONDITION: there is none in this process any more (needs_new_process()).
[[nodiscard]] Expected<std::unique_ptr<Backend>> make_backend(std::string_view name,
                                                              const BackendOptions& options);
/// Whether make_backend() fails like this for as long as this process lives, while another one may
/// have the device at once.
[[nodiscard]] inline bool needs_new_process(const Error& error) {
  return error.code == Code::kFailedPrecondition;
}
[[nodiscard]] std::vector<std::string_view> backend_names();
/// How many devices a backend finds. Fails like make_backend().
[[nodiscard]] Expected<u32> device_count(std::string_view name);

}  // namespace heliograph
