// One job from its snapshot to its last frame, in slices. Called by the engine's device thread.
#pragma once

#include <functional>

#include "renderer/engine/engine.h"
#include "renderer/engine/post.h"

namespace heliograph {

/// How a runner is paced and stopped.
struct RunnerContext {
  Backend& backend;
  Denoiser& denoiser;
  JobSink& sink;
  const Interrupt& interrupt;
  std::chrono::duration<double> slice;  // the longest time without a call of `between`
  std::function<Status()> between;      // an error ends the job with it
};

class Runner {
 public:
  Runner(std::shared_ptr<const RenderJob> job, const RunnerContext& context);
  [[nodiscard]] Status run();

 private:
  using Clock = std::chrono::steady_clock;
  [[nodiscard]] Status run_camera(u32 camera);
  [[nodiscard]] Expected<Shot> make_shot(u32 camera);
  [[nodiscard]] Status probe(Film& film);
  struct Tiles {
    u32 begin, end;
  };
  [[nodiscard]] Status sample(Film& film, const Frame& frame);
  [[nodiscard]] Status sample_noisy(Film& film, const Frame& frame);
  [[nodiscard]] Status round(Film& film, const std::vector<u32>& tiles);
  [[nodiscard]] Status pass(Film& film, Tiles tiles, u32 first, u32 count);
  [[nodiscard]] u32 most_samples() const;
  [[nodiscard]] u32 next_pass(u32 done) const;
  [[nodiscard]] bool out_of_time() const;
  [[nodiscard]] bool finished(Film& film, u32 done);
  [[nodiscard]] Status emit(Film& film, Frame frame, bool final);
  [[nodiscard]] ImageCamera seen_by(EntityId camera) const;
  [[nodiscard]] Frame header(u32 camera) const;
  [[nodiscard]] Status pause();
  void report(const Film& film, double done_in_camera, bool force);
  [[nodiscard]] double share_done(const Film& film) const;
  [[nodiscard]] double seconds_in_camera() const;

  std::shared_ptr<const RenderJob> job_;
  RunnerContext context_;
  Clock::time_point start_, camera_start_, reported_;
  u32 camera_ = 0;
  u64 rays_before_ = 0;            // of the cameras that are done
  double noise_;                   // the latest estimate
  u64 tile_samples_ = 0;           // of this camera, summed over its tiles
  u64 tile_rounds_ = 0;            // of this camera, adaptive
  double seconds_per_sample_ = 0;  // of one sample of a whole tile
  double seconds_per_probe_ = 0;   // of one tile
};

}  // namespace heliograph
