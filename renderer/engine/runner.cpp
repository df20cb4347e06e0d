// Passes, slices, stop rules and frames.
#include "renderer/engine/runner.h"

#include <algorithm>
#include <cmath>

#include "kernels/film.h"
#include "renderer/engine/check.h"
#include "renderer/engine/image_camera.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

constexpr auto kReportEvery = std::chrono::milliseconds(100);

double seconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

bool power_of_two(u32 x) { return (x & (x - 1)) == 0; }

}  // namespace

Runner::Runner(std::shared_ptr<const RenderJob> job, const RunnerContext& context)
    : job_(std::move(job)),
      context_(context),
      start_(Clock::now()),
      camera_start_(start_),
      reported_(start_),
      noise_(NAN) {}

Status Runner::run() {
  for (camera_ = 0; camera_ < job_->cameras.size(); ++camera_) HELIO_TRY(run_camera(camera_));
  return {};
}

Status Runner::run_camera(u32 camera) {
  camera_start_ = Clock::now();
  noise_ = NAN;
  HELIO_TRY(pause());
  auto shot = make_shot(camera);
  if (!shot) return std::unexpected(std::move(shot).error());
  auto film = context_.backend.begin(*shot);
  if (!film) return std::unexpected(std::move(film).error());
  Frame frame = header(camera);
  if (wants_probe(*job_)) HELIO_TRY(probe(**film));
  if (wants_label_columns(*job_)) {
    HELIO_TRY(pause());
    auto labels = context_.backend.labels(**film, context_.interrupt);
    if (!labels) return std::unexpected(std::move(labels).error());
    frame.labels = *std::move(labels);
  }
  if (wants_samples(*job_))
    HELIO_TRY(sample(**film, camera, frame));
  else
    HELIO_TRY(emit(**film, std::move(frame), 0, true));
  report(**film, 1, camera + 1 == job_->cameras.size());
  rays_before_ += (*film)->rays();
  return {};
}

Expected<Shot> Runner::make_shot(u32 camera) {
  Shot shot{.job = job_, .camera = camera};
  const double interval = flow_interval(*job_);
  const auto prepare = [&](Time time, std::shared_ptr<const DeviceScene>& out) -> Status {
    auto scene = context_.backend.prepare(job_->snapshot, time, context_.interrupt);
    if (!scene) return std::unexpected(std::move(scene).error());
    out = *std::move(scene);
    return pause();
  };
  HELIO_TRY(prepare(job_->time, shot.scene));
  if (wants_forward(*job_)) HELIO_TRY(prepare(job_->time + interval, shot.forward));
  if (wants_backward(*job_)) HELIO_TRY(prepare(job_->time - interval, shot.backward));
  return shot;
}

Status Runner::pause() {
  HELIO_TRY(context_.interrupt.status());
  return context_.between();
}

Status Runner::probe(Film& film) {
  for (u32 tile = 0; tile < film.tiles();) {
    const double wanted = seconds_per_probe_ > 0 ? context_.slice.count() / seconds_per_probe_ : 4;
    const u32 count = u32(std::clamp(wanted, 1.0, double(film.tiles() - tile)));
    const auto start = Clock::now();
    HELIO_TRY(context_.backend.probe(film, tile, count, context_.interrupt));
    seconds_per_probe_ = seconds(Clock::now() - start) / count;
    tile += count;
    HELIO_TRY(pause());
    report(film, 0, false);
  }
  return {};
}

Status Runner::sample(Film& film, u32 camera, Frame& frame) {
  (void)camera;
  for (u32 done = 0;;) {
    const u32 count = next_pass(done);
    HELIO_TRY(pass(film, done, count));
    done += count;
    const bool last = finished(film, done);
    if (last || (job_->progressive && power_of_two(done))) HELIO_TRY(emit(film, frame, done, last));
    if (last) return {};
  }
}

u32 Runner::next_pass(u32 done) const {
  const StopRule& stop = job_->stop;
  u32 count = kernels::kBlock - done % kernels::kBlock;
  if (job_->progressive || stop.seconds > 0 || stop.noise > 0)
    count = std::min(count, std::max(done, 1u));
  if (stop.spp > 0) count = std::min(count, stop.spp - done);
  if (stop.seconds > 0 && done > 0) {
    const double budget = stop.seconds / double(job_->cameras.size());
    const double each = seconds_in_camera() / done;
    count = u32(std::clamp((budget - seconds_in_camera()) / each, 1.0, double(count)));
  }
  return count;
}

