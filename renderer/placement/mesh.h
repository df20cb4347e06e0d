// Meshes as entities show them, and their bounds.
#pragma once

#include <optional>
#include <vector>

#include "kernels/scene/scene_view.h"
#include "renderer/base/error.h"
#include "renderer/derived/derived_cache.h"
#include "renderer/derived/strands.h"
#include "renderer/device/accelerator.h"
#include "renderer/frame/motion_keys.h"
#include "renderer/scene/components.h"

namespace heliograph::resident {

/// A mesh as one or more entities show it.
struct DeviceMesh {
  std::shared_ptr<const MeshTopology> topology;
  std::shared_ptr<const VertexKeys> vertices;
  ArrayOf<vec3> positions;  // (segments + 1) * vertex_count, over the scene's span of time
  ArrayOf<vec3> normals;    // or empty
  std::shared_ptr<const Strands> strands;  // of curves, else null
  u32 segments = 0;                        // 0: it does not deform
  bool reshaped = false;                   // Mesh::reshaped
  std::shared_ptr<const MeshAccelerator> accelerator;
  Box rest;  // of the first key's triangles or segments
  /// Positions at the middle of the span.
  [[nodiscard]] const vec3* middle() const {
    return positions.data() + u64(segments / 2) * topology->vertex_count;
  }
  [[nodiscard]] kernels::MeshView view() const;
  [[nodiscard]] kernels::Shape shape() const;
  /// True if its vertices are an entity's own, by morph or skin or while the shutter is open, or
  /// took the place of others: a tree over them is seldom of use for long.
  [[nodiscard]] bool is_deformed() const {
    return reshaped || positions.serial() != vertices->positions.serial();
  }
};

/// Makes DeviceMeshes. Thread: any.
class MeshBuilder {
 public:
  MeshBuilder(const Accelerator& accelerator, DerivedCache& cache)
      : accelerator_(accelerator), cache_(cache) {}

  /// A mesh as its own first key shows it.
  [[nodiscard]] Expected<std::shared_ptr<DeviceMesh>> build(const Mesh& mesh,
                                                            const Interrupt& interrupt = {}) const;
  /// The same with other vertices.
  [[nodiscard]] Expected<std::shared_ptr<DeviceMesh>> build(const Mesh& mesh,
                                                            DeformedKeys deformed) const;
  /// Key of the acceleration structure that build(mesh) gives it.
  [[nodiscard]] static DerivedKey key_of(const Mesh& mesh);
  /// True if build(mesh) would find everything made.
  [[nodiscard]] bool ready(const Mesh& mesh) const;
  /// Bounds of the triangles or segments at rest under a linear map.
  [[nodiscard]] Box rest_bounds(const DeviceMesh& mesh, const mat3& map) const;

 private:
  /// Gives a mesh what depends on its vertices.
  [[nodiscard]] Expected<std::shared_ptr<DeviceMesh>> finish(std::shared_ptr<DeviceMesh> mesh,
                                                             const Interrupt& interrupt) const;
  const Accelerator& accelerator_;
  DerivedCache& cache_;
};

}  // namespace heliograph::resident
