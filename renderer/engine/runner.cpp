// Passes, slices, stop rules and frames.
#include "renderer/engine/runner.h"

#include <algorithm>
#include <cmath>

#include "kernels/film.h"
#include "renderer/engine/adaptive.h"
#include "renderer/engine/check.h"
#include "renderer/engine/image_camera.h"
#include "renderer/engine/shutter.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// How much of what a sample took counts when the next ones take less: dear tiles come back after
/// cheap ones, and a slice that was sized by cheap ones would be many times too long. What took
/// more than kDearest times as long was a disturbance.
constexpr double kRemembered = 0.98, kDearest = 8;
/// Of the device: many jobs that take turns report no more than one alone would.
constexpr auto kReportEvery = std::chrono::milliseconds(100);

double seconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

bool power_of_two(u32 x) { return (x & (x - 1)) == 0; }

}  // namespace

Runner::Runner(std::shared_ptr<const RenderJob> job, const RunnerContext& context)
    : whole_(std::move(job)),
      job_(whole_),
      context_(context),
      start_(Clock::now()),
      camera_start_(start_),
      noise_(NAN),
      resumed_(start_),
      steps_(run()) {
  paused_ = steps_.handle();
}

bool Runner::step() {
  resumed_ = Clock::now();
  paused_.resume();
  used_before_ += in_slice();
  return steps_.is_done();
}

bool Runner::Pause::await_ready() const {
  return runner.slice_left() > runner.context_.slice.count() / 4 ||
         runner.context_.interrupt.requested();
}

double Runner::in_slice() const { return seconds(Clock::now() - resumed_); }

TimePoint Runner::slice_end() const {
  return resumed_ + std::chrono::duration_cast<Clock::duration>(context_.slice);
}

double Runner::slice_left() const { return context_.slice.count() - in_slice(); }

Steps Runner::run() {
  if (whole_->worlds) co_return co_await run_worlds();
  co_return co_await run_cameras();
}

/// One world after another: what they share is resident since the first.
Steps Runner::run_worlds() {
  packed_.emplace(whole_);
  HELIO_CO_TRY(packed_->allocate());
  for (const u32 world : whole_->worlds->rendered) {
    auto own = job_of_world(*whole_, world);
    if (!own) co_return std::unexpected(std::move(own).error());
    (*own)->memory = packed_->memory();
    job_ = *std::move(own);
    HELIO_CO_TRY(co_await run_cameras());
  }
  context_.sink.frame(packed_->take());
  co_return Status{};
}

Steps Runner::run_cameras() {
  for (u32 camera = 0; camera < job_->cameras.size(); ++camera)
    HELIO_CO_TRY(co_await run_camera(camera));
  co_return Status{};
}

Steps Runner::run_camera(u32 camera) {
  camera_start_ = Clock::now();
  noise_ = NAN;
  tile_samples_ = tile_rounds_ = 0;
  HELIO_CO_TRY(co_await pause());
  Shot shot{.job = job_, .camera = camera};
  HELIO_CO_TRY(co_await make_shot(camera, shot));
  auto film = context_.backend.begin(shot);
  if (!film) co_return std::unexpected(std::move(film).error());
  Frame frame = header(camera);
  if (wants_probe(*job_)) HELIO_CO_TRY(co_await probe(**film));
  if (wants_label_columns(*job_)) HELIO_CO_TRY(co_await label(**film, frame));
  if (wants_samples(*job_))
    HELIO_CO_TRY(co_await sample(**film, frame));
  else
    HELIO_CO_TRY(emit(**film, std::move(frame), true));
  report(**film, 1, pictures_ + 1 == picture_count(*whole_));
  rays_before_ += (*film)->rays();
  ++pictures_;
  co_return Status{};
}