bool Runner::finished(Film& film, u32 done) {
  const StopRule& stop = job_->stop;
  const u32 most = stop.spp > 0 ? stop.spp : JobLimits{}.spp;
  if (done >= most) return true;
  if (stop.seconds > 0) {
    const double budget = stop.seconds / double(job_->cameras.size());
    if (seconds_in_camera() * (1 + 0.5 / done) >= budget) return true;
  }
  if (stop.noise > 0 && done >= kernels::kBlock && (power_of_two(done) || done % 64 == 0)) {
    noise_ = context_.backend.noise(film, done);
    if (noise_ <= stop.noise) return true;
  }
  return false;
}

Status Runner::pass(Film& film, u32 first, u32 count) {
  const double slice = context_.slice.count();
  for (u32 tile = 0; tile < film.tiles();) {
    // A slice is some tiles with all samples of the pass, or one tile with some of them.
    double fits = seconds_per_sample_ > 0 ? slice / seconds_per_sample_ : 1;
    const u32 tiles = u32(std::clamp(fits / count, 1.0, double(film.tiles() - tile)));
    for (u32 taken = 0; taken < count;) {
      fits = seconds_per_sample_ > 0 ? slice / seconds_per_sample_ : 1;
      const u32 samples = u32(std::clamp(fits / tiles, 1.0, double(count - taken)));
      const auto start = Clock::now();
      HELIO_TRY(
          context_.backend.render(film, {tile, tiles, first + taken, samples}, context_.interrupt));
      seconds_per_sample_ = seconds(Clock::now() - start) / (double(tiles) * samples);
      taken += samples;
      HELIO_TRY(pause());
    }
    tile += tiles;
    report(
        film,
        share_done(first) + (share_done(first + count) - share_done(first)) * tile / film.tiles(),
        false);
  }
  return {};
}

double Runner::seconds_in_camera() const { return seconds(Clock::now() - camera_start_); }

double Runner::share_done(u32 samples) const {
  const StopRule& stop = job_->stop;
  double share = stop.spp > 0 ? double(samples) / stop.spp : 0;
  if (stop.seconds > 0)
    share = std::max(share, seconds_in_camera() * double(job_->cameras.size()) / stop.seconds);
  if (stop.noise > 0 && noise_ > 0) share = std::max(share, std::pow(stop.noise / noise_, 2));
  return std::min(share, 1.0);
}

void Runner::report(const Film& film, double done_in_camera, bool force) {
  const auto now = Clock::now();
  if (!force && now - reported_ < kReportEvery) return;
  reported_ = now;
  const double elapsed = seconds(now - start_);
  Progress progress;
  progress.done = (camera_ + done_in_camera) / double(job_->cameras.size());
  progress.rays_per_second = elapsed > 0 ? double(rays_before_ + film.rays()) / elapsed : 0;
  progress.eta_seconds = progress.done > 0 ? elapsed * (1 - progress.done) / progress.done : 0;
  progress.noise = noise_;
  context_.sink.progress(progress);
}

Frame Runner::header(u32 index) const {
  const Snapshot& snapshot = *job_->snapshot;
  const EntityId camera = job_->cameras[index];
  const uvec2 size = rendered_size(*job_, camera);
  const ImageCamera image =
      image_camera(*snapshot.find(camera)->camera, world_pose(snapshot, camera.index(), job_->time),
                   size.x, size.y);
  Frame frame;
  frame.index = index;
  frame.scene = job_->scene;
  frame.revision = snapshot.revision;
  frame.overlay = job_->overlay;
  frame.camera = snapshot.name_of(camera);
  frame.width = size.x;
  frame.height = size.y;
  frame.time = job_->time;
  frame.seed = job_->settings.seed;
  frame.k = image.k;
  frame.camera_from_world_cv = image.camera_from_world_cv;
  if (snapshot.categories) frame.categories = *snapshot.categories;
  return frame;
}

Status Runner::emit(Film& film, Frame frame, u32 samples, bool final) {
  auto planes = context_.backend.resolve(film, samples);
  if (!planes) return std::unexpected(std::move(planes).error());
  frame.planes = *std::move(planes);
  frame.samples = samples;
  frame.final = final;
  frame.render_seconds = seconds_in_camera();
  frame.rays = film.rays();
  context_.sink.frame(std::make_shared<const Frame>(std::move(frame)));
  return {};
}

}  // namespace heliograph
