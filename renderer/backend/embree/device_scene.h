// A snapshot in a span of time, resident: pieces that scenes share, and the view kernels read.
#pragma once

#include <atomic>

#include "renderer/backend/embree/lights.h"
#include "renderer/backend/embree/tracer.h"
#include "renderer/backend/embree/volumes.h"
#include "renderer/engine/backend.h"

namespace heliograph::embree {

/// Immutable. Each piece is a pure function of parts of the snapshot and is shared with the scenes
/// that have the same parts.
struct ScenePieces {
  std::shared_ptr<const Placement> placement;
  std::shared_ptr<const Volumes> volumes;
  std::shared_ptr<const Materials> materials;
  std::shared_ptr<const Lights> lights;
};
class EmbreeScene final : public DeviceScene {
 public:
  EmbreeScene(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span, ScenePieces pieces);

  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] TracedScene traced() const { return traced_of(view_); }
  /// The same with another view of the same instances.
  [[nodiscard]] TracedScene traced_of(const kernels::SceneView& view) const;
  [[nodiscard]] const Snapshot& snapshot() const { return *snapshot_; }
  [[nodiscard]] const TimeSpan& span() const { return span_; }
  [[nodiscard]] const Placement& placement() const { return *pieces_.placement; }
  [[nodiscard]] const Structure& structure() const { return *pieces_.placement->structure; }
  [[nodiscard]] const Lights& lights() const { return *pieces_.lights; }
  [[nodiscard]] u64 bytes() const;  // of its own, what it shares not counted

  [[nodiscard]] const ScenePieces& pieces() const { return pieces_; }

 private:
  std::shared_ptr<const Snapshot> snapshot_;
  TimeSpan span_;
  ScenePieces pieces_;
  std::vector<kernels::InstanceView> instances_;  // the placement's, with flags of the materials
  std::vector<kernels::MeshView> meshes_;
  std::vector<kernels::VolumeView> volumes_;  // the pieces', with their light groups
  std::vector<kernels::CasterView> casters_;
  std::vector<kernels::CastLightView> cast_lights_;
  kernels::SceneView view_{};
};

/// Makes scenes, and keeps the last ones to start from. Thread: the device's; `warm` any.
class SceneStore {
 public:
  SceneStore(RTCDevice device, DerivedCache& cache, const BackendOptions& options)
      : device_(device),
        cache_(cache),
        builder_(device, cache),
        limit_(options.cache_bytes),
        static_triangles_(options.static_triangles) {}

  [[nodiscard]] Expected<std::shared_ptr<const EmbreeScene>> prepare(
      const std::shared_ptr<const Snapshot>& snapshot, const TimeSpan& span,
      const Interrupt& interrupt);
  /// Whether prepare() would find the derived data of meshes and dome made.
  [[nodiscard]] bool ready(const Snapshot& snapshot) const;
  /// Makes that data.
  [[nodiscard]] Status warm(const Snapshot& snapshot) const;
  /// Thread: any.
  [[nodiscard]] u64 bytes() const { return bytes_.load(std::memory_order_relaxed); }

 private:
  [[nodiscard]] std::shared_ptr<const EmbreeScene> nearest(const Snapshot& snapshot,
                                                           const TimeSpan& span) const;
  void keep(std::shared_ptr<const EmbreeScene> scene);

  RTCDevice device_;
  DerivedCache& cache_;
  MeshBuilder builder_;
  const u64 limit_;
  const u64 static_triangles_;
  std::vector<std::shared_ptr<const EmbreeScene>> recent_;  // the last is the latest
  std::atomic<u64> bytes_{0};
};

}  // namespace heliograph::embree