Steps Runner::make_shot(u32 camera, Shot& shot) {
  const double interval = flow_interval(*job_);
  const Shutter& shutter = job_->snapshot->find(job_->cameras[camera])->camera->shutter;
  const auto labels = [&](double later) { return label_span(shutter, label_time(*job_) + later); };
  if (wants_open_shutter(*job_))
    HELIO_CO_TRY(co_await prepare(shutter_span(shutter, job_->time), shot.open));
  if (wants_still(*job_)) HELIO_CO_TRY(co_await prepare(labels(0), shot.still));
  if (wants_forward(*job_)) HELIO_CO_TRY(co_await prepare(labels(interval), shot.forward));
  if (wants_backward(*job_)) HELIO_CO_TRY(co_await prepare(labels(-interval), shot.backward));
  co_return Status{};
}

Steps Runner::prepare(TimeSpan span, std::shared_ptr<const DeviceScene>& out) {
  auto scene = context_.backend.prepare(job_->snapshot, span, context_.interrupt);
  if (!scene) co_return std::unexpected(std::move(scene).error());
  out = *std::move(scene);
  co_return co_await pause();
}

Steps Runner::label(Film& film, Frame& frame) {
  HELIO_CO_TRY(co_await pause());
  auto labels = context_.backend.labels(film, context_.interrupt);
  if (!labels) co_return std::unexpected(std::move(labels).error());
  frame.labels = *std::move(labels);
  co_return Status{};
}

Steps Runner::probe(Film& film) {
  for (u32 tile = 0; tile < film.tiles();) {
    const double wanted = seconds_per_probe_ > 0 ? slice_left() / seconds_per_probe_ : 4;
    const u32 left = film.tiles() - tile;
    const u32 count = context_.backend.pauses() ? left : u32(std::clamp(wanted, 1.0, double(left)));
    const auto start = Clock::now();
    HELIO_CO_TRY(context_.backend.probe(film, tile, count, context_.interrupt));
    seconds_per_probe_ = seconds(Clock::now() - start) / count;
    tile += count;
    samples_ += u64(count) * kernels::kTilePixels;
    HELIO_CO_TRY(co_await pause());
    report(film, 0, false);
  }
  co_return Status{};
}

Steps Runner::sample(Film& film, const Frame& frame) {
  for (u32 done = 0;;) {
    const u32 count = next_pass(done);
    HELIO_CO_TRY(co_await pass(film, {0, film.tiles()}, done, count));
    done += count;
    const bool last = finished(film, done);
    if (!last && job_->stop.adaptive && done == kernels::kBlock)
      co_return co_await sample_noisy(film, frame);
    if (last || (job_->progressive && power_of_two(done))) HELIO_CO_TRY(emit(film, frame, last));
    if (last) co_return Status{};
  }
}

Steps Runner::sample_noisy(Film& film, const Frame& frame) {
  const StopRule& stop = job_->stop;
  const u64 most_rounds = stop.tile_rounds > 0 ? stop.tile_rounds : ~u64(0);
  for (u32 rounds = 1;; ++rounds) {
    const Noise noise = context_.backend.noise(film);
    noise_ = noise.mean;
    std::vector<u32> tiles = noisy_tiles(noise.tiles, film.tiles_across(), stop.noise);
    std::erase_if(tiles, [&](u32 tile) { return film.samples(tile) >= most_samples(); });
    tiles.resize(std::min(tiles.size(), most_rounds - tile_rounds_));
    const bool last = tiles.empty() || out_of_time();
    if (last || (job_->progressive && power_of_two(rounds))) HELIO_CO_TRY(emit(film, frame, last));
    if (last) co_return Status{};
    HELIO_CO_TRY(co_await round(film, tiles));
  }
}

/// A block of samples for each of the tiles, or for the first ones when time runs out.
Steps Runner::round(Film& film, const std::vector<u32>& tiles) {
  for (std::size_t i = 0; i < tiles.size() && !out_of_time();) {
    const u32 first = film.samples(tiles[i]);
    const u32 count = std::min(kernels::kBlock, most_samples() - first);
    const double fits = seconds(kReportEvery) / (seconds_per_sample_ * count);
    Tiles run{tiles[i], tiles[i] + 1};
    while (++i < tiles.size() && tiles[i] == run.end && film.samples(run.end) == first &&
           run.end - run.begin < fits)
      ++run.end;
    HELIO_CO_TRY(co_await pass(film, run, first, count));
    tile_rounds_ += run.end - run.begin;
  }
  co_return Status{};
}

