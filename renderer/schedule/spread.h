// One picture by several devices: who renders which of its tiles. Used by the runners of a job's
// device and of those that help it.
#pragma once

#include <condition_variable>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <stop_token>
#include <vector>

#include "renderer/device/backend.h"

namespace heliograph {

/// Part of a job that other devices do: its mean planes, of which they render some tiles.
[[nodiscard]] std::shared_ptr<const RenderJob> sampled_job(const RenderJob& job);

/// The tiles of a picture that wait for their samples. Devices claim runs of them, shorter ones
/// towards the end (guided self-scheduling, Polychronopoulos and Kuck 1987), so that they end
/// together. Thread: any.
class Spread {
 public:
  /// A run of whole rows that its owner renders. Goes back to the others where it is given up.
  class Claim {
   public:
    Claim(std::shared_ptr<Spread> of, TileRun tiles) : of_(std::move(of)), tiles_(tiles) {}
    Claim(Claim&& other) noexcept = default;
    Claim& operator=(Claim&&) = delete;
    ~Claim();
    [[nodiscard]] const TileRun& tiles() const { return tiles_; }
    /// Marks them as in the job's film.
    void done();
    /// Hands over their sums, which are not in the film yet: collect() has them.
    void deliver(FilmPart part);

   private:
    std::shared_ptr<Spread> of_;  // null: done
    TileRun tiles_;
  };

  /// job     what helpers render, of its camera number `camera`
  Spread(std::shared_ptr<const RenderJob> job, u32 camera, u32 tiles, u32 tiles_across);

  [[nodiscard]] const std::shared_ptr<const RenderJob>& job() const { return job_; }
  [[nodiscard]] u32 camera() const { return camera_; }
  /// Stops helpers. The job has ended.
  void close() { closed_.request_stop(); }
  [[nodiscard]] std::stop_token closed() const { return closed_.get_token(); }

  /// Has a device help; false where it does already, or has failed to.
  [[nodiscard]] bool join(u32 device);
  /// Lets it be asked again.
  void leave(u32 device);

  /// Nothing when all are claimed.
  [[nodiscard]] static std::optional<Claim> claim(const std::shared_ptr<Spread>& spread);
  /// Takes what was delivered since the last call.
  [[nodiscard]] std::vector<FilmPart> collect();
  /// True if every tile is done or was delivered.
  [[nodiscard]] bool is_complete() const;
  /// Returns when something is delivered or given up, or then.
  void wait(TimePoint until);

 private:
  [[nodiscard]] std::optional<TileRun> take();
  void give_back(TileRun tiles);
  void finish(const TileRun& tiles, std::optional<FilmPart> part);

  const std::shared_ptr<const RenderJob> job_;
  const u32 camera_, tiles_across_;
  std::stop_source closed_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::list<TileRun> left_;
  u32 left_tiles_, missing_tiles_;
  std::set<u32> helpers_;
  std::vector<FilmPart> parts_;
};

}  // namespace heliograph
