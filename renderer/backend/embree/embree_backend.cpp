// The CPU backend: Embree for rays, oneTBB for threads.
#include "renderer/backend/embree/embree_backend.h"

#include <fmt/format.h>
#include <immintrin.h>

#include "renderer/backend/embree/host_tracer.h"
#include "renderer/backend/embree/pixel_loop.h"
#include "renderer/backend/embree/room.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/host/host_backend.h"
#include "renderer/host/labels.h"
#include "renderer/host/queries.h"

namespace heliograph::embree {
namespace {

// Samples of a piece of a tile: enough to run side by side, and few, as threads wait for each other
// at the end of a slice.
constexpr u32 kPieceSamples = 128;
constexpr u32 kLargestPiece = 64;  // pixels

/// Denormals are zero while it lives: Embree asks for it on every thread that traces.
class FlushDenormals {
 public:
  FlushDenormals() : before_(_mm_getcsr()) {
    _mm_setcsr(before_ | kFlushToZero | kDenormalsAreZero);
  }
  ~FlushDenormals() { _mm_setcsr(before_); }
  FlushDenormals(const FlushDenormals&) = delete;
  FlushDenormals& operator=(const FlushDenormals&) = delete;

 private:
  static constexpr unsigned kFlushToZero = 1u << 15, kDenormalsAreZero = 1u << 6;
  unsigned before_;
};

/// AVX-512 traversal is left out: it takes 3 % longer, and processors with and without it would
/// give different pictures.
constexpr const char* kDeviceConfig = "max_isa=avx2";
const char* widest_isa() {
  if (__builtin_cpu_supports("avx2")) return "AVX2";
  if (__builtin_cpu_supports("avx")) return "AVX";
  return "SSE4.2";
}

std::string features(RTCDevice device, const PixelLoops& loops) {
  const auto version = rtcGetDeviceProperty(device, RTC_DEVICE_PROPERTY_VERSION);
  return fmt::format("{}, embree {}.{}.{} {}", loops.isa, version / 10000, version / 100 % 100,
                     version % 100, widest_isa());
}

/// Division of tiles into pieces, which are whole patches.
struct Pieces {
  u32 width = kernels::kPatchWidth, height = kernels::kPatchHeight;  // pixels

  explicit Pieces(u32 samples) {
    while (width * height < kLargestPiece && width * height * samples < kPieceSamples)
      (width > height ? height : width) *= 2;
  }
  [[nodiscard]] u32 of_tile() const { return kernels::kTilePixels / (width * height); }
  /// Empty where the image ends before it.
  [[nodiscard]] PixelRect of(const PixelRect& tile, u32 index) const {
    const u32 across = kernels::kTileSide / width;
    const u32 x0 = tile.x0 + index % across * width, y0 = tile.y0 + index / across * height;
    return {.x0 = x0,
            .y0 = y0,
            .x1 = std::min(tile.x1, x0 + width),
            .y1 = std::min(tile.y1, y0 + height)};
  }
};

RenderTask for_embree(const host::RenderTask& task) {
  const TracedScene scene = traced(*task.scene);
  return {scene, second_look(scene, *task.camera), task.camera, task.settings, task.film};
}

ProbeTask for_embree(const host::ProbeTask& task) {
  const auto end = [](const ResidentScene* scene, const kernels::ProbeScene& probed) {
    return scene ? traced(scene->placement(), *probed.scene) : TracedScene{};
  };
  kernels::ProbeContext context = task.context;
  if (task.now) context.now.scene = &task.now->view();
  return {.context = context,
          .now = end(task.now, context.now),
          .forward = end(task.forward, task.context.forward),
          .backward = end(task.backward, task.context.backward),
          .film = task.film};
}

host::SceneRays rays_of(std::shared_ptr<const ResidentScene> scene) {
  auto tracer = std::make_unique<const EmbreeHostTracer>(traced(*scene));
  return {std::move(scene), std::move(tracer)};
}

/// Embree's device, and what builds on it.
struct OwnedDevice {
  OwnedDevice(DeviceHandle handle, u64 static_triangles)
      : device(std::move(handle)), accelerator(device.get(), static_triangles) {}

  DeviceHandle device;
  EmbreeAccelerator accelerator;
};

class EmbreeBackend final : public host::HostBackend {
 public:
  EmbreeBackend(const std::shared_ptr<const OwnedDevice>& owned, const BackendOptions& options)
      : HostBackend({owned, &owned->accelerator}, options, SceneStore::Copies::kNever),
        loops_(best_pixel_loops()),
        info_{.name = "embree",
              .cpu_features = features(owned->device.get(), loops_),
              .finishes_elsewhere = true} {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) override {
    return host::HostFilm::create(shots.front());
  }
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt) override;
  [[nodiscard]] Expected<bool> probe(Film& film, const Slice& slice,
                                     const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override {
    return static_cast<const host::HostFilm&>(film).resolve();
  }
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) override;
  [[nodiscard]] Expected<QueryResult> query(const QueryJob& job,
                                            const Interrupt& interrupt) override;

