// The accumulating image of one shot, and the work on it.
#pragma once

#include <atomic>
#include <cstdlib>

#include "renderer/backend/embree/pixel_loop.h"
#include "renderer/backend/embree/top_level.h"
#include "renderer/engine/image_camera.h"

namespace heliograph::embree {

inline constexpr u32 kTileSize = 16;

/// Zeroed memory that costs nothing until it is touched.
struct Free {
  void operator()(void* memory) const { std::free(memory); }
};
using ZeroedMemory = std::unique_ptr<void, Free>;

/// A scene and a camera in it, over the same span of time.
struct Sight {
  std::shared_ptr<const ResidentScene> scene;  // null: not wanted
  kernels::CameraView camera{};
  std::vector<kernels::MotionKey> keys;  // of the camera
};

/// A flow end: what is seen there, and the instances with kFlowInvalid set.
struct FlowEnd {
  Sight sight;
  std::vector<kernels::InstanceView> instances;
  std::vector<kernels::VolumeView> volumes;
  kernels::SceneView view{};
  bool camera_jumped = false;  // or was not there: it has no flow
};

class EmbreeFilm final : public Film {
 public:
  /// Fails with RESOURCE_EXHAUSTED when there is no memory for the planes.
  [[nodiscard]] static Expected<std::unique_ptr<EmbreeFilm>> create(const Shot& shot);

  [[nodiscard]] u32 tiles() const override { return tiles_x_ * tiles_y_; }
  [[nodiscard]] u32 tiles_across() const override { return tiles_x_; }
  [[nodiscard]] u32 samples(u32 tile) const override { return tile_samples_[tile]; }
  void set_samples(u32 tile, u32 samples) { tile_samples_[tile] = samples; }
  [[nodiscard]] u64 rays() const override { return rays_.load(std::memory_order_relaxed); }
  void add_rays(u64 rays) { rays_.fetch_add(rays, std::memory_order_relaxed); }
  /// The pixels of a tile.
  [[nodiscard]] PixelRect tile(u32 index) const;

  [[nodiscard]] const RenderJob& job() const { return *shot_.job; }
  [[nodiscard]] const kernels::FilmView& view() const { return view_; }
  /// What labels see.
  [[nodiscard]] const Sight& labels() const { return still_; }
  [[nodiscard]] const ImageCamera& image_camera() const { return image_camera_; }
  /// Beauty and the other mean planes; beauty_still.
  [[nodiscard]] std::vector<RenderTask> render_tasks() const;
  [[nodiscard]] ProbeTask probe_task() const;
  /// rank: which of the planes of this kind, in the order of the job.
  [[nodiscard]] PlaneData resolve(Plane plane, u32 rank) const;
  [[nodiscard]] Noise noise() const;

 private:
  explicit EmbreeFilm(const Shot& shot);
  [[nodiscard]] ImageCamera camera_at(EntityId camera, Time time) const;
  /// Sets what a camera sees, but for its shutter.
  void look(Sight& sight, EntityId camera, const std::shared_ptr<const DeviceScene>& scene) const;
  void set_end(FlowEnd& end, const std::shared_ptr<const DeviceScene>& scene);
  [[nodiscard]] bool allocate();
  void set_still_view();
  [[nodiscard]] void* zeroed(u64 bytes);
  template <class F>
  void for_each_tile(F&& visit) const;
  /// Channel i, counted over pixels, of a plane that is averaged or read from the film.
  [[nodiscard]] float value(Plane plane, u64 i, u32 samples) const;
  void set_groups();

  Shot shot_;
  ImageCamera image_camera_;  // at the label time, of the middle row
  Sight open_, still_, disparity_;
  FlowEnd forward_, backward_;
  kernels::FilmView view_{};
  kernels::FilmView still_view_{};  // the plane beauty_still in the place of beauty
  std::vector<ZeroedMemory> memory_;
  std::vector<u32> rank_of_group_;
  u32 tiles_x_, tiles_y_;
  std::vector<u32> tile_samples_;
  std::atomic<u64> rays_{0};
};

}  // namespace heliograph::embree
