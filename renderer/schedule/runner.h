// One job from its snapshot to its last frame, in slices. Called by the engine's device thread.
#pragma once

#include <future>

#include "kernels/scene/film.h"
#include "renderer/frame/worlds.h"
#include "renderer/post/post.h"
#include "renderer/schedule/engine.h"
#include "renderer/schedule/spread.h"
#include "renderer/schedule/steps.h"

namespace heliograph {

/// The devices beside the one that has a job.
class Others {
 public:
  virtual ~Others() = default;
  /// Has those that have nothing to do render tiles of a picture, each with help().
  virtual void invite(const std::shared_ptr<Spread>& spread) = 0;
};

/// Pace and stop of a runner.
struct RunnerContext {
  Backend& backend;
  Denoiser& denoiser;
  JobSink* sink;  // null: of a helper
  const Interrupt& interrupt;
  std::chrono::duration<double> slice;   // between two pauses, where somebody waits
  const WaitingJobs* waiting = nullptr;  // Slice::waiting
  Others* others = nullptr;              // null: there are none
  u64 spread_samples = ~u64(0);          // EngineOptions::spread_samples
};

class Runner {
 public:
  Runner(std::shared_ptr<const RenderJob> job, const RunnerContext& context);
  /// Renders tiles of another runner's picture, until none is left to claim.
  Runner(std::shared_ptr<Spread> spread, const RunnerContext& context);
  Runner(const Runner&) = delete;
  Runner& operator=(const Runner&) = delete;

  /// Runs on for a slice. True when the job is done; then result() has its status.
  [[nodiscard]] bool step();
  /// Takes what is to be done away from the device before the next step.
  [[nodiscard]] std::vector<Errand> take_errands() { return std::exchange(errands_, {}); }
  [[nodiscard]] const Status& result() const { return steps_.result(); }
  [[nodiscard]] u64 rays() const { return rays_before_; }
  /// Samples of all pixels; a centre plane's ray counts as one.
  [[nodiscard]] u64 samples() const {
    return samples_ + u64(in_range_ * double(kernels::kTilePixels));
  }
  /// Seconds of devices that helped.
  [[nodiscard]] double helper_seconds() const { return helper_seconds_; }

