// Meshes on the device: their acceleration structures and bounds.
#pragma once

#include <optional>
#include <vector>

#include "kernels/scene_view.h"
#include "renderer/backend/embree/derived_cache.h"
#include "renderer/backend/embree/embree.h"
#include "renderer/base/error.h"
#include "renderer/engine/motion_keys.h"
#include "renderer/scene/components.h"

namespace heliograph::embree {

struct Box {
  vec3 lower{INFINITY};
  vec3 upper{-INFINITY};
  void extend(vec3 p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  void extend(const Box& box) {
    lower = glm::min(lower, box.lower);
    upper = glm::max(upper, box.upper);
  }
  [[nodiscard]] bool empty() const { return !(lower.x <= upper.x); }
  [[nodiscard]] u64 bytes() const { return 256; }  // with its place in a cache
};

/// A mesh's acceleration structure. Who traces it keeps alive the arrays it was made from.
struct Blas {
  SceneHandle scene;
  u64 bytes_ = 0;
  [[nodiscard]] u64 bytes() const { return bytes_; }
};

/// A mesh as one or more entities show it.
struct DeviceMesh {
  std::shared_ptr<const MeshTopology> topology;
  std::shared_ptr<const VertexKeys> vertices;
  ArrayOf<vec3> positions;  // (segments + 1) * vertex_count, over the scene's span of time
  ArrayOf<vec3> normals;    // or empty
  u32 segments = 0;         // 0: it does not deform
  std::shared_ptr<const Blas> blas;
  Box rest;  // of the first key's triangles
  /// Positions at the middle of the span.
  [[nodiscard]] const vec3* middle() const {
    return positions.data() + u64(segments / 2) * topology->vertex_count;
  }
  [[nodiscard]] kernels::MeshView view() const;
  [[nodiscard]] kernels::Shape shape() const;
};

/// Makes DeviceMeshes. Thread: any.
class MeshBuilder {
 public:
  MeshBuilder(RTCDevice device, DerivedCache& cache) : device_(device), cache_(cache) {}

  /// A mesh as its own first key shows it.
  [[nodiscard]] Expected<std::shared_ptr<DeviceMesh>> build(const Mesh& mesh) const;
  /// The same with other vertices.
  [[nodiscard]] Expected<std::shared_ptr<DeviceMesh>> build(const Mesh& mesh,
                                                            DeformedKeys deformed) const;
  /// Whether build(mesh) would find everything made.
  [[nodiscard]] bool ready(const Mesh& mesh) const;
  /// Bounds of the rest vertices of the triangles under a linear map.
  [[nodiscard]] Box rest_bounds(const DeviceMesh& mesh, const mat3& map) const;

 private:
  [[nodiscard]] Expected<std::shared_ptr<const Blas>> blas(const DeviceMesh& mesh) const;
  RTCDevice device_;
  DerivedCache& cache_;
};

}  // namespace heliograph::embree