 private:
  template <class F>
  Expected<bool> for_each_piece(host::HostFilm& film, const WorkRange& range, const Slice& slice,
                                const Interrupt& interrupt, const F& trace);

  const PixelLoops& loops_;
  const DeviceInfo info_;
};

/// From where the range was left. One piece is done at least, however late it is.
template <class F>
Expected<bool> EmbreeBackend::for_each_piece(host::HostFilm& film, const WorkRange& range,
                                             const Slice& slice, const Interrupt& interrupt,
                                             const F& trace) {
  const Pieces pieces(range.sample_count);
  const u32 count = range.tile_count * pieces.of_tile();
  const u32 first = film.left().done;
  std::atomic<u32> next = first;
  const auto goes_on = [&] {
    return !interrupt.requested() &&
           (next.load(std::memory_order_relaxed) == first || !slice.is_over());
  };
  run_in(arena(), [&] {
    parallel_for(u32(arena().max_concurrency()), [&](u32) {
      const FlushDenormals flush;
      while (goes_on()) {
        const u32 piece = next.fetch_add(1, std::memory_order_relaxed);
        if (piece >= count) return;
        const PixelRect tile = film.tile(range.first_tile + piece / pieces.of_tile());
        film.add_rays(trace(pieces.of(tile, piece % pieces.of_tile())));
      }
    });
  });
  const bool is_done = next >= count;
  film.leave(is_done ? host::HostFilm::Left{} : host::HostFilm::Left{next, count});
  if (!is_done) HELIO_TRY(interrupt.status());
  return is_done;
}

Expected<bool> EmbreeBackend::render(Film& film, const WorkRange& range, const Slice& slice,
                                     const Interrupt& interrupt) {
  auto& own = static_cast<host::HostFilm&>(film);
  std::vector<RenderTask> tasks;
  for (const host::RenderTask& task : own.render_tasks()) tasks.push_back(for_embree(task));
  const auto done = for_each_piece(own, range, slice, interrupt, [&](const auto& rect) {
    u64 rays = 0;
    for (const RenderTask& task : tasks)
      rays += loops_.render(task, rect, range.first_sample, range.sample_count);
    return rays;
  });
  if (!done || !*done) return done;
  for (u32 i = 0; i < range.tile_count; ++i)
    own.set_samples(range.first_tile + i, range.first_sample + range.sample_count);
  return true;
}

Expected<bool> EmbreeBackend::probe(Film& film, const Slice& slice, const Interrupt& interrupt) {
  auto& own = static_cast<host::HostFilm&>(film);
  const ProbeTask task = for_embree(own.probe_task());
  return for_each_piece(own, {0, own.tiles(), 0, 1}, slice, interrupt,
                        [&](const auto& rect) { return loops_.probe(task, rect); });
}

Expected<std::vector<std::vector<Column>>> EmbreeBackend::labels(Film& film,
                                                                 const Interrupt& interrupt) {
  const auto& own = static_cast<const host::HostFilm&>(film);
  const FlushDenormals flush;
  auto labels = host::labels(own, rays_of(own.still().scene), interrupt);
  if (!labels) return std::unexpected(std::move(labels).error());
  return std::vector(1, *std::move(labels));
}

Expected<QueryResult> EmbreeBackend::query(const QueryJob& job, const Interrupt& interrupt) {
  const auto scene_at = [&](Time time) -> Expected<host::SceneRays> {
    auto scene = store().prepare(job.snapshot, {time, time}, interrupt);
    if (!scene) return std::unexpected(std::move(scene).error());
    return rays_of(*std::move(scene));
  };
  const auto scene = scene_at(job.time);
  if (!scene) return std::unexpected(scene.error());
  const FlushDenormals flush;
  return host::answer(*scene, job, scene_at, interrupt);
}

}  // namespace

Expected<std::unique_ptr<Backend>> make_embree_backend(const BackendOptions& options) {
  std::string config = kDeviceConfig;
  if (options.threads) config += fmt::format(",threads={}", options.threads);
  DeviceHandle device(rtcNewDevice(config.c_str()));
  if (!device)
    return fail(Code::kUnavailable, "",
                fmt::format("Embree gave no device: error {}", int(rtcGetDeviceError(nullptr))));
  return std::make_unique<EmbreeBackend>(
      std::make_shared<const OwnedDevice>(std::move(device), options.static_triangles), options);
}

}  // namespace heliograph::embree
