// The GPU backend: scenes and trees are made on the host, samples and centre planes on the device,
// labels and questions on the host again.
#include "renderer/backend/cuda/cuda_backend.h"

#include <fmt/format.h>

#include <algorithm>

#include "renderer/backend/cuda/film.h"
#include "renderer/backend/cuda/programs.h"
#include "renderer/bvh/accelerator.h"
#include "renderer/bvh/host_tracer.h"
#include "renderer/host/host_backend.h"
#include "renderer/host/labels.h"
#include "renderer/host/queries.h"

namespace heliograph::cuda {
namespace {

/// Copies of scenes that the store does not keep, so that the next one finds what it has in common
/// with them.
constexpr std::size_t kOthersKept = 8;
/// Share of the device's memory, at most, of arrays that are on the host, too.
constexpr u64 kTwinShare = 16;
/// Pixels and pictures of a film: as many as a wave has paths.
constexpr u64 kFilmPixels = 1 << 20, kMostPictures = 256;

host::SceneRays rays_of(std::shared_ptr<const ResidentScene> scene) {
  auto tracer = std::make_unique<const bvh::BvhHostTracer>(*scene);
  return {std::move(scene), std::move(tracer)};
}

Expected<Takes> find_takes(const Context& context) {
  Takes made;
  for (const auto& [name, program] :
       {std::pair{"take_floats", &made.floats}, std::pair{"take_poses", &made.poses},
        std::pair{"take_poses_f64", &made.poses_f64}}) {
    const auto function = context.function(name);
    if (!function) return std::unexpected(function.error());
    *program = *function;
  }
  return made;
}

class CudaBackend final : public host::HostBackend {
 public:
  CudaBackend(std::shared_ptr<Context> context, const Programs& programs, TreeBuilder builder,
              InstancePlacer placer, const Takes& takes, const BackendOptions& options)
      : HostBackend(std::make_shared<const bvh::BvhAccelerator>(options.static_triangles), options,
                    SceneStore::Copies::kOfEach),
        context_(std::move(context)),
        exports_(ExportSource::create(context_, context_->export_device()).value_or(nullptr)),
        twins_(std::make_shared<Twins>(context_, context_->export_device(),
                                       context_->budget().bytes() / kTwinShare)),
        programs_(programs),
        builder_(std::move(builder)),
        placer_(std::move(placer)),
        mirror_(context_, twins_),
        denoiser_library_(options.denoiser),
        info_{.name = "cuda",
              .cpu_features = context_->name(),
              .film_pixels = kFilmPixels,
              .film_pictures = kMostPictures,
              .shared_memory = exports_} {
    if (exports_) exports_->set_takes(takes, twins_);
    const std::weak_ptr<ExportSource> shared = exports_;
    context_->budget().set_give_up(
        [recent = std::weak_ptr(recent_), shared, twins = std::weak_ptr(twins_)] {
          const auto scenes = recent.lock();
          if (scenes && scenes->drop_unused()) return true;
          const auto unused = twins.lock();
          if (unused && unused->reclaim()) return true;
          const auto source = shared.lock();
          return source && source->reclaim();
        });
  }

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] DeviceUse use() const override {
    DeviceUse use = HostBackend::use();
    use.uploaded_bytes = context_->uploaded_bytes();
    use.memory = {context_->budget().used(), context_->budget().bytes()};
    use.is_lost = context_->is_lost();
    return use;
  }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) override;
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt) override;
  [[nodiscard]] Expected<bool> probe(Film& film, const Slice& slice,
                                     const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) override;
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override;
  [[nodiscard]] Expected<std::string> denoiser() override;
  [[nodiscard]] Expected<QueryResult> query(const QueryJob& job,
                                            const Interrupt& interrupt) override;
  void abandon() override { context_->abandon(); }

 private:
  [[nodiscard]] Expected<std::shared_ptr<const CudaScene>> copy_of(const SceneOrder& order);
  void keep(const std::shared_ptr<const CudaScene>& scene);
  /// Drops the copies of scenes that the store keeps no more.
  void drop_copies();
  /// f() and its parallel parts, by a thread that has entered the context: where the arena is full
  /// that is not the caller.
  template <class F>
  auto on_device(const F& f) -> decltype(f()) {
    return run_in(arena(), [&]() -> decltype(f()) {
      HELIO_TRY(context_->enter());
      return f();
    });
  }

  std::shared_ptr<Context> context_;
  const std::shared_ptr<ExportSource> exports_;  // null where the driver has none
  const std::shared_ptr<Twins> twins_;
  const Programs programs_;
  const TreeBuilder builder_;
  const InstancePlacer placer_;
  Mirror mirror_;
  const std::string denoiser_library_;
  std::unique_ptr<CudaDenoiser> denoiser_;  // once it was asked for
  std::optional<Error> no_denoiser_;        // why there never is one
  const DeviceInfo info_;
  /// Latest copies. The budget refers to them, too, and outlives this while a client has a frame.
  const std::shared_ptr<Recent<CudaScene>> recent_ =
      std::make_shared<Recent<CudaScene>>(kOthersKept);
};

Expected<std::shared_ptr<const CudaScene>> CudaBackend::copy_of(const SceneOrder& order) {
  if (order.sibling && order.sibling->host() == order.scene) return order.sibling;
  const auto is_it = [&](const CudaScene& copy) { return copy.host() == order.scene; };
  if (auto known = recent_->find(is_it)) return known;
  return CudaScene::create(order.scene,
                           {mirror_, builder_, placer_, *recent_, order.sibling, order.own});
}

