#include "renderer/schedule/spread.h"

#include <algorithm>

#include "renderer/frame/film_planes.h"

namespace heliograph {
namespace {

/// A run is no shorter than this, so that a device that works on many tiles at once is busy.
constexpr u32 kLeastTiles = 256;

}  // namespace

std::shared_ptr<const RenderJob> sampled_job(const RenderJob& job) {
  auto sampled = std::make_shared<RenderJob>(job);
  sampled->planes = film_planes(job);
  std::erase_if(sampled->planes,
                [](Plane plane) { return plane_info(plane).fold == kernels::Fold::kCentre; });
  sampled->labels = {};
  sampled->disparity_camera = {};
  sampled->memory = {};
  sampled->on_device = false;
  return sampled;
}

Spread::Claim::~Claim() {
  if (of_) of_->give_back(tiles_);
}

void Spread::Claim::done() {
  of_->finish(tiles_, std::nullopt);
  of_.reset();
}

void Spread::Claim::deliver(FilmPart part) {
  of_->finish(tiles_, std::move(part));
  of_.reset();
}

Spread::Spread(std::shared_ptr<const RenderJob> job, u32 camera, u32 tiles, u32 tiles_across)
    : job_(std::move(job)),
      camera_(camera),
      tiles_across_(tiles_across),
      left_{{0, tiles}},
      left_tiles_(tiles),
      missing_tiles_(tiles) {}

bool Spread::join(u32 device) {
  const std::scoped_lock lock(mutex_);
  return helpers_.insert(device).second;
}

void Spread::leave(u32 device) {
  const std::scoped_lock lock(mutex_);
  helpers_.erase(device);
}

std::optional<Spread::Claim> Spread::claim(const std::shared_ptr<Spread>& spread) {
  const auto tiles = spread->take();
  if (!tiles) return {};
  return Claim(spread, *tiles);
}

std::optional<TileRun> Spread::take() {
  const std::scoped_lock lock(mutex_);
  if (left_.empty()) return {};
  const u32 devices = u32(helpers_.size()) + 1;
  const u32 fair = std::max(left_tiles_ / (2 * devices), kLeastTiles);
  const u32 rows = (fair + tiles_across_ - 1) / tiles_across_;
  TileRun& run = left_.front();
  const TileRun taken{run.first, std::min(rows * tiles_across_, run.count)};
  run.first += taken.count;
  run.count -= taken.count;
  if (run.count == 0) left_.pop_front();
  left_tiles_ -= taken.count;
  return taken;
}

void Spread::give_back(TileRun tiles) {
  {
    const std::scoped_lock lock(mutex_);
    left_.push_back(tiles);
    left_tiles_ += tiles.count;
  }
  changed_.notify_all();
}

void Spread::finish(const TileRun& tiles, std::optional<FilmPart> part) {
  {
    const std::scoped_lock lock(mutex_);
    missing_tiles_ -= tiles.count;
    if (part) parts_.push_back(*std::move(part));
  }
  changed_.notify_all();
}

std::vector<FilmPart> Spread::collect() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(parts_, {});
}

bool Spread::is_complete() const {
  const std::scoped_lock lock(mutex_);
  return missing_tiles_ == 0;
}

void Spread::wait(TimePoint until) {
  std::unique_lock lock(mutex_);
  changed_.wait_until(lock, until,
                      [&] { return !left_.empty() || !parts_.empty() || missing_tiles_ == 0; });
}

}  // namespace heliograph
