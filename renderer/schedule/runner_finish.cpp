// Products of a film's samples: label columns, planes, frames. Large ones are made by workers.
#include "renderer/base/guard.h"
#include "renderer/frame/check.h"
#include "renderer/frame/frame_header.h"
#include "renderer/frame/remarks.h"
#include "renderer/schedule/runner.h"

namespace heliograph {
namespace {

// Seconds of a core, about: they decide where work is done.
constexpr double kOfPostPixel = 3e-7;  // of a plane that is made of others
constexpr double kOfByte = 5e-10;      // of a plane
constexpr double kOfLabelPixel = 2e-8;
constexpr double kOfAmodalPixel = 2e-7;
constexpr double kWorthLeaving = 2e-3;  // going to a worker and back costs a twentieth of it

double post_seconds(const RenderJob& job, u32 camera) {
  const uvec2 size = rendered_size(job, job.cameras[camera]);
  const auto is_post = [](Plane plane) { return plane_info(plane).fold == kernels::Fold::kPost; };
  return kOfPostPixel * size.x * size.y * double(std::ranges::count_if(job.planes, is_post));
}

double label_seconds(const RenderJob& job, u32 camera) {
  const uvec2 size = rendered_size(job, job.cameras[camera]);
  const bool is_amodal = job.labels.amodal || job.labels.amodal_masks;
  return (is_amodal ? kOfAmodalPixel : kOfLabelPixel) * size.x * size.y;
}

double resolve_seconds(const RenderJob& job, u32 camera) {
  const uvec2 size = rendered_size(job, job.cameras[camera]);
  double bytes = 0;
  for (const Plane plane : film_planes(job))
    bytes += plane_info(plane).channels * double(size_of(plane_info(plane).dtype));
  return kOfByte * bytes * size.x * size.y;
}

}  // namespace

bool Runner::is_worth_leaving(double seconds) const {
  return seconds > kWorthLeaving && context_.backend.info().finishes_elsewhere;
}

Steps Runner::label(Film& film) {
  HELIO_CO_TRY(co_await pause());
  Expected<std::vector<std::vector<Column>>> labels;
  const double cost = label_seconds(*job_, begun_.shots.front().camera);
  if (is_worth_leaving(cost)) {
    std::vector<Errand> label;
    label.push_back({.seconds = cost, .run = [&](const Interrupt&) {
                       labels =
                           guard([&] { return context_.backend.labels(film, context_.interrupt); });
                     }});
    HELIO_CO_TRY(co_await elsewhere(std::move(label)));
  } else {
    labels =
        run_on(context_.backend, [&] { return context_.backend.labels(film, context_.interrupt); });
  }
  if (!labels) co_return std::unexpected(std::move(labels).error());
  for (std::size_t i = 0; i < labels->size(); ++i)
    begun_.frames[i].labels = std::move((*labels)[i]);
  co_return Status{};
}

Expected<std::vector<PlaneData>> Runner::finish(const Shot& shot, std::vector<PlaneData> made) {
  const RenderJob& job = *shot.job;
  const EntityId camera = job.cameras[shot.camera];
  return finish_planes(job, std::move(made),
                       {.denoiser = context_.denoiser,
                        .interrupt = context_.interrupt,
                        .model = *job.snapshot->find(camera)->camera,
                        .camera = image_of(job, shot.camera),
                        .sensor_seed = sensor_seed(job, camera)});
}

void Runner::remark(const Shot& shot, Frame& frame) const {
  const auto& scene = shot.open ? shot.open : shot.still;
  if (!scene) return;
  std::ranges::move(remarks(*job_, scene->summary(), frame), std::back_inserter(frame.warnings));
}

/// Emits the film's frames. Facts of the whole film are stated with its first picture.
Steps Runner::emit(Film& film, bool final) {
  const Shot& shot = begun_.shots.front();
  const double cost = resolve_seconds(*job_, shot.camera), post = post_seconds(*job_, shot.camera);
  const bool leaves = is_worth_leaving(cost);
  Expected<std::vector<PlaneData>> planes;
  if (!leaves) planes = run_on(context_.backend, [&] { return context_.backend.resolve(film); });
  if (!planes) co_return std::unexpected(std::move(planes).error());
  const auto finish_all = [&] {
    planes = guard([&]() -> Expected<std::vector<PlaneData>> {
      if (leaves) planes = context_.backend.resolve(film);
      return planes ? finish(shot, *std::move(planes)) : std::move(planes);
    });
  };
  if (leaves || wants_post(*job_)) {
    std::vector<Errand> errands;
    errands.push_back(
        {.seconds = post + (leaves ? cost : 0), .run = [&](const Interrupt&) { finish_all(); }});
    HELIO_CO_TRY(co_await elsewhere(std::move(errands)));
  } else {
    finish_all();
  }
  if (!planes) co_return std::unexpected(std::move(planes).error());
  std::vector<Frame> frames = begun_.frames;
  Frame& frame = frames.front();
  frame.planes = *std::move(planes);
  for (u32 tile = 0; tile < film.tiles(); ++tile)
    frame.samples = std::max(frame.samples, film.samples(tile));
  frame.tile_rounds = tile_rounds_;
  if (measures_noise(*job_) && frame.samples > 1) frame.noise = noise_of(film).mean;
  frame.final = final;
  frame.render_seconds = seconds_in_film();
  frame.rays = film.rays();
  if (!packed_) {
    if (final) remark(shot, frame);
    context_.sink->frame(std::make_shared<const Frame>(std::move(frame)));
    co_return Status{};
  }
  for (Frame& picture : frames) packed_->add(std::move(picture));
  co_return Status{};
}

}  // namespace heliograph