 private:
  using Clock = std::chrono::steady_clock;
  using SceneOf = std::shared_ptr<const DeviceScene> Shot::*;
  Runner(std::shared_ptr<const RenderJob> job, std::shared_ptr<Spread> helped,
         const RunnerContext& context);
  [[nodiscard]] Steps run();
  [[nodiscard]] Steps run_cameras();
  [[nodiscard]] Steps run_worlds();
  [[nodiscard]] Steps make_pieces_of_worlds();
  /// Number of pictures of worlds that go into one film.
  [[nodiscard]] u32 at_once() const;
  /// One film that nothing is rendered of, and its pictures.
  struct Begun {
    std::vector<Shot> shots;
    std::unique_ptr<Film> film;
    std::vector<Frame> frames;  // without pixels
  };
  struct PictureRange {
    u32 begin, end;
  };
  [[nodiscard]] std::future<Expected<Begun>> begin_later(std::shared_ptr<const RenderJob> whole,
                                                         PictureRange range);
  [[nodiscard]] Expected<Begun> begin_worlds(const RenderJob& whole, PictureRange range) const;
  [[nodiscard]] Expected<std::vector<Shot>> shots_of(const RenderJob& whole,
                                                     PictureRange range) const;
  [[nodiscard]] Status begin(Begun& begun) const;
  [[nodiscard]] Steps begin_camera(u32 camera);
  [[nodiscard]] Steps make_scene(Shot& shot, SceneOf kind);
  [[nodiscard]] Steps help();
  [[nodiscard]] Steps run_film();
  [[nodiscard]] Status choose_denoiser(Frame& frame);
  [[nodiscard]] std::vector<SceneOf> wanted_scenes() const;
  [[nodiscard]] Status prepare(std::vector<Shot>& shots, SceneOf kind) const;
  [[nodiscard]] static std::shared_ptr<const DeviceScene> known_scene(const Shot& shot,
                                                                      const TimeSpan& span);
  [[nodiscard]] static TimeSpan span_of(const Shot& shot, SceneOf kind);
  [[nodiscard]] Steps label(Film& film);
  [[nodiscard]] Steps probe(Film& film);
  struct Tiles {
    u32 begin, end;
  };
  [[nodiscard]] Steps sample(Film& film);
  [[nodiscard]] bool is_spread(const Film& film) const;
  [[nodiscard]] Steps sample_spread(Film& film);
  [[nodiscard]] Steps sample_run(Film& film, TileRun run);
  [[nodiscard]] Status put_parts(Film& film, Spread& spread);
  [[nodiscard]] Steps sample_noisy(Film& film);
  [[nodiscard]] Steps round(Film& film, const std::vector<u32>& tiles);
  [[nodiscard]] Steps pass(Film& film, Tiles tiles, u32 first, u32 count);
  [[nodiscard]] Noise noise_of(const Film& film) const;
  /// Per pixel, before noise decides.
  [[nodiscard]] u32 least_samples() const;
  [[nodiscard]] u32 most_samples() const;
  [[nodiscard]] u32 next_pass(u32 done) const;
  [[nodiscard]] bool out_of_time() const;
  [[nodiscard]] bool finished(Film& film, u32 done);
  [[nodiscard]] Steps emit(Film& film, bool final);
  [[nodiscard]] Expected<std::vector<PlaneData>> finish(const Shot& shot,
                                                        std::vector<PlaneData> made);
  /// Adds the remarks on a frame whose planes are made.
  void remark(const Shot& shot, Frame& frame) const;
  /// Where the job may be left until the next step(), once the slice is used up or nearly so.
  struct Pause {
    Runner& runner;
    [[nodiscard]] bool await_ready() const;
    void await_suspend(std::coroutine_handle<> here) const { runner.paused_ = here; }
    [[nodiscard]] Status await_resume() const { return runner.context_.interrupt.status(); }
  };
  [[nodiscard]] Pause pause() { return {*this}; }
  /// Where the job waits for errands.
  struct Elsewhere {
    Runner& runner;
    [[nodiscard]] bool await_ready() const { return runner.errands_.empty(); }
    void await_suspend(std::coroutine_handle<> here) const { runner.paused_ = here; }
    [[nodiscard]] Status await_resume() const { return runner.context_.interrupt.status(); }
  };
  [[nodiscard]] Elsewhere elsewhere(std::vector<Errand> errands) {
    errands_ = std::move(errands);
    return {*this};
  }
  /// Work on a film, here or elsewhere, as DeviceInfo::finishes_elsewhere allows.
  [[nodiscard]] bool is_worth_leaving(double seconds) const;
  [[nodiscard]] double in_slice() const;  // seconds, so far
  [[nodiscard]] Slice slice() const;
  [[nodiscard]] double slice_left() const;  // seconds
  /// Notes how much is done of a range of so many samples of tiles.
  [[nodiscard]] Expected<bool> counted(const Film& film, Expected<bool> is_done, u64 tile_samples);
  void report(const Film& film, double done_in_film, bool force);
  [[nodiscard]] double share_done(const Film& film) const;
  [[nodiscard]] double seconds_in_film() const;

  const std::shared_ptr<const RenderJob> job_;
  const std::shared_ptr<Spread> helped_;  // null: it helps nobody
  std::optional<PackedFrame> packed_;     // of worlds
  RunnerContext context_;
  Clock::time_point start_, film_start_;
  Begun begun_;          // what is worked on
  u32 done_ = 0;         // pictures
  u64 rays_before_ = 0;  // of these
  u64 samples_ = 0;
  double noise_;                   // the latest estimate
  u64 tile_samples_ = 0;           // of this film, summed over its tiles
  double in_range_ = 0;            // the same of a range that is not done
  u64 tile_rounds_ = 0;            // of this film, adaptive
  double seconds_per_sample_ = 0;  // of one sample of a whole tile, lately
  Clock::time_point resumed_;
  double helper_seconds_ = 0;
  double used_before_ = 0;  // seconds of the device, in the slices before this one
  double reported_ = 0;     // of them, when the last progress was reported
  std::vector<Errand> errands_;
  std::coroutine_handle<> paused_;
  Steps steps_;
};

}  // namespace heliograph
