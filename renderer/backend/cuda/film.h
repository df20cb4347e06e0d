// A film whose pixels the GPU writes.
#pragma once

#include <functional>

#include "renderer/backend/cuda/scene.h"
#include "renderer/backend/cuda/wave.h"
#include "renderer/host/film.h"

namespace heliograph::cuda {

/// Finds the device's copy of a scene.
using SceneOf = std::function<Expected<std::shared_ptr<const CudaScene>>(
    const std::shared_ptr<const ResidentScene>&)>;

/// Owns: its arrays in device memory, and the wave that a range is left with. Thread: the device's.
class CudaFilm final : public host::HostFilm {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<CudaFilm>> create(const Shot& shot, Mirror& mirror,
                                                                  const SceneOf& scene_of);

  /// Goes on with a range, or begins with it; returns whether it is done.
  [[nodiscard]] Expected<bool> render(const Programs& programs, const WorkRange& range,
                                      TimePoint until, const Interrupt& interrupt);
  [[nodiscard]] Status probe(const Programs& programs, u32 first_tile, u32 tile_count);
  /// The planes of film_planes() after the samples that each tile has.
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(const Programs& programs);
  [[nodiscard]] Expected<Noise> noise(const Programs& programs) const;
  /// Brings the centre plane that labels read to the host.
  [[nodiscard]] Status fetch_instances() const;

 private:
  CudaFilm(const Shot& shot, Mirror& mirror)
      : HostFilm(shot), context_(mirror.context()), copies_(mirror) {}
  [[nodiscard]] Status open(const Shot& shot, const SceneOf& scene_of);
  void set_tasks();
  void set_probe();
  [[nodiscard]] const CudaScene* copy_of(const ResidentScene* scene) const;
  [[nodiscard]] kernels::CameraView copy(const kernels::CameraView& camera);
  [[nodiscard]] kernels::FilmView copy(const kernels::FilmView& film) const;
  /// Of what the samples so far become.
  [[nodiscard]] Expected<ResolveLaunch> resolve_launch() const;
  /// Of a job that is on_device: straight to where its reader has the planes.
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve_there(const Programs& programs,
                                                               ResolveLaunch& launch);
  [[nodiscard]] ProbeEnd end_of(const ResidentScene* scene, const kernels::ProbeScene& seen);

  Context& context_;
  std::vector<std::shared_ptr<const CudaScene>> scenes_;
  Copies copies_;
  DeviceMemory sums_, centres_, probe_rays_, tile_samples_;
  kernels::FilmView view_{};  // on the device
  std::vector<WaveShot> shots_;
  const ProbeLaunch* probe_ = nullptr;  // on the device; null: it has no centre planes
  std::unique_ptr<Wave> wave_;          // of a range that is not done
  u32 task_ = 0;                        // that it works on
};

}  // namespace heliograph::cuda
