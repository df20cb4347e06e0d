// A snapshot in a span of time as kernels read it: pieces that scenes share. Called by scene.h.
#pragma once

#include "renderer/lights/casters.h"
#include "renderer/placement/volumes.h"

namespace heliograph::resident {

/// Immutable. Each piece is a pure function of parts of the snapshot and is shared with the scenes
/// that have the same parts.
struct ScenePieces {
  std::shared_ptr<const Placement> placement;
  std::shared_ptr<const Volumes> volumes;
  std::shared_ptr<const Materials> materials;
  std::shared_ptr<const Surfaces> surfaces;
  std::shared_ptr<const Lights> lights;
};

/// All of a scene but the array of its instances. Immutable.
class SceneState {
 public:
  SceneState(std::shared_ptr<const Snapshot> snapshot, const TimeSpan& span, ScenePieces pieces);

  /// Its instances are null.
  [[nodiscard]] const kernels::SceneView& view() const { return view_; }
  [[nodiscard]] const Snapshot& snapshot() const { return *snapshot_; }
  [[nodiscard]] const TimeSpan& span() const { return span_; }
  [[nodiscard]] const ScenePieces& pieces() const { return pieces_; }
  [[nodiscard]] const Placement& placement() const { return *pieces_.placement; }
  /// Bytes of what it has and another, or null, does not share.
  [[nodiscard]] u64 bytes_beside(const SceneState* other) const;

 private:
  std::shared_ptr<const Snapshot> snapshot_;
  TimeSpan span_;
  ScenePieces pieces_;
  std::vector<kernels::MeshView> meshes_;
  std::vector<kernels::VolumeView> volumes_;  // the pieces', with their light groups
  Casters casters_;
  kernels::SceneView view_{};
};

/// True if nothing that decides on poses in a span differs between a scene and a snapshot.
[[nodiscard]] bool same_poses(const SceneState& scene, const Snapshot& snapshot,
                              const TimeSpan& span);
[[nodiscard]] bool same_materials(const Snapshot& a, const Snapshot& b);
/// True if two snapshots have the same meshes, materials, textures, volumes and dome.
[[nodiscard]] bool same_assets(const Snapshot& a, const Snapshot& b);

}  // namespace heliograph::resident
