#include "renderer/backend/cuda/film.h"

#include <algorithm>
#include <cstring>
#include <utility>

#include "renderer/base/parallel.h"
#include "renderer/frame/film_planes.h"
#include "renderer/host/noise.h"

namespace heliograph::cuda {

Expected<std::unique_ptr<CudaFilm>> CudaFilm::create(Pictures pictures, std::span<const Shot> shots,
                                                     const FilmTools& tools) {
  std::unique_ptr<CudaFilm> film(new CudaFilm(std::move(pictures), tools));
  HELIO_TRY(film->open(shots, tools));
  return film;
}

CudaFilm::~CudaFilm() { (void)join_probes(); }

Status CudaFilm::open(std::span<const Shot> shots, const FilmTools& tools) {
  const auto own = std::make_shared<Copies>(tools.mirror);
  for (const Shot& shot : shots) HELIO_TRY(add_scenes(shot, tools.scene_of, own));
  HELIO_TRY(own->finish());
  const u32 count = u32(pictures_.size());
  tile_samples_.resize(u64(count) * pictures_[0]->tiles());
  const host::FilmMemory one = pictures_[0]->memory();
  for (const auto& [bytes, to] : {std::pair{one.sums.size() * count, &sums_},
                                  std::pair{one.centres.size() * count, &centres_},
                                  std::pair{sizeof(FilmCounters), &counters_},
                                  std::pair{tile_samples_.size() * sizeof(u32), &samples_}}) {
    auto made = context_.zeroed(bytes);
    if (!made) return std::unexpected(std::move(made).error());
    *to = *std::move(made);
  }
  std::vector<kernels::FilmView> views;
  for (u32 i = 0; i < count; ++i) {
    views.push_back(copy(pictures_[i]->view(), i));
    views.back().rank_of_group = nullptr;
    set_tasks(i);
  }
  view_ = views.front();
  views_ = copies_.of_own(std::span<const kernels::FilmView>(views));
  for (const auto& task : tasks_)
    task_copies_.push_back(count > 1 ? copies_.of_own(std::span<const WaveShot>(task)) : nullptr);
  if (shots.front().still) set_probes();
  return copies_.finish();
}

Status CudaFilm::add_scenes(const Shot& shot, const SceneOf& scene_of,
                            const std::shared_ptr<Copies>& own) {
  for (const auto& scene : {shot.open, shot.still, shot.forward, shot.backward}) {
    if (!scene) continue;
    auto copied = scene_of({std::static_pointer_cast<const ResidentScene>(scene),
                            scenes_.empty() ? nullptr : scenes_.back(), own});
    if (!copied) return std::unexpected(std::move(copied).error());
    scene_of_.emplace((*copied)->host().get(), copied->get());
    scenes_.push_back(*std::move(copied));
  }
  return {};
}

u64 CudaFilm::pixels() const { return u64(view_.width) * view_.height; }

const CudaScene* CudaFilm::copy_of(const ResidentScene* scene) const {
  const auto found = scene_of_.find(scene);
  return found == scene_of_.end() ? nullptr : found->second;
}

kernels::CameraView CudaFilm::copy(const kernels::CameraView& camera) {
  kernels::CameraView view = camera;
  if (camera.segments > 0)
    view.motion_keys = copies_.of_own(std::span(camera.motion_keys, camera.segments + 1));
  const u64 pixels = u64(camera.width) * camera.height;
  if (camera.table.rays) view.table.rays = copies_.of_own(std::span(camera.table.rays, pixels));
  if (camera.table.times) view.table.times = copies_.of_own(std::span(camera.table.times, pixels));
  return view;
}

kernels::FilmView CudaFilm::copy(const kernels::FilmView& film, u32 picture) const {
  return pictures_[picture]->rebased(
      film, {{sums_.as<std::byte>(), sums_.bytes()}, {centres_.as<std::byte>(), centres_.bytes()}},
      {picture, u32(pictures_.size())});
}

void CudaFilm::set_tasks(u32 picture) {
  u32 next = 0;
  for (const host::RenderTask& task : pictures_[picture]->render_tasks()) {
    const CudaScene* scene = copy_of(task.scene);
    kernels::FilmView film = copy(*task.film, picture);
    if (film.rank_of_group)
      film.rank_of_group =
          copies_.of_own(std::span(film.rank_of_group, task.scene->lights().groups.size()));
    if (next == tasks_.size()) tasks_.emplace_back();
    tasks_[next++].push_back(
        {{scene->view(), copy(*task.camera), *task.settings, film}, scene->bvh()});
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
  if (!seen.scene->instances) return end;  // those of the copy
  end.scene.instances =
      copies_.of_own(std::span(seen.scene->instances, seen.scene->instance_count));
  std::vector<kernels::VolumeView> volumes(copied->volumes().begin(), copied->volumes().end());
  for (std::size_t i = 0; i < volumes.size(); ++i)
    volumes[i].instance = seen.scene->volumes[i].instance;
  end.scene.volumes = copies_.of_own(std::span<const kernels::VolumeView>(volumes));
  return end;
}

void CudaFilm::set_probes() {
  std::vector<ProbeLaunch> probes;
  for (u32 i = 0; i < pictures_.size(); ++i) {
    const host::ProbeTask task = pictures_[i]->probe_task();
    ProbeLaunch& launch = probes.emplace_back();
    launch.now = end_of(task.now, task.context.now);
    launch.forward = end_of(task.forward, task.context.forward);
    launch.backward = end_of(task.backward, task.context.backward);
    launch.wants_disparity = task.context.disparity != nullptr;
    if (launch.wants_disparity) launch.disparity = copy(*task.context.disparity);
    launch.settings = *task.context.settings;
    launch.rest_boxes = copies_.of(task.context.rest_boxes, task.rest_boxes);
    later_ = launch.settings.vertex > 0;
    launch.film = copy(*task.film, i);
    launch.film.rank_of_group = nullptr;
  }
  probes_ = copies_.of_own(std::span<const ProbeLaunch>(probes));
}

Expected<bool> CudaFilm::render(const WorkRange& range, const Slice& slice,
                                const Interrupt& interrupt) {
  for (; task_ < tasks_.size(); ++task_) {
    if (!waves_) {
      const WaveShots shots{tasks_[task_], task_copies_[task_], counters_.as<FilmCounters>()};
      waves_ = std::make_unique<Waves>(context_, programs_, shots, range);
      HELIO_TRY(waves_->allocate());
    }
    const auto done = waves_->advance(slice, interrupt);
    if (!done) return done;
    if (!*done) {
      HELIO_TRY(download({}));
      return false;
    }
    waves_.reset();
  }
  task_ = 0;
  std::ranges::fill(std::span(tile_samples_).subspan(range.first_tile, range.tile_count),
                    range.first_sample + range.sample_count);
  return true;
}

Expected<FilmPart> CudaFilm::take(const TileRun& tiles) {
  HELIO_TRY(context_.enter());
  FilmPart part{.tiles = tiles, .samples = samples(tiles.first)};
  const std::vector<host::SumRange> ranges = pictures_[0]->sums_of(tiles);
  u64 bytes = 0;
  for (const host::SumRange& range : ranges) bytes += range.bytes;
  part.sums.resize(bytes);
  std::vector<Download> downloads;
  std::span<std::byte> to(part.sums);
  for (const host::SumRange& range : ranges) {
    downloads.push_back({to.first(range.bytes), sums_.at() + range.offset});
    to = to.subspan(range.bytes);
  }
  HELIO_TRY(download(std::move(downloads)));
  return part;
}

Status CudaFilm::put(const FilmPart& part) {
  HELIO_TRY(context_.enter());
  std::vector<Upload> uploads;
  std::span<const std::byte> from(part.sums);
  for (const host::SumRange& range : pictures_[0]->sums_of(part.tiles)) {
    uploads.push_back({sums_.at() + range.offset, from.first(range.bytes)});
    from = from.subspan(range.bytes);
  }
  HELIO_TRY(context_.upload(uploads));
  std::ranges::fill(std::span(tile_samples_).subspan(part.tiles.first, part.tiles.count),
                    part.samples);
  rays_elsewhere_ += part.rays;
  return {};
}

Status CudaFilm::probe() {
  kernels::WaveWork work{0, tiles(), 0, 1};
  u64* rays = &counters_.as<FilmCounters>()->rays;
  void* arguments[] = {&probes_, &work, &rays};
  fetched_ = false;
  const auto& program = later_ ? programs_.probe_later : programs_.probe;
  probes_aside_ = true;
  HELIO_TRY(context_.fork());
  return context_.launch(program.function, Programs::size(program, kernels::pixels_of(work)),
                         arguments, Lane::kAside);
}

Status CudaFilm::join_probes() {
  return std::exchange(probes_aside_, false) ? context_.join() : Status{};
}

Expected<ResolveLaunch> CudaFilm::resolve_launch() const {
  HELIO_TRY(context_.upload(samples_.at(), std::as_bytes(std::span(tile_samples_))));
  return ResolveLaunch{
      .films = views_, .pictures = u32(pictures_.size()), .tile_samples = samples_.as<u32>()};
}

Status CudaFilm::launch_resolve(ResolveLaunch& launch, const kernels::PlaneOut& out) const {
  launch.out = out;
  launch.out_bytes = pixels() * out.channels * size_of(plane_info(out.plane).dtype);
  void* arguments[] = {&launch};
  return context_.launch(programs_.resolve.function,
                         Programs::size(programs_.resolve, pictures_.size() * pixels()), arguments);
}

/// Where a plane is resolved to: of a job that is on_device straight to where its reader has it.
Expected<CudaFilm::Resolved> CudaFilm::new_plane_of(Plane plane, bool is_read) {
  Resolved resolved{.plane = plane};
  const u64 all = pictures_.size() * pixels();
  if (is_read && job().on_device) {
    auto made = new_device_plane(job(), plane, all);
    if (!made) return std::unexpected(std::move(made).error());
    resolved.at = DevicePointer(made->pixels.data());
    resolved.made = *std::move(made);
    return resolved;
  }
  if (is_read) resolved.made = new_plane(job(), plane, all);
  const PlaneInfo& info = plane_info(plane);
  if (info.fold == kernels::Fold::kCentre) {
    resolved.at = DevicePointer(view_.planes[u32(plane)]);
    return resolved;
  }
  auto memory = context_.allocate(all * info.channels * size_of(info.dtype));
  if (!memory) return std::unexpected(std::move(memory).error());
  resolved.at = memory->at();
  resolved.own = *std::move(memory);
  return resolved;
}

Expected<std::vector<CudaFilm::Resolved>> CudaFilm::new_resolved(bool denoises) {
  std::vector<Plane> planes = film_planes(job());
  if (denoises) planes.push_back(Plane::DENOISED);
  std::vector<Resolved> all;
  for (const Plane plane : planes) {
    const bool is_read = !denoises || plane == Plane::DENOISED || is_read_beside(job(), plane);
    auto made = new_plane_of(plane, is_read);
    if (!made) return std::unexpected(std::move(made).error());
    all.push_back(*std::move(made));
  }
  return all;
}

Status CudaFilm::fill(std::span<Resolved> planes) {
  auto launch = resolve_launch();
  if (!launch) return std::unexpected(std::move(launch).error());
  const u64 all = pictures_.size() * pixels();
  u32 groups = 0;
  for (const Resolved& to : planes) {
    const PlaneInfo& info = plane_info(to.plane);
    const auto from = DevicePointer(view_.planes[u32(to.plane)]);
    if (info.fold == kernels::Fold::kPost) continue;
    if (info.fold == kernels::Fold::kCentre) {
      const u64 bytes = all * info.channels * size_of(info.dtype);
      if (to.at != from) HELIO_TRY(context_.copy(to.at, from, bytes));
      continue;
    }
    const u32 rank = to.plane == Plane::BEAUTY_GROUP ? groups++ : 0;
    HELIO_TRY(
        launch_resolve(*launch, {to.plane, info.channels, rank, reinterpret_cast<void*>(to.at)}));
  }
  return {};
}

Expected<std::vector<PlaneData>> CudaFilm::resolve(CudaDenoiser* denoiser) {
  HELIO_TRY(join_probes());
  const bool denoises = denoiser && std::ranges::count(job().planes, Plane::DENOISED) > 0;
  auto all = new_resolved(denoises);
  if (!all) return std::unexpected(std::move(all).error());
  HELIO_TRY(fill(*all));
  if (denoises) {
    const auto at = [&](u32 picture, Plane plane) {
      return std::ranges::find(*all, plane, &Resolved::plane)->at +
             picture * pixels() * plane_info(plane).channels * sizeof(float);
    };
    for (u32 i = 0; i < pictures_.size(); ++i)
      HELIO_TRY(denoiser->denoise({.width = view_.width,
                                   .height = view_.height,
                                   .beauty = at(i, Plane::BEAUTY),
                                   .albedo = at(i, Plane::ALBEDO_MEAN),
                                   .normal = at(i, Plane::NORMAL_MEAN),
                                   .out = at(i, Plane::DENOISED)}));
  }
  return finish(*std::move(all));
}

Expected<std::vector<PlaneData>> CudaFilm::finish(std::vector<Resolved> all) {
  std::vector<PlaneData> planes;
  std::vector<Download> downloads;
  for (Resolved& one : all) {
    if (!one.made) continue;
    planes.push_back(*std::move(one.made));
    const std::span to(planes.back().pixels.data(), planes.back().pixels.size());
    if (!job().on_device) downloads.push_back({to, one.at});
  }
  HELIO_TRY(download(std::move(downloads)));
  return planes;
}

Status CudaFilm::download(std::vector<Download> pieces) {
  u64 rays = 0;
  pieces.push_back({std::as_writable_bytes(std::span(&rays, 1)),
                    DevicePointer(&counters_.as<FilmCounters>()->rays)});
  HELIO_TRY(context_.download(pieces));
  rays_ = rays;
  return {};
}

/// A lost device reports nothing here; the next call does.
Noise CudaFilm::noise() const { return measured_noise().value_or(Noise{}); }

Expected<Noise> CudaFilm::measured_noise() const {
  HELIO_TRY(context_.enter());
  auto launch = resolve_launch();
  if (!launch) return std::unexpected(std::move(launch).error());
  std::vector<kernels::PixelStatistics> told(pixels());
  auto memory = context_.allocate(told.size() * sizeof(kernels::PixelStatistics));
  if (!memory) return std::unexpected(std::move(memory).error());
  launch->noise = memory->as<kernels::PixelStatistics>();
  void* arguments[] = {&*launch};
  HELIO_TRY(context_.launch(programs_.noise.function, Programs::size(programs_.noise, told.size()),
                            arguments));
  HELIO_TRY(context_.download(std::as_writable_bytes(std::span(told)), memory->at()));
  return host::noise_of({view_, told, tile_samples_});
}

Status CudaFilm::fetch_label_planes() {
  if (fetched_) return {};
  static_assert(sizeof(u32) == sizeof(float));
  const u64 bytes = pixels() * sizeof(u32);
  for (const u32 plane : {u32(kernels::Plane::INSTANCE), u32(kernels::Plane::DISTANCE)}) {
    const bool silhouettes = job().labels.amodal || job().labels.amodal_masks;
    if (!view_.planes[plane] || (plane == u32(kernels::Plane::DISTANCE) && !silhouettes)) continue;
    HELIO_TRY(join_probes());
    const auto all = std::make_unique_for_overwrite<std::byte[]>(pictures_.size() * bytes);
    HELIO_TRY(context_.download({all.get(), pictures_.size() * bytes},
                                DevicePointer(view_.planes[plane])));
    parallel_for(pictures_.size(), [&](std::size_t i) {
      std::memcpy(pictures_[i]->view().planes[plane], all.get() + i * bytes, bytes);
    });
  }
  fetched_ = true;
  return {};
}

}  // namespace heliograph::cuda
