// The accumulating image of one shot in the host's memory, and the work on it. Kept by backends,
// whose devices write its pixels there or have them copied there.
#pragma once

#include <atomic>
#include <cstdlib>
#include <unordered_map>

#include "renderer/frame/image_camera.h"
#include "renderer/host/tasks.h"
#include "renderer/resident/scene.h"

namespace heliograph::host {

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

/// Zeroed memory that costs nothing until it is touched.
struct Free {
  void operator()(void* memory) const { std::free(memory); }
};
using ZeroedMemory = std::unique_ptr<std::byte, Free>;

/// The memory of a film's arrays, one after another: a device with memory of its own allocates and
/// copies as many bytes, and leaves out what did not change. Zero at the start.
struct FilmMemory {
  std::span<std::byte> sums;     // written by samples: planes of the folds kMean and kFilm
  std::span<std::byte> centres;  // written by probes: planes of the fold kCentre
};

/// A stretch of the sums' memory.
struct SumRange {
  u64 offset = 0;
  u64 bytes = 0;
};

/// One of the pictures of a film.
struct PictureOf {
  u32 number = 0, count = 1;
};

/// Memory of all planes of film_planes(), not filled in.
[[nodiscard]] std::vector<PlaneData> new_planes(const RenderJob& job, u64 pixels);
/// Places for planes of the folds kMean and kFilm, given new_planes().
[[nodiscard]] std::vector<kernels::PlaneOut> outs(std::vector<PlaneData>& planes);

/// Thread: one at a time, but for rays() and add_rays(). Pixels are read by resolve() and noise()
/// alone, and may be written by anyone before.
class HostFilm final : public Film {
 public:
  /// Fails with RESOURCE_EXHAUSTED when there is no memory for the planes.
  [[nodiscard]] static Expected<std::unique_ptr<HostFilm>> create(const Shot& shot);

  [[nodiscard]] u32 tiles() const override { return tiles_x_ * tiles_y_; }
  [[nodiscard]] u32 tiles_across() const override { return tiles_x_; }
  [[nodiscard]] u32 samples(u32 tile) const override { return tile_samples_[tile]; }
  void set_samples(u32 tile, u32 samples) { tile_samples_[tile] = samples; }
  [[nodiscard]] u64 rays() const override { return rays_.load(std::memory_order_relaxed); }
  void add_rays(u64 rays) { rays_.fetch_add(rays, std::memory_order_relaxed); }
  /// A device's work on a range, cut into pieces of which the first ones are done.
  struct Left {
    u32 done = 0, count = 0;
  };
  /// Progress in the range that was left half way; none of it where none was.
  [[nodiscard]] const Left& left() const { return left_; }
  void leave(const Left& left) { left_ = left; }
  [[nodiscard]] double share_of_range() const override {
    return left_.count > 0 ? double(left_.done) / left_.count : 0;
  }
  /// The pixels of a tile.
  [[nodiscard]] PixelRect tile(u32 index) const;

  [[nodiscard]] const RenderJob& job() const { return *shot_.job; }
  /// View that labels have.
  [[nodiscard]] const Sight& still() const { return still_; }
  [[nodiscard]] const ImageCamera& image_camera() const { return image_camera_; }
  /// Beauty and the other mean planes; beauty_still. Of views that the film keeps.
  [[nodiscard]] std::vector<RenderTask> render_tasks() const;
  [[nodiscard]] ProbeTask probe_task() const;

  [[nodiscard]] const kernels::FilmView& view() const { return view_; }
  [[nodiscard]] FilmMemory memory() const;
  /// A task's view of the same arrays in other memory, which has each of them for all pictures of a
  /// film, and so is as many times as large. rank_of_group stays: it points at as many u32 of the
  /// host as the scene has light groups.
  [[nodiscard]] kernels::FilmView rebased(kernels::FilmView view, const FilmMemory& to,
                                          PictureOf picture = {}) const;

  /// Where the sums of a run are, and what put() of another film takes of it: these bytes, one
  /// after another.
  [[nodiscard]] std::vector<SumRange> sums_of(const TileRun& tiles) const;
  [[nodiscard]] Expected<FilmPart> take(const TileRun& tiles) override;
  [[nodiscard]] Status put(const FilmPart& part) override;

  /// The planes of film_planes() after the samples that each tile has.
  [[nodiscard]] std::vector<PlaneData> resolve() const;
  [[nodiscard]] Noise noise() const override;

 private:
  explicit HostFilm(const Shot& shot);
  /// Makes the views and their memory.
  [[nodiscard]] Status allocate();
  [[nodiscard]] ImageCamera camera_at(EntityId camera, const Camera& lens, Time time) const;
  [[nodiscard]] const Camera& lens_at(EntityId camera, Time time) const;
  /// Sets what a camera sees, but for its shutter.
  void look(Sight& sight, EntityId camera, const Camera& lens,
            const std::shared_ptr<const DeviceScene>& scene) const;
  void set_end(FlowEnd& end, const std::shared_ptr<const DeviceScene>& scene);
  template <class F>
  void for_each_array(F&& visit);
  [[nodiscard]] Status find_rest_boxes();
  void set_still_view();
  void set_groups();

  Shot shot_;
  ImageCamera image_camera_;  // at the label time, of the middle row
  Sight open_, still_, disparity_;
  FlowEnd forward_, backward_;
  std::span<const kernels::RestBoxView> rest_boxes_;  // of still_, where a plane needs them
  kernels::FilmView view_{};
  kernels::FilmView still_view_{};  // the plane beauty_still in the place of beauty
  u64 sum_bytes_ = 0, centre_bytes_ = 0;
  ZeroedMemory sums_, centres_;
  std::unordered_map<const void*, u64> array_bytes_;  // by where an array begins
  struct SumImage {
    u64 offset, row_bytes;
  };
  std::vector<SumImage> sum_images_;  // of all arrays of the sums
  std::vector<u32> rank_of_group_;
  u32 tiles_x_, tiles_y_;
  std::vector<u32> tile_samples_;
  std::atomic<u64> rays_{0};
  Left left_;
};

}  // namespace heliograph::host