u32 Runner::most_samples() const { return job_->stop.spp > 0 ? job_->stop.spp : JobLimits{}.spp; }

u32 Runner::next_pass(u32 done) const {
  const StopRule& stop = job_->stop;
  u32 count = kernels::kBlock - done % kernels::kBlock;
  if (job_->progressive || stop.seconds > 0 || stop.noise > 0)
    count = std::min(count, std::max(done, 1u));
  count = std::min(count, most_samples() - done);
  if (stop.seconds > 0 && done > 0) {
    const double budget = stop.seconds / double(job_->cameras.size());
    const double each = seconds_in_camera() / done;
    count = u32(std::clamp((budget - seconds_in_camera()) / each, 1.0, double(count)));
  }
  return count;
}

bool Runner::out_of_time() const {
  const double seconds = job_->stop.seconds;
  return seconds > 0 && seconds_in_camera() >= seconds / double(job_->cameras.size());
}

bool Runner::finished(Film& film, u32 done) {
  const StopRule& stop = job_->stop;
  if (done >= most_samples()) return true;
  if (stop.seconds > 0) {
    const double budget = stop.seconds / double(job_->cameras.size());
    if (seconds_in_camera() * (1 + 0.5 / done) >= budget) return true;
  }
  if (stop.noise > 0 && !stop.adaptive && done >= kernels::kBlock &&
      (power_of_two(done) || done % 64 == 0)) {
    noise_ = context_.backend.noise(film).mean;
    if (noise_ <= stop.noise) return true;
  }
  return false;
}

/// A pass of a backend that pauses by itself.
Steps Runner::long_pass(Film& film, WorkRange range) {
  for (;;) {
    const auto done = context_.backend.render(film, range, slice_end(), context_.interrupt);
    if (!done) co_return std::unexpected(done.error());
    if (*done) break;
    HELIO_CO_TRY(co_await pause());
  }
  const u64 taken = u64(range.tile_count) * range.sample_count;
  tile_samples_ += taken;
  samples_ += taken * kernels::kTilePixels;
  report(film, share_done(film), false);
  co_return co_await pause();
}

Steps Runner::pass(Film& film, Tiles tiles, u32 first, u32 count) {
  if (context_.backend.pauses())
    co_return co_await long_pass(film, {tiles.begin, tiles.end - tiles.begin, first, count});
  for (u32 tile = tiles.begin; tile < tiles.end;) {
    // A slice is some tiles with all samples of the pass, or one tile with some of them.
    double fits = seconds_per_sample_ > 0 ? slice_left() / seconds_per_sample_ : 1;
    const u32 wide = u32(std::clamp(fits / count, 1.0, double(tiles.end - tile)));
    for (u32 taken = 0; taken < count;) {
      fits = seconds_per_sample_ > 0 ? slice_left() / seconds_per_sample_ : 1;
      const u32 samples = u32(std::clamp(fits / wide, 1.0, double(count - taken)));
      const auto start = Clock::now();
      HELIO_CO_TRY(context_.backend.render(film, {tile, wide, first + taken, samples}, slice_end(),
                                           context_.interrupt));
      const double took = seconds(Clock::now() - start) / (double(wide) * samples);
      seconds_per_sample_ =
          std::max(took, std::min(kRemembered * seconds_per_sample_, kDearest * took));
      taken += samples;
      tile_samples_ += u64(wide) * samples;
      samples_ += u64(wide) * samples * kernels::kTilePixels;
      HELIO_CO_TRY(co_await pause());
    }
    tile += wide;
    report(film, share_done(film), false);
  }
  co_return Status{};
}

