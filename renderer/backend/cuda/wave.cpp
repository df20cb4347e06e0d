#include "renderer/backend/cuda/wave.h"

#include <algorithm>
#include <chrono>
#include <string>
#include <utility>

namespace heliograph::cuda {
namespace {

using kernels::Plane;

// Tiles of one sample in the batches of a range's waves together.
constexpr u32 kMostTiles = (1 << 24) / kernels::kTilePixels;
constexpr u32 kTilesAtFirst = kItemsAtFirst / kernels::kTilePixels;
/// How long a batch is to take: larger ones take less time a sample, and keep others waiting.
constexpr double kBatchSeconds = 0.05;
constexpr u64 kMemoryShare = 16;  // they take one in so many bytes of the budget, or less
constexpr u64 kLeastMemory = 1 << 20;
/// Between looks at the counters, which wait for the device.
constexpr u32 kMostRoundsAtOnce = 8;
constexpr u32 kMostItemsAtOnce = 1 << 24;  // times rounds

bool has_rich_samples(const kernels::FilmView& film) {
  return (film.wanted & kernels::planes_from<kernels::SampleRich>()) != 0;
}

}  // namespace

Expected<Programs> Programs::find(const Context& context) {
  Programs programs;
  std::vector<std::pair<std::string, Program*>> all{{"probe", &programs.probe},
                                                    {"probe_later", &programs.probe_later},
                                                    {"film_resolve", &programs.resolve},
                                                    {"film_noise", &programs.noise}};
  for (const bool many : {false, true})
    for (const bool plain : {false, true}) {
      Steps& steps = plain  ? many ? programs.many_plain : programs.one_plain
                     : many ? programs.many
                            : programs.one;
      const std::string count = many ? "_many" : "", kind = plain ? "_plain" : "";
      all.insert(all.end(), {{"wave_begin" + count + kind, &steps.begin},
                             {"wave_arrive" + count + kind, &steps.arrive},
                             {"wave_trace" + count + kind, &steps.trace},
                             {"wave_fold" + count, &steps.fold}});
    }
  for (const auto& [name, program] : all) {
    auto function = context.function(name.c_str());
    if (!function) return std::unexpected(std::move(function).error());
    const auto threads = context.block_threads(*function);
    if (!threads) return std::unexpected(threads.error());
    *program = {*function, *threads,
                context.processors() * context.resident_blocks(*function, *threads)};
  }
  return programs;
}

LaunchSize Programs::size(const Program& program, u64 threads) {
  return {
      u32(std::min<u64>((threads + program.threads - 1) / program.threads, program.most_blocks)),
      program.threads};
}

namespace {

Programs::Steps steps_of(const Programs& programs, const WaveShots& shots) {
  const Programs::Steps& plain = shots.device ? programs.many_plain : programs.one_plain;
  const Programs::Steps& rich = shots.device ? programs.many : programs.one;
  const auto is_plain = [](const WaveShot& shot) { return kernels::is_plain(shot.view); };
  const auto has_plain_rays = [](const WaveShot& shot) { return shot.view.scene.plain_rays; };
  Programs::Steps steps = std::ranges::all_of(shots.host, is_plain) ? plain : rich;
  steps.trace = (std::ranges::all_of(shots.host, has_plain_rays) ? plain : rich).trace;
  return steps;
}

}  // namespace

WorkRange WavePart::of(WorkRange range) const {
  const auto end_of = [&](u32 i) { return u32(u64(range.tile_count) * i / count); };
  range.first_tile += end_of(index);
  range.tile_count = end_of(index + 1) - end_of(index);
  return range;
}

Wave::Wave(Context& context, const Programs& programs, const WaveShots& shots,
           const WorkRange& range, const WavePart& part)
    : context_(context),
      steps_(steps_of(programs, shots)),
      range_(part.of(range)),
      part_(part),
      lane_(part.index == 0 ? Lane::kMain : Lane::kAside) {
  launch_.shot = shots.host.front();
  launch_.shots = shots.device;
  launch_.counters = &shots.counters->waves[part.index];
  launch_.rays = &shots.counters->rays;
  for (const WaveShot& shot : shots.host) any_media_ |= shot.view.scene.any_media;
}

Status Wave::allocate() {
  for (u64 memory = context_.budget().bytes() / kMemoryShare / part_.count;; memory /= 2) {
    const Status status = allocate(memory);
    const bool is_smallest = memory <= kLeastMemory;
    if (status || status.error().code != Code::kResourceExhausted || is_smallest) return status;
  }
}

Status Wave::allocate(u64 memory) {
  memory_ = {};
  launch_.wave.film = launch_.shot.view.film;
  launch_.wave.film.height = 1;
  Layout tile(0);
  lay(tile, kernels::kTilePixels);
  const u32 fit = u32(std::clamp<u64>(memory / tile.bytes(), 1, kMostTiles / part_.count));
  const u32 at_first = std::min(fit, kTilesAtFirst / part_.count);
  batch_tiles_ = std::min(range_.tile_count, at_first);
  most_samples_ = std::clamp(fit / batch_tiles_, 1u, range_.sample_count);
  batch_samples_ = std::clamp(at_first / batch_tiles_, 1u, most_samples_);
  const u64 items = u64(batch_tiles_) * most_samples_ * kernels::kTilePixels;

  Layout size(0);
  lay(size, items);
  auto made = context_.allocate(size.bytes());
  if (!made) return std::unexpected(std::move(made).error());
  memory_ = *std::move(made);
  Layout layout(memory_.at());
  lay(layout, items);
  return {};
}

void Wave::lay(Layout& layout, u64 items) {
  kernels::WaveView& wave = launch_.wave;
  wave.film.width = u32(items);
  wave.paths = layout.take<kernels::PathState>(items);
  wave.rays = layout.take<kernels::PathRay>(items);
  wave.hits = layout.take<kernels::WaveHit>(items);
  wave.lights = layout.take<kernels::WaveLight>(items);
  if (any_media_) wave.insides = layout.take<kernels::Inside>(items);
  if (any_media_) wave.reaches = layout.take<kernels::Reach>(items);
  wave.samples = layout.take<kernels::WaveSample>(items);
  wave.firsts = layout.take<kernels::WaveFirst>(items);
  if (has_rich_samples(wave.film)) {
    wave.riches = layout.take<kernels::SampleRich>(items);
    wave.routes = layout.take<kernels::WaveRoute>(2 * items);
  }
  if (kernels::wants(wave.film, Plane::BEAUTY_GROUP))
    wave.film.partial[u32(Plane::BEAUTY_GROUP)] = layout.take<float>(items * 3 * wave.film.groups);
  for (u32*& queue : launch_.active) queue = layout.take<u32>(items);
  launch_.arrived = layout.take<u32>(items);
  launch_.lit = layout.take<u32>(items);
}

Status Wave::launch(const Programs::Program& program, u64 threads) {
  void* arguments[] = {&launch_};
  return context_.launch(program.function, Programs::size(program, threads), arguments, lane_);
}

Status Wave::fill(WaveRound* at, u64 bytes) {
  return context_.fill(DevicePointer(at), 0, bytes, lane_);
}

/// By all warps that there are, however few rays: they share them out.
Status Wave::trace() {
  const Programs::Program& program = steps_.trace;
  return launch(program, u64(program.most_blocks) * program.threads);
}

Status Wave::begin_batch() {
  const u32 left = range_.sample_count - next_sample_;
  const u32 batches = (left + batch_samples_ - 1) / batch_samples_;  // none is to be small
  launch_.work = {range_.first_tile + next_tile_,
                  std::min(batch_tiles_, range_.tile_count - next_tile_),
                  range_.first_sample + next_sample_, (left + batches - 1) / batches};
  launch_.round = 0;
  in_batch_ = true;
  batch_began_ = std::chrono::steady_clock::now();
  const kernels::FilmView& items = launch_.wave.film;
  if (kernels::wants(items, Plane::BEAUTY_GROUP)) {
    const auto at = DevicePointer(items.partial[u32(Plane::BEAUTY_GROUP)]);
    HELIO_TRY(context_.fill(at, 0, u64(items.width) * items.groups * sizeof(vec3), lane_));
  }
  HELIO_TRY(fill(launch_.counters->rounds, sizeof(WaveCounters)));
  return launch(steps_.begin, kernels::items_of(launch_.work));
}

Status Wave::round() {
  HELIO_TRY(fill(&launch_.counters->rounds[1 - launch_.round], sizeof(WaveRound)));
  HELIO_TRY(trace());
  HELIO_TRY(launch(steps_.arrive, kernels::items_of(launch_.work)));
  launch_.round = 1 - launch_.round;
  return {};
}

Status Wave::fold() {
  HELIO_TRY(launch(steps_.fold, kernels::pixels_of(launch_.work)));
  in_batch_ = false;
  next_sample_ += launch_.work.samples;
  const std::chrono::duration<double> took = std::chrono::steady_clock::now() - batch_began_;
  const double samples = launch_.work.samples * (kBatchSeconds / took.count());
  batch_samples_ = u32(std::clamp(samples, 1.0, double(most_samples_)));
  if (next_sample_ < range_.sample_count) return {};
  next_sample_ = 0;
  next_tile_ += launch_.work.tiles;
  return {};
}

Status Wave::start() {
  if (is_done()) return {};
  if (!in_batch_) HELIO_TRY(begin_batch());
  const u32 most = std::clamp(launch_.shot.view.settings.max_depth, 1u, kMostRoundsAtOnce);
  const u32 rounds = std::clamp(kMostItemsAtOnce / kernels::items_of(launch_.work), 1u, most);
  for (u32 i = 0; i < rounds; ++i) HELIO_TRY(round());
  is_started_ = true;
  return {};
}

Status Wave::finish() {
  if (!std::exchange(is_started_, false)) return {};
  WaveRound next{};
  HELIO_TRY(context_.download(std::as_writable_bytes(std::span(&next, 1)),
                              DevicePointer(&launch_.counters->rounds[launch_.round]), lane_));
  return next.active == 0 && next.lights == 0 ? fold() : Status{};
}

}  // namespace heliograph::cuda