Expected<std::unique_ptr<Film>> CudaBackend::begin(std::span<const Shot> shots) {
  drop_copies();
  std::vector<Expected<std::unique_ptr<host::HostFilm>>> made(shots.size());
  run_in(arena(), [&] {
    parallel_for(shots.size(), [&](std::size_t i) {
      made[i] = host::HostFilm::create(shots[i]);
      for (const auto& scene : {shots[i].open, shots[i].still, shots[i].forward, shots[i].backward})
        if (scene) CudaScene::make_host_trees(static_cast<const ResidentScene&>(*scene));
    });
  });
  CudaFilm::Pictures pictures;
  for (auto& picture : made) {
    if (!picture) return std::unexpected(std::move(picture).error());
    pictures.push_back(*std::move(picture));
  }
  auto film = on_device([&] {
    return CudaFilm::create(
        std::move(pictures), shots,
        {mirror_, programs_, [&](const SceneOrder& order) { return copy_of(order); }});
  });
  if (film)
    for (const auto& scene : (*film)->scenes()) keep(scene);
  return film;
}

void CudaBackend::keep(const std::shared_ptr<const CudaScene>& scene) {
  using Until = Recent<CudaScene>::Until;
  const auto until = store().keeps(*scene->host()) ? Until::kDropped : Until::kOthersCame;
  if (const auto dropped = recent_->keep(scene, until)) store().free_later(dropped->host());
}

void CudaBackend::drop_copies() {
  for (auto& host : store().let_go()) {
    (void)recent_->drop([&](const CudaScene& copy) { return copy.host() == host; });
    store().free_later(std::move(host));
  }
}

Expected<bool> CudaBackend::render(Film& film, const WorkRange& range, const Slice& slice,
                                   const Interrupt& interrupt) {
  HELIO_TRY(context_->enter());
  return static_cast<CudaFilm&>(film).render(range, slice, interrupt);
}

/// Is only started, and so done at once.
Expected<bool> CudaBackend::probe(Film& film, const Slice&, const Interrupt& interrupt) {
  HELIO_TRY(interrupt.status());
  HELIO_TRY(context_->enter());
  HELIO_TRY(static_cast<CudaFilm&>(film).probe());
  return true;
}

Expected<std::vector<std::vector<Column>>> CudaBackend::labels(Film& film,
                                                               const Interrupt& interrupt) {
  auto& own = static_cast<CudaFilm&>(film);
  HELIO_TRY(on_device([&] { return own.fetch_label_planes(); }));
  std::vector<Expected<std::vector<Column>>> made(own.pictures());
  parallel_for(own.pictures(), [&](u32 i) {
    const host::HostFilm& seen = own.picture(i);
    made[i] = host::labels(seen, rays_of(seen.still().scene), interrupt);
  });
  std::vector<std::vector<Column>> all;
  for (auto& labels : made) {
    if (!labels) return std::unexpected(std::move(labels).error());
    all.push_back(*std::move(labels));
  }
  return all;
}

Expected<std::vector<PlaneData>> CudaBackend::resolve(Film& film) {
  return on_device([&] { return static_cast<CudaFilm&>(film).resolve(denoiser_.get()); });
}

Expected<std::string> CudaBackend::denoiser() {
  HELIO_TRY(context_->enter());
  if (no_denoiser_) return std::unexpected(*no_denoiser_);
  if (!denoiser_) {
    auto made = CudaDenoiser::create(*context_, denoiser_library_);
    if (!made && made.error().code == Code::kUnimplemented) no_denoiser_ = made.error();
    if (!made) return std::unexpected(std::move(made).error());
    denoiser_ = *std::move(made);
  }
  return denoiser_->name();
}

Expected<QueryResult> CudaBackend::query(const QueryJob& job, const Interrupt& interrupt) {
  const auto scene_at = [&](Time time) -> Expected<host::SceneRays> {
    auto scene = store().prepare(job.snapshot, {time, time}, interrupt);
    if (!scene) return std::unexpected(std::move(scene).error());
    return rays_of(*std::move(scene));
  };
  const auto scene = scene_at(job.time);
  if (!scene) return std::unexpected(scene.error());
  return host::answer(*scene, job, scene_at, interrupt);
}

}  // namespace

Expected<std::unique_ptr<Backend>> make_cuda_backend(const BackendOptions& options) {
  if (programs().empty())
    return fail(
        Code::kUnavailable, "backend",
        "this daemon was built without the GPU programs; build it where nvcc is found, with "
        "the preset cuda");
  const auto driver = load_driver();
  if (!driver) return std::unexpected(driver.error());
  auto context = Context::create(*driver, int(options.index), options.memory_bytes);
  if (!context) return std::unexpected(std::move(context).error());
  const auto programs = Programs::find(**context);
  if (!programs) return std::unexpected(programs.error());
  auto builder = TreeBuilder::create(*context);
  if (!builder) return std::unexpected(std::move(builder).error());
  const auto takes = find_takes(**context);
  if (!takes) return std::unexpected(takes.error());
  auto placer = InstancePlacer::create(*context);
  if (!placer) return std::unexpected(std::move(placer).error());
  return std::make_unique<CudaBackend>(*std::move(context), *programs, *std::move(builder),
                                       *std::move(placer), *takes, options);
}

Expected<u32> gpu_count() {
  if (programs().empty()) return 1;  // make_cuda_backend() reports why there is none
  const auto driver = load_driver();
  if (!driver) return std::unexpected(driver.error());
  int devices = 0;
  if (driver->device_count(&devices) != 0 || devices < 1)
    return fail(Code::kUnavailable, "backend", "the driver shows no GPU; render with embree");
  return u32(devices);
}

}  // namespace heliograph::cuda
