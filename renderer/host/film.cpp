#include "renderer/host/film.h"

#include <algorithm>
#include <cstring>

#include "kernels/scene/film.h"
#include "renderer/base/parallel.h"
#include "renderer/frame/check.h"
#include "renderer/frame/film_planes.h"
#include "renderer/frame/motion_keys.h"
#include "renderer/frame/shutter.h"
#include "renderer/host/noise.h"

namespace heliograph::host {
namespace {

using kernels::Fold;
using kernels::plane_bit;

bool wants_label_pixels(const LabelOptions& labels) {
  return labels.boxes || labels.amodal || labels.amodal_masks;
}

/// All that the film holds.
PlaneSet held_planes(const RenderJob& job) {
  PlaneSet wanted = wanted_planes(job) & ~kernels::planes_of(Fold::kPost);
  if (wants_label_pixels(job.labels)) wanted |= plane_bit(Plane::INSTANCE);
  if (job.labels.amodal || job.labels.amodal_masks) wanted |= plane_bit(Plane::DISTANCE);
  if (measures_noise(job)) wanted |= plane_bit(Plane::BEAUTY) | plane_bit(Plane::COVERAGE);
  return wanted;
}

u64 round_up(u64 bytes, u64 to) { return (bytes + to - 1) / to * to; }

/// In the middle of the image.
float pixels_per_radian(const kernels::CameraView& camera) {
  if (!camera.table.rays) return std::max(camera.fx, camera.fy);
  return camera.table.spread > 0 ? 1 / camera.table.spread : 0;
}

ZeroedMemory zeroed(u64 bytes) {
  return ZeroedMemory(static_cast<std::byte*>(std::calloc(std::max<u64>(bytes, 1), 1)));
}

}  // namespace

Expected<std::unique_ptr<HostFilm>> HostFilm::create(const Shot& shot) {
  std::unique_ptr<HostFilm> film(new HostFilm(shot));
  HELIO_TRY(film->allocate());
  HELIO_TRY(film->find_rest_boxes());
  return film;
}

HostFilm::HostFilm(const Shot& shot) : shot_(shot) {
  const EntityId camera = job().cameras[shot.camera];
  const Camera* lens = job().snapshot->find(camera)->camera.get();
  const Shutter& shutter = lens->shutter;
  image_camera_ = camera_at(camera, *lens, label_span(shutter, label_time(job())).middle());
  look(open_, camera, *lens, shot.open);
  open_.camera.shutter = shutter_view(*lens, image_camera_.height);
  look(still_, camera, *lens, shot.still);
  if (const EntityId second = job().disparity_camera)
    look(disparity_, second, *job().snapshot->find(second)->camera, shot.still);
  set_end(forward_, shot.forward);
  set_end(backward_, shot.backward);
  tiles_x_ = (image_camera_.width + kernels::kTileSide - 1) / kernels::kTileSide;
  tiles_y_ = (image_camera_.height + kernels::kTileSide - 1) / kernels::kTileSide;
  tile_samples_.resize(tiles());
}

ImageCamera HostFilm::camera_at(EntityId camera, const Camera& lens, Time time) const {
  const Snapshot& snapshot = *job().snapshot;
  const uvec2 size = rendered_size(job(), camera);
  return heliograph::image_camera(lens, world_pose(snapshot, camera.index(), time), size.x, size.y);
}

void HostFilm::look(Sight& sight, EntityId camera, const Camera& lens,
                    const std::shared_ptr<const DeviceScene>& scene) const {
  if (!scene) return;
  sight.scene = std::static_pointer_cast<const ResidentScene>(scene);
  const TimeSpan& span = sight.scene->span();
  sight.camera = camera_view(camera_at(camera, lens, span.middle()));
  sight.camera.shutter = label_view(lens, sight.camera.height);
  sight.keys =
      pointing_keys(*job().snapshot, camera.index(), span, pixels_per_radian(sight.camera));
  if (sight.keys.empty()) return;
  sight.camera.motion_keys = sight.keys.data();
  sight.camera.segments = u32(sight.keys.size() - 1);
}

/// Before the last Advance a camera may have had another lens.
const Camera& HostFilm::lens_at(EntityId camera, Time time) const {
  const Snapshot& snapshot = *job().snapshot;
  const Entity* then =
      in_history(snapshot, time) ? before_advance(snapshot, camera.index()) : nullptr;
  return then && then->camera ? *then->camera : *snapshot.find(camera)->camera;
}

void HostFilm::set_end(FlowEnd& end, const std::shared_ptr<const DeviceScene>& scene) {
  if (!scene) return;
  const EntityId camera = job().cameras[shot_.camera];
  const Time here = still_.scene->span().begin;
  const Time there = static_cast<const ResidentScene&>(*scene).span().begin;
  look(end.sight, camera, lens_at(camera, there), scene);
  const kernels::SceneView& seen = end.sight.scene->view();
  end.view = seen;
  end.instances.assign(seen.instances, seen.instances + seen.instance_count);
  end.volumes.assign(seen.volumes, seen.volumes + seen.volume_count);
  const auto mark = [&](kernels::InstanceView& instance) {
    if (!flow_valid(*job().snapshot, instance.entity, here, there))
      instance.flags |= kernels::kFlowInvalid;
  };
  for (kernels::InstanceView& instance : end.instances) mark(instance);
  for (kernels::VolumeView& volume : end.volumes) mark(volume.instance);
  end.view.instances = end.instances.data();
  end.view.volumes = end.volumes.data();
  end.camera_jumped = !flow_valid(*job().snapshot, camera.index(), here, there);
}

void HostFilm::set_groups() {
  if (!open_.scene) return;
  const std::vector<std::string>& wanted = job().groups;
  for (const std::string& group : open_.scene->lights().groups) {
    const auto found = std::ranges::find(wanted, group);
    rank_of_group_.push_back(found == wanted.end() ? kNone : u32(found - wanted.begin()));
  }
  view_.rank_of_group = rank_of_group_.data();
  view_.groups = u32(wanted.size());
}

/// Calls visit(pointer, images, image_bytes, fold) for each array that the film wants.
template <class F>
void HostFilm::for_each_array(F&& visit) {
  const u64 pixels = u64(view_.width) * view_.height;
  for (u32 i = 0; i < kernels::kPlanes; ++i) {
    const PlaneInfo& info = plane_info(Plane(i));
    if (!(view_.wanted & plane_bit(Plane(i))) || info.fold == Fold::kFilm) continue;
    const u64 images = Plane(i) == Plane::BEAUTY_GROUP ? view_.groups : 1;
    const u64 bytes = pixels * info.channels * size_of(info.dtype);
    visit(view_.planes[i], images, bytes, info.fold);
    if (info.fold == Fold::kMean) visit(view_.partial[i], images, bytes, info.fold);
  }
  if (measures_noise(job())) {
    visit(view_.moments, 1, pixels * 2 * sizeof(float), Fold::kFilm);
    visit(view_.moments_partial, 1, pixels * 2 * sizeof(float), Fold::kFilm);
  }
  if (view_.wanted & plane_bit(Plane::SHADOW_CATCHER)) {
    visit(view_.catcher, 1, pixels * 2 * sizeof(float), Fold::kFilm);
    visit(view_.catcher_partial, 1, pixels * 2 * sizeof(float), Fold::kFilm);
  }
}

Status HostFilm::allocate() {
  constexpr u64 kAligned = 256;  // so that devices read and write whole lines
  view_.width = image_camera_.width;
  view_.height = image_camera_.height;
  view_.wanted = held_planes(job());
  set_groups();
  for_each_array([&](auto*, u64 images, u64 image_bytes, Fold fold) {
    (fold == Fold::kCentre ? centre_bytes_ : sum_bytes_) +=
        round_up(images * image_bytes, kAligned);
  });
  sums_ = zeroed(sum_bytes_);
  centres_ = zeroed(centre_bytes_);
  if (!sums_ || !centres_)
    return fail(Code::kResourceExhausted, "planes",
                "no memory for these planes; ask for a smaller image or fewer planes");
  std::byte *sum = sums_.get(), *centre = centres_.get();
  for_each_array([&]<class T>(T*& array, u64 images, u64 image_bytes, Fold fold) {
    std::byte*& next = fold == Fold::kCentre ? centre : sum;
    array = static_cast<T*>(static_cast<void*>(next));
    array_bytes_[next] = images * image_bytes;
    if (fold != Fold::kCentre)
      for (u64 i = 0; i < images; ++i)
        sum_images_.push_back(
            {u64(next - sums_.get()) + i * image_bytes, image_bytes / view_.height});
    next += round_up(images * image_bytes, kAligned);
  });
  set_still_view();
  return {};
}

Status HostFilm::find_rest_boxes() {
  if (!(view_.wanted & kernels::planes_from<kernels::ProbeRest>())) return {};
  const auto boxes = still_.scene->rest_boxes({});
  if (!boxes) return std::unexpected(boxes.error());
  rest_boxes_ = *boxes;
  return {};
}

void HostFilm::set_still_view() {
  constexpr u32 kFrom = u32(Plane::BEAUTY_STILL), kTo = u32(Plane::BEAUTY);
  if (!(view_.wanted & plane_bit(Plane::BEAUTY_STILL))) return;
  still_view_.width = view_.width;
  still_view_.height = view_.height;
  still_view_.wanted = plane_bit(Plane::BEAUTY);
  still_view_.planes[kTo] = view_.planes[kFrom];
  still_view_.partial[kTo] = view_.partial[kFrom];
}

FilmMemory HostFilm::memory() const {
  return {{sums_.get(), sum_bytes_}, {centres_.get(), centre_bytes_}};
}

kernels::FilmView HostFilm::rebased(kernels::FilmView view, const FilmMemory& to,
                                    PictureOf picture) const {
  const auto move = [&]<class T>(T*& array) {
    if (!array) return;
    const auto* at = static_cast<const std::byte*>(static_cast<const void*>(array));
    const bool is_sum = at >= sums_.get() && at < sums_.get() + sum_bytes_;
    const u64 offset = u64(at - (is_sum ? sums_ : centres_).get());
    std::byte* there = (is_sum ? to.sums : to.centres).data() + offset * picture.count +
                       array_bytes_.at(at) * picture.number;
    array = static_cast<T*>(static_cast<void*>(there));
  };
  for (void*& plane : view.planes) move(plane);
  for (float*& partial : view.partial) move(partial);
  for (float** array : {&view.moments, &view.moments_partial, &view.catcher, &view.catcher_partial})
    move(*array);
  return view;
}

std::vector<SumRange> HostFilm::sums_of(const TileRun& tiles) const {
  const u32 y0 = tile(tiles.first).y0, y1 = tile(tiles.first + tiles.count - 1).y1;
  std::vector<SumRange> ranges;
  for (const SumImage& image : sum_images_)
    ranges.push_back({image.offset + y0 * image.row_bytes, (y1 - y0) * image.row_bytes});
  return ranges;
}

Expected<FilmPart> HostFilm::take(const TileRun& tiles) {
  FilmPart part{.tiles = tiles, .samples = samples(tiles.first)};
  for (const SumRange& range : sums_of(tiles)) {
    const std::byte* from = sums_.get() + range.offset;
    part.sums.insert(part.sums.end(), from, from + range.bytes);
  }
  return part;
}

Status HostFilm::put(const FilmPart& part) {
  const std::byte* from = part.sums.data();
  for (const SumRange& range : sums_of(part.tiles)) {
    std::memcpy(sums_.get() + range.offset, from, range.bytes);
    from += range.bytes;
  }
  for (u32 i = 0; i < part.tiles.count; ++i) set_samples(part.tiles.first + i, part.samples);
  add_rays(part.rays);
  return {};
}

PixelRect HostFilm::tile(u32 index) const { return kernels::tile_rect(view_, index); }

std::vector<RenderTask> HostFilm::render_tasks() const {
  std::vector<RenderTask> tasks;
  if (view_.wanted & kSampledPlanes & ~kernels::planes_from<kernels::StillFilm>())
    tasks.push_back({open_.scene.get(), &open_.camera, &job().settings, &view_});
  if (still_view_.wanted)
    tasks.push_back({still_.scene.get(), &still_.camera, &job().settings, &still_view_});
  return tasks;
}

ProbeTask HostFilm::probe_task() const {
  const auto end = [](const FlowEnd& e) {
    return e.sight.scene ? kernels::ProbeScene{&e.view, &e.sight.camera, e.camera_jumped}
                         : kernels::ProbeScene{};
  };
  return {.context = {.now = {&still_.scene->view_without_instances(), &still_.camera},
                      .forward = end(forward_),
                      .backward = end(backward_),
                      .disparity = job().disparity_camera ? &disparity_.camera : nullptr,
                      .settings = &job().settings,
                      .rest_boxes = rest_boxes_.data()},
          .rest_boxes = rest_boxes_.size(),
          .now = still_.scene.get(),
          .forward = forward_.sight.scene.get(),
          .backward = backward_.sight.scene.get(),
          .film = &view_};
}

std::vector<PlaneData> new_planes(const RenderJob& job, u64 pixels) {
  std::vector<PlaneData> planes;
  for (const Plane plane : film_planes(job)) planes.push_back(new_plane(job, plane, pixels));
  return planes;
}

std::vector<kernels::PlaneOut> outs(std::vector<PlaneData>& planes) {
  std::vector<kernels::PlaneOut> outs;
  u32 groups = 0;
  for (PlaneData& data : planes) {
    const PlaneInfo& info = plane_info(data.plane);
    const u32 rank = data.plane == Plane::BEAUTY_GROUP ? groups++ : 0;
    if (info.fold != Fold::kCentre)
      outs.push_back({data.plane, info.channels, rank, data.pixels.data()});
  }
  return outs;
}

std::vector<PlaneData> HostFilm::resolve() const {
  std::vector<PlaneData> planes = new_planes(job(), u64(view_.width) * view_.height);
  for (PlaneData& data : planes)
    if (plane_info(data.plane).fold == Fold::kCentre)
      std::memcpy(data.pixels.data(), view_.planes[u32(data.plane)], data.pixels.size());
  for (const kernels::PlaneOut& out : outs(planes)) {
    parallel_for(tiles(), [&](u32 index) {
      const PixelRect rect = tile(index);
      for (u32 y = rect.y0; y < rect.y1; ++y)
        for (u32 x = rect.x0; x < rect.x1; ++x)
          kernels::resolve_pixel(view_, out, u64(y) * view_.width + x, tile_samples_[index]);
    });
  }
  return planes;
}

Noise HostFilm::noise() const {
  std::vector<kernels::PixelStatistics> told(u64(view_.width) * view_.height);
  parallel_for(tiles(), [&](u32 index) {
    const PixelRect rect = tile(index);
    for (u32 y = rect.y0; y < rect.y1; ++y)
      for (u32 x = rect.x0; x < rect.x1; ++x) {
        const u64 pixel = u64(y) * view_.width + x;
        told[pixel] = kernels::noise_statistics(view_, pixel, tile_samples_[index]);
      }
  });
  return noise_of({view_, told, tile_samples_});
}

}  // namespace heliograph::host