double Runner::seconds_in_camera() const { return seconds(Clock::now() - camera_start_); }

double Runner::share_done(const Film& film) const {
  const StopRule& stop = job_->stop;
  double share = stop.spp > 0 ? double(tile_samples_) / film.tiles() / stop.spp : 0;
  if (stop.seconds > 0)
    share = std::max(share, seconds_in_camera() * double(job_->cameras.size()) / stop.seconds);
  if (stop.noise > 0 && noise_ > 0) share = std::max(share, std::pow(stop.noise / noise_, 2));
  if (stop.tile_rounds > 0)
    share = std::max(share, double(tile_rounds_) / double(stop.tile_rounds));
  return std::min(share, 1.0);
}

void Runner::report(const Film& film, double done_in_camera, bool force) {
  const double used = used_before_ + in_slice();
  if (!force && used - reported_ < seconds(kReportEvery)) return;
  reported_ = used;
  const double elapsed = seconds(Clock::now() - start_);
  Progress progress;
  progress.done = (pictures_ + done_in_camera) / picture_count(*whole_);
  progress.rays_per_second = elapsed > 0 ? double(rays_before_ + film.rays()) / elapsed : 0;
  progress.eta_seconds = progress.done > 0 ? elapsed * (1 - progress.done) / progress.done : 0;
  progress.noise = noise_;
  context_.sink.progress(progress);
}

ImageCamera Runner::seen_by(EntityId camera) const {
  const Snapshot& snapshot = *job_->snapshot;
  const uvec2 size = rendered_size(*job_, camera);
  const Camera& model = *snapshot.find(camera)->camera;
  const Time middle = label_span(model.shutter, label_time(*job_)).middle();
  return image_camera(model, world_pose(snapshot, camera.index(), middle), size.x, size.y);
}

Frame Runner::header(u32 index) const {
  const Snapshot& snapshot = *job_->snapshot;
  const EntityId camera = job_->cameras[index];
  const ImageCamera image = seen_by(camera);
  Frame frame;
  frame.index = index;
  frame.scene = job_->scene;
  frame.revision = snapshot.revision;
  frame.overlay = job_->overlay;
  frame.camera = snapshot.name_of(camera);
  frame.width = image.width;
  frame.height = image.height;
  frame.time = job_->time;
  frame.label_time = label_time(*job_);
  frame.shutter = snapshot.find(camera)->camera->shutter;
  frame.seed = job_->settings.seed;
  frame.k = image.k;
  frame.camera_from_world_cv = image.camera_from_world_cv;
  if (snapshot.categories) frame.categories = *snapshot.categories;
  return frame;
}

Status Runner::emit(Film& film, Frame frame, bool final) {
  auto made = context_.backend.resolve(film);
  if (!made) return std::unexpected(std::move(made).error());
  const EntityId camera = job_->cameras[frame.index];
  const ImageCamera image = seen_by(camera);
  auto planes = finish_planes(*job_, *std::move(made),
                              {.denoiser = context_.denoiser,
                               .interrupt = context_.interrupt,
                               .model = *job_->snapshot->find(camera)->camera,
                               .camera = image,
                               .sensor_seed = sensor_seed(*job_, camera)});
  if (!planes) return std::unexpected(std::move(planes).error());
  frame.planes = *std::move(planes);
  for (u32 tile = 0; tile < film.tiles(); ++tile)
    frame.samples = std::max(frame.samples, film.samples(tile));
  frame.tile_rounds = tile_rounds_;
  if (measures_noise(*job_) && frame.samples > 1) frame.noise = context_.backend.noise(film).mean;
  frame.final = final;
  frame.render_seconds = seconds_in_camera();
  frame.rays = film.rays();
  if (packed_)
    packed_->add(std::move(frame));
  else
    context_.sink.frame(std::make_shared<const Frame>(std::move(frame)));
  return {};
}

}  // namespace heliograph
