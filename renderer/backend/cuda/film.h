// Films whose pixels the GPU writes.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "renderer/backend/cuda/denoiser.h"
#include "renderer/backend/cuda/scene.h"
#include "renderer/backend/cuda/waves.h"
#include "renderer/host/film.h"

namespace heliograph::cuda {

/// A scene that a film needs, see CopyContext.
struct SceneOrder {
  std::shared_ptr<const ResidentScene> scene;
  std::shared_ptr<const CudaScene> sibling;
  std::shared_ptr<Copies> own;
};
/// Finds the device's copy, or makes it.
using SceneOf = std::function<Expected<std::shared_ptr<const CudaScene>>(const SceneOrder&)>;

/// Tools for making a film.
struct FilmTools {
  Mirror& mirror;
  const Programs& programs;
  SceneOf scene_of;
};

/// The pictures of one film, side by side: each array has those of all pictures one after the
/// other. Owns: its arrays in device memory, and the waves that a range is left with. Thread: the
/// device's.
class CudaFilm final : public Film {
 public:
  using Pictures = std::vector<std::unique_ptr<host::HostFilm>>;
  /// pictures   at least one, of `shots`
  [[nodiscard]] static Expected<std::unique_ptr<CudaFilm>> create(Pictures pictures,
                                                                  std::span<const Shot> shots,
                                                                  const FilmTools& tools);
  ~CudaFilm() override;

  [[nodiscard]] u32 tiles() const override { return u32(tile_samples_.size()); }
  [[nodiscard]] u32 tiles_across() const override { return pictures_[0]->tiles_across(); }
  [[nodiscard]] u32 samples(u32 tile) const override { return tile_samples_[tile]; }
  /// As of the last time that somebody waited for the device.
  [[nodiscard]] u64 rays() const override {
    return rays_.load(std::memory_order_relaxed) + rays_elsewhere_;
  }
  [[nodiscard]] u32 pictures() const { return u32(pictures_.size()); }
  /// Scenes that its pictures show. All copies are there.
  [[nodiscard]] const std::vector<std::shared_ptr<const CudaScene>>& scenes() const {
    return scenes_;
  }
  [[nodiscard]] const host::HostFilm& picture(u32 i) const { return *pictures_[i]; }

  /// Goes on with a range, or begins with it; returns whether it is done.
  [[nodiscard]] Expected<bool> render(const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt);
  [[nodiscard]] Expected<FilmPart> take(const TileRun& tiles) override;
  [[nodiscard]] Status put(const FilmPart& part) override;
  /// Starts it beside samples.
  [[nodiscard]] Status probe();
  /// Resolves as Backend::resolve() states.
  ///
  /// denoiser   null: there is none
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(CudaDenoiser* denoiser);
  /// Noise of the first picture.
  [[nodiscard]] Noise noise() const override;
  /// Brings the centre plane that labels read to the pictures on the host.
  [[nodiscard]] Status fetch_label_planes();

 private:
  CudaFilm(Pictures pictures, const FilmTools& tools)
      : pictures_(std::move(pictures)),
        context_(tools.mirror.context()),
        programs_(tools.programs),
        copies_(tools.mirror) {}
  [[nodiscard]] Status open(std::span<const Shot> shots, const FilmTools& tools);
  [[nodiscard]] Status add_scenes(const Shot& shot, const SceneOf& scene_of,
                                  const std::shared_ptr<Copies>& own);
  void set_tasks(u32 picture);
  void set_probes();
  [[nodiscard]] u64 pixels() const;  // of a picture
  [[nodiscard]] const RenderJob& job() const { return pictures_[0]->job(); }
  [[nodiscard]] const CudaScene* copy_of(const ResidentScene* scene) const;
  [[nodiscard]] kernels::CameraView copy(const kernels::CameraView& camera);
  [[nodiscard]] kernels::FilmView copy(const kernels::FilmView& film, u32 picture) const;
  /// Launch that turns the samples so far into planes.
  [[nodiscard]] Expected<ResolveLaunch> resolve_launch() const;
  /// Makes planes that lie in device memory.
  [[nodiscard]] Status launch_resolve(ResolveLaunch& launch, const kernels::PlaneOut& out) const;
  [[nodiscard]] Expected<Noise> measured_noise() const;
  /// A plane of device memory, and what it becomes in the frame: nothing, if only the denoiser
  /// reads it.
  struct Resolved {
    Plane plane;
    DevicePointer at;
    DeviceMemory own;
    std::optional<PlaneData> made;
  };
  [[nodiscard]] Expected<Resolved> new_plane_of(Plane plane, bool is_read);
  [[nodiscard]] Expected<std::vector<Resolved>> new_resolved(bool denoises);
  /// Waits for all that was started, and brings planes to the host, if they go there.
  [[nodiscard]] Expected<std::vector<PlaneData>> finish(std::vector<Resolved> planes);
  /// Waits for what is to come to the host, and for the count of rays.
  [[nodiscard]] Status download(std::vector<Download> pieces);
  /// Starts what fills film planes.
  [[nodiscard]] Status fill(std::span<Resolved> planes);
  /// Makes what comes next find the centre planes.
  [[nodiscard]] Status join_probes();
  [[nodiscard]] ProbeEnd end_of(const ResidentScene* scene, const kernels::ProbeScene& seen);

  const Pictures pictures_;
  Context& context_;
  const Programs& programs_;  // the backend's
  std::vector<std::shared_ptr<const CudaScene>> scenes_;
  std::unordered_map<const ResidentScene*, const CudaScene*> scene_of_;
  Copies copies_;
  DeviceMemory sums_, centres_, counters_, samples_;
  std::vector<u32> tile_samples_;
  const kernels::FilmView* views_ = nullptr;  // of the pictures, on the device
  kernels::FilmView view_{};                  // of the first one; its arrays are the device's
  std::vector<std::vector<WaveShot>> tasks_;  // of all pictures
  std::vector<const WaveShot*> task_copies_;  // null: of one picture
  const ProbeLaunch* probes_ = nullptr;       // of the pictures, on the device
  bool later_ = false;                        // they look at a later vertex
  bool probes_aside_ = false;                 // since when nothing waited for them
  std::unique_ptr<Waves> waves_;              // of a range that is not done
  u32 task_ = 0;                              // that they work on
  bool fetched_ = false;
  std::atomic<u64> rays_{0};
  u64 rays_elsewhere_ = 0;  // of parts that other devices traced
};

}  // namespace heliograph::cuda
