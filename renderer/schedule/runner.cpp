// Passes, slices, stop rules and frames.
#include "renderer/schedule/runner.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "kernels/scene/film.h"
#include "renderer/frame/check.h"
#include "renderer/frame/frame_header.h"
#include "renderer/frame/shutter.h"
#include "renderer/scene/motion.h"
#include "renderer/schedule/adaptive.h"

namespace heliograph {
namespace {

/// Slices that one is as long as where nobody waits: a CPU's threads wait for each other at its
/// end.
constexpr double kAlone = 10;
/// The share of a slice after which a fresh job comes in.
constexpr double kSoon = 0.2;
/// Device time between reports: many jobs that take turns report no more than one alone would.
constexpr auto kReportEvery = std::chrono::milliseconds(100);

/// Samples per pixel before a picture may stop by its noise where light is focused: fewer may have
/// found none of it, and then none would report it.
constexpr u32 kFocused = 64;
static_assert(kFocused % kernels::kBlock == 0);
/// Samples per pixel between two looks at the noise, once there are so many.
constexpr u32 kLookEvery = 64;

/// Seconds of a core, about, to find what a world needs.
constexpr double kOfWorld = 2e-5;

double seconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

bool power_of_two(u32 x) { return (x & (x - 1)) == 0; }

}  // namespace

Runner::Runner(std::shared_ptr<const RenderJob> job, const RunnerContext& context)
    : Runner(std::move(job), nullptr, context) {}

Runner::Runner(std::shared_ptr<Spread> spread, const RunnerContext& context)
    : Runner(spread->job(), spread, context) {}

Runner::Runner(std::shared_ptr<const RenderJob> job, std::shared_ptr<Spread> helped,
               const RunnerContext& context)
    : job_(std::move(job)),
      helped_(std::move(helped)),
      context_(context),
      start_(Clock::now()),
      film_start_(start_),
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

Slice Runner::slice() const {
  const auto end_of = [this](double length) {
    return resumed_ + std::chrono::duration_cast<Clock::duration>(length * context_.slice);
  };
  return {end_of(kSoon), end_of(1), end_of(kAlone), context_.waiting};
}

double Runner::slice_left() const { return seconds(slice().ends() - Clock::now()); }

Expected<bool> Runner::counted(const Film& film, Expected<bool> is_done, u64 tile_samples) {
  in_range_ = film.share_of_range() * double(tile_samples);
  return is_done;
}

Steps Runner::run() {
  if (helped_) co_return co_await help();
  if (job_->worlds) co_return co_await run_worlds();
  co_return co_await run_cameras();
}

/// As many pictures at a time as the backend takes. The next ones are begun while it works on
/// these, where it takes several.
Steps Runner::run_worlds() {
  packed_.emplace(job_);
  HELIO_CO_TRY(packed_->allocate());
  HELIO_CO_TRY(co_await make_pieces_of_worlds());
  auto whole = std::make_shared<RenderJob>(*job_);
  whole->memory = packed_->memory();
  const u32 count = picture_count(*job_);
  u32 most = at_once();
  auto next = begin_later(whole, {0, std::min(most, count)});
  while (done_ < count) {
    film_start_ = Clock::now();
    auto begun = next.get();
    if (!begun && begun.error().code == Code::kResourceExhausted && most > 1) {
      most /= 2;
      begun_ = {};
      next = begin_later(whole, {done_, std::min(done_ + most, count)});
      continue;
    }
    if (!begun) co_return std::unexpected(std::move(begun).error());
    const u32 end = done_ + u32(begun->shots.size());
    if (end < count) next = begin_later(whole, {end, std::min(end + most, count)});
    begun_ = *std::move(begun);
    HELIO_CO_TRY(co_await run_film());
  }
  context_.sink->frame(packed_->take());
  co_return Status{};
}

Steps Runner::make_pieces_of_worlds() {
  std::vector<Errand> pieces;
  std::vector<Errand> find;
  find.push_back({.seconds = kOfWorld * picture_count(*job_), .run = [&](const Interrupt&) {
                    for (const auto& snapshot : needed_snapshots(*job_)) {
                      Preparation needed = context_.backend.preparation({snapshot, {}});
                      std::ranges::move(needed.pieces, std::back_inserter(pieces));
                    }
                  }});
  HELIO_CO_TRY(co_await elsewhere(std::move(find)));
  HELIO_CO_TRY(co_await elsewhere(std::move(pieces)));
  begun_.shots.push_back({.job = job_, .camera = 0});  // worlds start from what this has
  for (const SceneOf kind : wanted_scenes())
    HELIO_CO_TRY(co_await make_scene(begun_.shots.front(), kind));
  co_return Status{};
}

Steps Runner::run_cameras() {
  for (u32 camera = 0; camera < job_->cameras.size(); ++camera) {
    HELIO_CO_TRY(co_await begin_camera(camera));
    HELIO_CO_TRY(co_await run_film());
  }
  co_return Status{};
}

Steps Runner::begin_camera(u32 camera) {
  HELIO_CO_TRY(co_await pause());
  begun_ = {};
  begun_.shots.push_back({.job = job_, .camera = camera});
  film_start_ = Clock::now();
  for (const SceneOf kind : wanted_scenes()) {
    HELIO_CO_TRY(co_await make_scene(begun_.shots.front(), kind));
    HELIO_CO_TRY(co_await pause());
  }
  co_return begin(begun_);
}

/// All of begun_.
Steps Runner::run_film() {
  noise_ = NAN;
  tile_samples_ = tile_rounds_ = 0;
  HELIO_CO_TRY(co_await pause());
  for (Frame& frame : begun_.frames) HELIO_CO_TRY(choose_denoiser(frame));
  Film& film = *begun_.film;
  if (wants_probe(*job_)) HELIO_CO_TRY(co_await probe(film));
  if (wants_label_columns(*job_)) HELIO_CO_TRY(co_await label(film));
  if (wants_samples(*job_))
    HELIO_CO_TRY(co_await sample(film));
  else
    HELIO_CO_TRY(co_await emit(film, true));
  const u32 pictures = u32(begun_.shots.size());
  report(film, 1, done_ + pictures == picture_count(*job_));
  rays_before_ += film.rays();
  done_ += pictures;
  co_return Status{};
}

/// Before anything is rendered: what cannot be denoised where it has to stay is not begun.
Status Runner::choose_denoiser(Frame& frame) {
  if (std::ranges::count(job_->planes, Plane::DENOISED) == 0) return {};
  auto there = context_.backend.denoiser();
  if (there && !there->empty()) {
    frame.denoiser = *std::move(there);
    return {};
  }
  if (job_->on_device && there)
    return fail(Code::kUnimplemented, "planes",
                "DENOISED is made on the host here; ask for it without `memory`");
  if (job_->on_device) return std::unexpected(std::move(there).error());
  auto here = context_.denoiser.name();
  if (!here) return std::unexpected(std::move(here).error());
  frame.denoiser = *std::move(here);
  if (!there)
    frame.warnings.push_back(fmt::format("denoised by {}, as the GPU cannot: {}", frame.denoiser,
                                         there.error().message));
  return {};
}

Steps Runner::probe(Film& film) {
  for (bool is_done = false; !is_done;) {
    const auto done =
        counted(film, context_.backend.probe(film, slice(), context_.interrupt), film.tiles());
    if (!done) co_return std::unexpected(done.error());
    is_done = *done;
    HELIO_CO_TRY(co_await pause());
    report(film, 0, false);
  }
  samples_ += u64(film.tiles()) * kernels::kTilePixels;
  co_return Status{};
}

Steps Runner::sample(Film& film) {
  if (is_spread(film)) co_return co_await sample_spread(film);
  for (u32 done = 0;;) {
    const u32 count = next_pass(done);
    HELIO_CO_TRY(co_await pass(film, {0, film.tiles()}, done, count));
    done += count;
    const bool last = finished(film, done);
    if (!last && job_->stop.adaptive && done == least_samples())
      co_return co_await sample_noisy(film);
    if (last || (job_->progressive && power_of_two(done))) HELIO_CO_TRY(co_await emit(film, last));
    if (last) co_return Status{};
  }
}

Steps Runner::sample_noisy(Film& film) {
  const StopRule& stop = job_->stop;
  const u64 most_rounds = stop.tile_rounds > 0 ? stop.tile_rounds : ~u64(0);
  for (u32 rounds = 1;; ++rounds) {
    const Noise noise = noise_of(film);
    noise_ = noise.mean;
    std::vector<u32> tiles = noisy_tiles(noise.tiles, film.tiles_across(), stop.noise);
    std::erase_if(tiles, [&](u32 tile) { return film.samples(tile) >= most_samples(); });
    tiles.resize(std::min(tiles.size(), most_rounds - tile_rounds_));
    const bool last = tiles.empty() || out_of_time();
    if (last || (job_->progressive && power_of_two(rounds)))
      HELIO_CO_TRY(co_await emit(film, last));
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

Noise Runner::noise_of(const Film& film) const {
  return run_on(context_.backend, [&] { return film.noise(); });
}

u32 Runner::least_samples() const {
  const Shot& shot = begun_.shots.front();
  const auto& scene = shot.open ? shot.open : shot.still;
  return scene && scene->summary().focused ? kFocused : kernels::kBlock;
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
    const double each = seconds_in_film() / done;
    count = u32(std::clamp((budget - seconds_in_film()) / each, 1.0, double(count)));
  }
  return count;
}

bool Runner::out_of_time() const {
  const double seconds = job_->stop.seconds;
  return seconds > 0 && seconds_in_film() >= seconds / double(job_->cameras.size());
}

bool Runner::finished(Film& film, u32 done) {
  const StopRule& stop = job_->stop;
  if (done >= most_samples()) return true;
  if (stop.seconds > 0) {
    const double budget = stop.seconds / double(job_->cameras.size());
    if (seconds_in_film() * (1 + 0.5 / done) >= budget) return true;
  }
  if (stop.noise > 0 && !stop.adaptive && done >= least_samples() &&
      (power_of_two(done) || done % kLookEvery == 0)) {
    noise_ = noise_of(film).mean;
    if (noise_ <= stop.noise) return true;
  }
  return false;
}

Steps Runner::pass(Film& film, Tiles tiles, u32 first, u32 count) {
  const WorkRange range{tiles.begin, tiles.end - tiles.begin, first, count};
  const u64 taken = u64(range.tile_count) * count;
  const double before = used_before_ + in_slice();
  for (;;) {
    const auto done =
        counted(film, context_.backend.render(film, range, slice(), context_.interrupt), taken);
    if (!done) co_return std::unexpected(done.error());
    if (*done) break;
    report(film, share_done(film), false);
    HELIO_CO_TRY(co_await pause());
  }
  seconds_per_sample_ = (used_before_ + in_slice() - before) / double(taken);
  tile_samples_ += taken;
  samples_ += taken * kernels::kTilePixels;
  report(film, share_done(film), false);
  co_return co_await pause();
}

double Runner::seconds_in_film() const { return seconds(Clock::now() - film_start_); }

double Runner::share_done(const Film& film) const {
  const StopRule& stop = job_->stop;
  double share = stop.spp > 0 ? (double(tile_samples_) + in_range_) / film.tiles() / stop.spp : 0;
  if (stop.seconds > 0)
    share = std::max(share, seconds_in_film() * double(job_->cameras.size()) / stop.seconds);
  if (stop.noise > 0 && noise_ > 0) share = std::max(share, std::pow(stop.noise / noise_, 2));
  if (stop.tile_rounds > 0)
    share = std::max(share, double(tile_rounds_) / double(stop.tile_rounds));
  return std::min(share, 1.0);
}

void Runner::report(const Film& film, double done_in_film, bool force) {
  if (!context_.sink) return;
  const double used = used_before_ + in_slice();
  if (!force && used - reported_ < seconds(kReportEvery)) return;
  reported_ = used;
  const double elapsed = seconds(Clock::now() - start_);
  Progress progress;
  progress.done = (done_ + done_in_film * double(begun_.shots.size())) / picture_count(*job_);
  progress.rays_per_second = elapsed > 0 ? double(rays_before_ + film.rays()) / elapsed : 0;
  progress.eta_seconds = progress.done > 0 ? elapsed * (1 - progress.done) / progress.done : 0;
  progress.noise = noise_;
  context_.sink->progress(progress);
}

}  // namespace heliograph
