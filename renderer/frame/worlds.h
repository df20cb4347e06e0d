// Jobs of many worlds: a job for each, and their pictures packed into one frame. Called by checks,
// the engine and the runner.
#pragma once

#include "renderer/frame/check.h"
#include "renderer/frame/frame.h"

namespace heliograph {

/// Seed of the random numbers of a world; world 0's is `seed`.
[[nodiscard]] u64 world_seed(u64 seed, u32 world);

/// The job of one world alone: the same pixels. Fails as world_of() does, `where` beneath "worlds".
[[nodiscard]] Expected<std::shared_ptr<RenderJob>> job_of_world(const RenderJob& job, u32 world);

/// Pictures of a job: cameras of its rendered worlds, or its cameras.
[[nodiscard]] u32 picture_count(const RenderJob& job);

/// Checks the worlds of a job that is fit without them, like check_job(). INVALID_ARGUMENT: not one
/// size, a stop rule but spp; RESOURCE_EXHAUSTED: too many rows of labels; what is wrong with the
/// job of one world, with its number in the message.
[[nodiscard]] Status check_worlds(const RenderJob& job, const JobLimits& limits);

/// The snapshots whose derived data a job needs. Those of its worlds that bring none are left out,
/// and those that cannot be made.
[[nodiscard]] std::vector<std::shared_ptr<const Snapshot>> needed_snapshots(const RenderJob& job);

/// One frame of many pictures, each written into its place. Picture p is camera p % C of rendered
/// world p / C.
class PackedFrame {
 public:
  explicit PackedFrame(std::shared_ptr<const RenderJob> job);

  PackedFrame(const PackedFrame&) = delete;
  PackedFrame& operator=(const PackedFrame&) = delete;

  /// Makes the planes; first. RESOURCE_EXHAUSTED: the device has no room for them.
  [[nodiscard]] Status allocate();
  /// Where the planes of the next pictures go, so many of each as are asked for. Lifetime: of this.
  [[nodiscard]] PixelAllocator memory();
  /// Takes all but the pixels, which are in their place. Pictures come in order.
  void add(Frame picture);
  [[nodiscard]] std::shared_ptr<const Frame> take();

 private:
  [[nodiscard]] std::shared_ptr<PixelMemory> place(Plane plane, u64 bytes);
  void add_labels(std::vector<Column> labels, u32 world, u32 camera);

  std::shared_ptr<const RenderJob> job_;
  std::shared_ptr<WorldPictures> pictures_ = std::make_shared<WorldPictures>();
  Frame frame_;
  u32 count_ = 0;             // pictures so far
  std::vector<bool> placed_;  // planes of the next one
};

}  // namespace heliograph
