// Requirements on a device: a backend implements SceneSource, HostAnswers and Backend, and has
// films of its own. Calls come from the one thread that owns the device, unless stated otherwise.
#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <optional>
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

/// Scene that is to be resident.
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

/// Sums of the samples of a run: the film's of these pixels, array after array.
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

/// Time for which a job has a device.
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

/// The accumulating images of one shot or of several. Thread: the device's.
class Film {
 public:
  virtual ~Film() = default;
  [[nodiscard]] virtual u32 tiles() const = 0;            // of all pictures
  [[nodiscard]] virtual u32 tiles_across() const = 0;     // of one
  [[nodiscard]] virtual u32 samples(u32 tile) const = 0;  // taken so far
  [[nodiscard]] virtual u64 rays() const = 0;             // traced so far
  /// Share of the range that was left half way, as far as the device reports; 0 where none was.
  [[nodiscard]] virtual double share_of_range() const { return 0; }
  /// From the variance of a film of one picture, which its job asked for (measures_noise); needs 2
  /// samples per pixel.
  [[nodiscard]] virtual Noise noise() const = 0;
  /// Takes what a film of one picture has of a run whose tiles have the same samples. `rays` and
  /// `seconds` are left to the caller.
  [[nodiscard]] virtual Expected<FilmPart> take(const TileRun& tiles) = 0;
  /// Sets what the film of the same job, or of one with fewer centre planes, had on another device
  /// of the same kind.
  [[nodiscard]] virtual Status put(const FilmPart& part) = 0;
};

/// Description of a device.
struct DeviceInfo {
  std::string_view name;  // of its backend: "embree"
  /// Feature level of the kernels and of the ray tracer, for the manifest: "x86-64-v3, embree
  /// 3.13.5 AVX2".
  std::string cpu_features;
  // One film has as many pictures as make up so many pixels, at least one and at most so many.
  u64 film_pixels = 0;
  u32 film_pictures = 1;
  /// True if labels(), query() and resolve() may be called by any thread.
  bool finishes_elsewhere = false;
  /// Source of the device's memory, called from its thread; what it made may be destroyed by any.
  /// Null where the device's memory is the host's, and on_device means nothing.
  std::shared_ptr<SharedMemorySource> shared_memory = nullptr;
};

/// Holdings of a device, and its work since it was opened.
struct DeviceUse {
  u64 derived_bytes = 0;      // resident now
  u64 scenes_made_again = 0;  // as there had been no room to keep them
  u64 uploaded_bytes = 0;     // 0: it works in the host's memory
  MemoryUse memory = {};
  /// It is gone for good, so that every call fails. What it made may then only be destroyed.
  bool is_lost = false;
};

/// The scenes of a device, made on the host by the threads of the caller's arena. Thread: any.
class SceneSource {
 public:
  virtual ~SceneSource() = default;
  /// Returns what prepare() would have to make. Quick.
  [[nodiscard]] virtual Preparation preparation(const SceneAt& scene) const = 0;
  /// Makes scenes, in their order, from what the nearest ones that are there have in common with
  /// them.
  [[nodiscard]] virtual Expected<DeviceScenes> prepare(std::span<const SceneAt> scenes,
                                                       const Interrupt& interrupt) = 0;
};

/// Answers of the host about scenes, by the threads of the caller's arena. Thread: the device's,
/// or any (DeviceInfo::finishes_elsewhere).
class HostAnswers {
 public:
  virtual ~HostAnswers() = default;
  /// Label columns of each picture; the film's centre planes are complete.
  [[nodiscard]] virtual Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) = 0;
  [[nodiscard]] virtual Expected<QueryResult> query(const QueryJob& job,
                                                    const Interrupt& interrupt) = 0;
};

/// A device: its memory, and what is launched on it.
class Backend : public SceneSource, public HostAnswers {
 public:
  /// Thread: any.
  [[nodiscard]] virtual const DeviceInfo& info() const = 0;
  /// Thread: any.
  [[nodiscard]] virtual DeviceUse use() const = 0;
  /// f() and its parallel parts, by the threads that the device has on the host. Thread: any.
  virtual void run(const std::function<void()>& f) = 0;
  /// shots   as many as DeviceInfo has, whose jobs differ in their snapshots and seeds alone, and
  ///         whose pictures have one size. Thread: any; a film may be destroyed by any
  [[nodiscard]] virtual Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) = 0;
  /// Traces the mean planes' samples of a range. Returns whether it is done: the slice may be over
  /// before. Then the next call for the film is the same again and goes on. The result does not
  /// depend on how work is split.
  [[nodiscard]] virtual Expected<bool> render(Film& film, const WorkRange& range,
                                              const Slice& slice, const Interrupt& interrupt) = 0;
  /// Traces the centre planes of all tiles. Returns as render() does.
  [[nodiscard]] virtual Expected<bool> probe(Film& film, const Slice& slice,
                                             const Interrupt& interrupt) = 0;
  /// The planes of film_planes() after the samples that each tile has, and DENOISED where the
  /// device makes it (denoiser()); then without those that nobody else reads (is_read_beside()).
  /// Each is that of all pictures one after the other, in the memory of the first shot's job. Of a
  /// job that is on_device those it asks for lie in the device's memory and are complete: nobody
  /// need wait for the device. By the threads of the caller's arena; thread: as HostAnswers.
  [[nodiscard]] virtual Expected<std::vector<PlaneData>> resolve(Film& film) = 0;
  /// Maker of the plane DENOISED in resolve(), on the device, for the manifest; empty: nobody
  /// there, so the engine makes it on the host, from the planes that it is computed from. Fails
  /// with UNIMPLEMENTED and why where the device should and cannot: then the engine does for a job
  /// that is not on_device.
  [[nodiscard]] virtual Expected<std::string> denoiser() { return std::string(); }
  /// Gives up what a lost device has, so that another backend finds it free. The last call from the
  /// device's thread.
  virtual void abandon() {}
};

/// Number of pictures of so many pixels that one film may have.
[[nodiscard]] inline u32 pictures_at_once(const DeviceInfo& device, u64 pixels) {
  return u32(std::clamp<u64>(device.film_pixels / pixels, 1, device.film_pictures));
}

/// Returns f(), run by the threads that a device has on the host.
template <class F>
[[nodiscard]] auto run_on(Backend& device, const F& f) {
  std::optional<decltype(f())> made;
  device.run([&] { made.emplace(f()); });
  return *std::move(made);
}

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
/// True if make_backend() fails like this for as long as this process lives, while another one may
/// have the device at once.
[[nodiscard]] inline bool needs_new_process(const Error& error) {
  return error.code == Code::kFailedPrecondition;
}
[[nodiscard]] std::vector<std::string_view> backend_names();
/// Number of devices that a backend finds. Fails like make_backend().
[[nodiscard]] Expected<u32> device_count(std::string_view name);

}  // namespace heliograph
