// The CPU backend: Embree for rays, oneTBB for threads.
#include "renderer/backend/embree/embree_backend.h"

#include <fmt/format.h>
#include <immintrin.h>

#include "renderer/backend/embree/host_tracer.h"
#include "renderer/backend/embree/pixel_loop.h"
#include "renderer/backend/embree/room.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/base/parallel.h"
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

/// How tiles are cut into pieces, which are whole patches.
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

class EmbreeBackend final : public Backend {
 public:
  EmbreeBackend(DeviceHandle device, const BackendOptions& options)
      : device_(std::move(device)),
        cache_(options.cache_bytes),
        accelerator_(device_.get(), options.static_triangles),
        store_(accelerator_, cache_, options.cache_bytes),
        loops_(best_pixel_loops()),
        arena_(options.threads ? int(options.threads) : tbb::task_arena::automatic, 1,
               tbb::task_arena::priority::high) {}

  [[nodiscard]] std::string_view name() const override { return "embree"; }
  [[nodiscard]] std::string cpu_features() const override;
  [[nodiscard]] Preparation preparation(const SceneAt& scene) const override {
    return store_.preparation(scene);
  }
  [[nodiscard]] Expected<DeviceScenes> prepare_elsewhere(std::span<const SceneAt> scenes,
                                                         const Interrupt& interrupt) override {
    return store_.prepare_all(scenes, interrupt);
  }
  [[nodiscard]] Expected<std::shared_ptr<const DeviceScene>> prepare(
      const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
      const Interrupt& interrupt) override {
    return run_in(arena_, [&] { return store_.prepare(snapshot, span, interrupt); });
  }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) override {
    return host::HostFilm::create(shots.front());
  }
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt) override;
  [[nodiscard]] Expected<FilmPart> take(Film& film, const TileRun& tiles) override {
    return static_cast<const host::HostFilm&>(film).take(tiles);
  }
  [[nodiscard]] Status put(Film& film, const FilmPart& part) override {
    static_cast<host::HostFilm&>(film).put(part);
    return {};
  }
  [[nodiscard]] Expected<bool> probe(Film& film, const Slice& slice,
                                     const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override;
  [[nodiscard]] bool finishes_elsewhere() const override { return true; }
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels_elsewhere(
      Film& film, const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve_elsewhere(Film& film) override;
  [[nodiscard]] Noise noise(const Film& film) override;
  [[nodiscard]] Expected<QueryResult> query(const QueryJob& job,
                                            const Interrupt& interrupt) override;
  [[nodiscard]] Expected<QueryResult> query_elsewhere(const QueryJob& job,
                                                      const Interrupt& interrupt) override;
  [[nodiscard]] u64 derived_bytes() const override { return cache_.bytes() + store_.bytes(); }
  [[nodiscard]] u64 scenes_made_again() const override { return store_.made_again(); }

 private:
  template <class F>
  Expected<bool> for_each_piece(host::HostFilm& film, const WorkRange& range, const Slice& slice,
                                const Interrupt& interrupt, const F& trace);

  DeviceHandle device_;
  DerivedCache cache_;
  EmbreeAccelerator accelerator_;
  SceneStore store_;
  const PixelLoops& loops_;
  tbb::task_arena arena_;
};

std::string EmbreeBackend::cpu_features() const {
  const auto version = rtcGetDeviceProperty(device_.get(), RTC_DEVICE_PROPERTY_VERSION);
  return fmt::format("{}, embree {}.{}.{} {}", loops_.isa, version / 10000, version / 100 % 100,
                     version % 100, widest_isa());
}

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
  run_in(arena_, [&] {
    parallel_for(u32(arena_.max_concurrency()), [&](u32) {
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
  return run_in(arena_, [&] { return labels_elsewhere(film, interrupt); });
}

Expected<std::vector<std::vector<Column>>> EmbreeBackend::labels_elsewhere(
    Film& film, const Interrupt& interrupt) {
  const auto& own = static_cast<const host::HostFilm&>(film);
  const FlushDenormals flush;
  auto labels = host::labels(own, rays_of(own.still().scene), interrupt);
  if (!labels) return std::unexpected(std::move(labels).error());
  return std::vector(1, *std::move(labels));
}

Expected<std::vector<PlaneData>> EmbreeBackend::resolve(Film& film) {
  return run_in(arena_, [&] { return resolve_elsewhere(film); });
}

Expected<std::vector<PlaneData>> EmbreeBackend::resolve_elsewhere(Film& film) {
  return static_cast<const host::HostFilm&>(film).resolve();
}

Noise EmbreeBackend::noise(const Film& film) {
  const auto& own = static_cast<const host::HostFilm&>(film);
  return run_in(arena_, [&] { return own.noise(); });
}

Expected<QueryResult> EmbreeBackend::query(const QueryJob& job, const Interrupt& interrupt) {
  return run_in(arena_, [&] { return query_elsewhere(job, interrupt); });
}

Expected<QueryResult> EmbreeBackend::query_elsewhere(const QueryJob& job,
                                                     const Interrupt& interrupt) {
  const auto scene_at = [&](Time time) -> Expected<host::SceneRays> {
    auto scene = store_.prepare(job.snapshot, {time, time}, interrupt);
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
  return std::make_unique<EmbreeBackend>(std::move(device), options);
}

}  // namespace heliograph::embree
