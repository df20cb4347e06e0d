#include "renderer/backend/cuda/film.h"

#include <algorithm>

#include "renderer/engine/post.h"

namespace heliograph::cuda {

Expected<std::unique_ptr<CudaFilm>> CudaFilm::create(const Shot& shot, Mirror& mirror,
                                                     const SceneOf& scene_of) {
  std::unique_ptr<CudaFilm> film(new CudaFilm(shot, mirror));
  HELIO_TRY(film->allocate());
  HELIO_TRY(film->open(shot, scene_of));
  return film;
}

Status CudaFilm::open(const Shot& shot, const SceneOf& scene_of) {
  for (const auto& scene : {shot.open, shot.still, shot.forward, shot.backward}) {
    if (!scene) continue;
    auto copied = scene_of(std::static_pointer_cast<const ResidentScene>(scene));
    if (!copied) return std::unexpected(std::move(copied).error());
    scenes_.push_back(*std::move(copied));
  }
  for (const auto& [bytes, to] :
       {std::pair{memory().sums.size(), &sums_}, std::pair{memory().centres.size(), &centres_},
        std::pair{sizeof(u64), &probe_rays_}, std::pair{tiles() * sizeof(u32), &tile_samples_}}) {
    auto made = context_.zeroed(bytes);
    if (!made) return std::unexpected(std::move(made).error());
    *to = *std::move(made);
  }
  view_ = copy(view());
  view_.rank_of_group = nullptr;
  set_tasks();
  if (shot.still) set_probe();
  return copies_.status();
}

const CudaScene* CudaFilm::copy_of(const ResidentScene* scene) const {
  const auto found =
      std::ranges::find_if(scenes_, [&](const auto& copy) { return copy->host().get() == scene; });
  return found == scenes_.end() ? nullptr : found->get();
}

kernels::CameraView CudaFilm::copy(const kernels::CameraView& camera) {
  kernels::CameraView view = camera;
  if (camera.segments > 0)
    view.motion_keys = copies_.of_own(std::span(camera.motion_keys, camera.segments + 1));
  return view;
}

kernels::FilmView CudaFilm::copy(const kernels::FilmView& film) const {
  return moved(
      film, {{sums_.as<std::byte>(), sums_.bytes()}, {centres_.as<std::byte>(), centres_.bytes()}});
}

void CudaFilm::set_tasks() {
  for (const host::RenderTask& task : render_tasks()) {
    const CudaScene* scene = copy_of(task.scene);
    kernels::FilmView film = copy(*task.film);
    if (film.rank_of_group)
      film.rank_of_group =
          copies_.of_own(std::span(film.rank_of_group, task.scene->lights().groups.size()));
    shots_.push_back({{scene->view(), copy(*task.camera), *task.settings, film}, scene->bvh()});
  }
}

ProbeEnd CudaFilm::end_of(const ResidentScene* scene, const kernels::ProbeScene& seen) {
  ProbeEnd end{};
  if (!scene) return end;
  const CudaScene* copied = copy_of(scene);
  end.wanted = true;
  end.scene = copied->view();
  end.bvh = copied->bvh();
  end.camera = copy(*seen.camera);
  end.camera_jumped = seen.camera_jumped;
  if (seen.scene->instances == scene->view().instances) return end;
  end.scene.instances =
      copies_.of_own(std::span(seen.scene->instances, seen.scene->instance_count));
  std::vector<kernels::VolumeView> volumes(copied->volumes().begin(), copied->volumes().end());
  for (std::size_t i = 0; i < volumes.size(); ++i)
    volumes[i].instance = seen.scene->volumes[i].instance;
  end.scene.volumes = copies_.of_own(std::span<const kernels::VolumeView>(volumes));
  return end;
}

void CudaFilm::set_probe() {
  const host::ProbeTask task = probe_task();
  ProbeLaunch launch{};
  launch.now = end_of(task.now, task.context.now);
  launch.forward = end_of(task.forward, task.context.forward);
  launch.backward = end_of(task.backward, task.context.backward);
  launch.wants_disparity = task.context.disparity != nullptr;
  if (launch.wants_disparity) launch.disparity = copy(*task.context.disparity);
  launch.settings = *task.context.settings;
  launch.film = copy(*task.film);
  launch.film.rank_of_group = nullptr;
  probe_ = copies_.of_own(std::span<const ProbeLaunch>(&launch, 1));
}

Expected<bool> CudaFilm::render(const Programs& programs, const WorkRange& range, TimePoint until,
                                const Interrupt& interrupt) {
  for (; task_ < shots_.size(); ++task_) {
    if (!wave_) {
      wave_ = std::make_unique<Wave>(context_, programs, shots_[task_], range);
      HELIO_TRY(wave_->allocate());
    }
    const auto done = wave_->advance(until, interrupt);
    if (!done || !*done) return done;
    add_rays(wave_->rays());
    wave_.reset();
  }
  task_ = 0;
  for (u32 i = 0; i < range.tile_count; ++i)
    set_samples(range.first_tile + i, range.first_sample + range.sample_count);
  return true;
}

Status CudaFilm::probe(const Programs& programs, u32 first_tile, u32 tile_count) {
  kernels::WaveWork work{first_tile, tile_count, 0, 1};
  u64 rays = 0;
  u64* counter = probe_rays_.as<u64>();
  void* arguments[] = {&probe_, &work, &counter};
  HELIO_TRY(context_.fill(probe_rays_.at(), 0, sizeof rays));
  HELIO_TRY(context_.launch(programs.probe.function,
                            Programs::size(programs.probe, kernels::pixels_of(work)), arguments));
  HELIO_TRY(context_.download(std::as_writable_bytes(std::span(&rays, 1)), probe_rays_.at()));
  add_rays(rays);
  return {};
}

Expected<ResolveLaunch> CudaFilm::resolve_launch() const {
  HELIO_TRY(context_.upload(tile_samples_.at(), std::as_bytes(all_samples())));
  return ResolveLaunch{.film = view_, .tile_samples = tile_samples_.as<u32>()};
}

Expected<std::vector<PlaneData>> CudaFilm::resolve(const Programs& programs) {
  auto launch = resolve_launch();
  if (!launch) return std::unexpected(std::move(launch).error());
  if (job().on_device) return resolve_there(programs, *launch);
  const u64 pixels = u64(view_.width) * view_.height;
  std::vector<PlaneData> planes = new_planes();
  std::vector<DeviceMemory> resolved;
  std::vector<Download> downloads;
  const auto to_of = [](PlaneData& data) {
    return std::span(data.pixels.data(), data.pixels.size());
  };
  const std::vector<kernels::PlaneOut> made = outs(planes);
  auto next = made.begin();
  for (PlaneData& data : planes) {
    if (plane_info(data.plane).fold == kernels::Fold::kCentre) {
      downloads.push_back({to_of(data), DevicePointer(view_.planes[u32(data.plane)])});
      continue;
    }
    auto memory = context_.allocate(data.pixels.size());
    if (!memory) return std::unexpected(std::move(memory).error());
    launch->out = *next++;
    launch->out.to = memory->as<void>();
    void* arguments[] = {&*launch};
    HELIO_TRY(context_.launch(programs.resolve.function, Programs::size(programs.resolve, pixels),
                              arguments));
    downloads.push_back({to_of(data), memory->at()});
    resolved.push_back(*std::move(memory));
  }
  HELIO_TRY(context_.download(downloads));
  return planes;
}

Expected<std::vector<PlaneData>> CudaFilm::resolve_there(const Programs& programs,
                                                         ResolveLaunch& launch) {
  const u64 pixels = u64(view_.width) * view_.height;
  std::vector<PlaneData> planes;
  for (const kernels::Plane plane : film_planes(job())) {
    auto made = new_device_plane(job(), plane, pixels);
    if (!made) return std::unexpected(std::move(made).error());
    planes.push_back(*std::move(made));
  }
  for (PlaneData& data : planes)
    if (plane_info(data.plane).fold == kernels::Fold::kCentre)
      HELIO_TRY(context_.copy(DevicePointer(data.pixels.data()),
                              DevicePointer(view_.planes[u32(data.plane)]), data.pixels.size()));
  for (const kernels::PlaneOut& out : outs(planes)) {
    launch.out = out;
    void* arguments[] = {&launch};
    HELIO_TRY(context_.launch(programs.resolve.function, Programs::size(programs.resolve, pixels),
                              arguments));
  }
  HELIO_TRY(context_.wait());
  return planes;
}

Expected<Noise> CudaFilm::noise(const Programs& programs) const {
  auto launch = resolve_launch();
  if (!launch) return std::unexpected(std::move(launch).error());
  std::vector<double> sums(tiles());
  auto memory = context_.allocate(sums.size() * sizeof(double));
  if (!memory) return std::unexpected(std::move(memory).error());
  launch->noise = memory->as<double>();
  void* arguments[] = {&*launch};
  HELIO_TRY(
      context_.launch(programs.noise.function, Programs::size(programs.noise, tiles()), arguments));
  HELIO_TRY(context_.download(std::as_writable_bytes(std::span(sums)), memory->at()));
  return noise_of(sums);
}

Status CudaFilm::fetch_instances() const {
  constexpr u32 kFrom = u32(kernels::Plane::INSTANCE);
  auto* to = static_cast<std::byte*>(view().planes[kFrom]);
  if (!to) return {};
  const u64 bytes = u64(view_.width) * view_.height * sizeof(u32);
  return context_.download({to, bytes}, DevicePointer(view_.planes[kFrom]));
}

}  // namespace heliograph::cuda
