// The rest box of a model, from its edits: the same for every format.
#include <array>
#include <cmath>

#include "renderer/assets/builder.h"
#include "renderer/assets/refuse.h"
#include "renderer/scene/grid.h"

namespace heliograph::assets {
namespace {

struct Box {
  vec3 low{0}, high{0};
  bool any = false;
  bool finite = true;

  void add(const vec3& p) {
    finite = finite && std::isfinite(p.x + p.y + p.z);
    low = any ? glm::min(low, p) : p;
    high = any ? glm::max(high, p) : p;
    any = true;
  }
};

class Measure {
 public:
  explicit Measure(const Asset& asset) : asset_(asset) {}

  Box box() {
    for (const Edit& edit : asset_.entities) {
      const auto& put = std::get<PutEntity>(edit.action);
      root_from_.push_back(pose_of(put));
      shown_.push_back(put.visible.value_or(true) &&
                       (!put.parent || shown_[index_of(*put.parent)]));
      if (!shown_.back()) continue;
      if (put.volume) {
        const auto& ref = std::get<CreatedByEdit>(*put.volume);
        const auto& volume = std::get<PutVolume>(asset_.library[ref.edit].action);
        for (const vec3& corner : box_corners(*volume.density))
          box_.add(root_from_.back() * vec4(corner, 1));
      }
      if (!put.mesh || std::holds_alternative<std::monostate>(*put.mesh)) continue;
      const auto& mesh =
          std::get<PutMesh>(asset_.library[std::get<CreatedByEdit>(*put.mesh).edit].action);
      if (put.skin && *put.skin) {
        add_skinned(mesh, **put.skin);
      } else {
        add_rigid(mesh, root_from_.back());
      }
    }
    return box_;
  }

 private:
  [[nodiscard]] std::size_t index_of(const Ref& ref) const {
    return std::get<CreatedByEdit>(ref).edit - asset_.library.size();
  }
  [[nodiscard]] const mat4x3& entity_pose(const Ref& ref) const {
    return root_from_[index_of(ref)];
  }
  [[nodiscard]] mat4x3 pose_of(const PutEntity& put) const {
    const mat4x3 local = put.pose ? put.pose->matrices.front() : mat4x3(1);
    return put.parent ? affine_product(entity_pose(*put.parent), local) : local;
  }

  /// Vertex by vertex, until instances make that long; then by the corners of the mesh's own box.
  void add_rigid(const PutMesh& mesh, const mat4x3& root_from_mesh) {
    constexpr std::size_t kManyVertices = 1 << 24;
    const auto& positions = mesh.vertices->positions;
    visited_ += positions.size();
    if (visited_ < kManyVertices) {
      for (const vec3& p : positions) box_.add(root_from_mesh * vec4(p, 1));
      return;
    }
    Box own;
    for (const vec3& p : positions) own.add(p);
    for (u32 corner = 0; corner < 8; ++corner) {
      const vec3 p(corner & 1 ? own.high.x : own.low.x, corner & 2 ? own.high.y : own.low.y,
                   corner & 4 ? own.high.z : own.low.z);
      box_.add(root_from_mesh * vec4(p, 1));
    }
  }

  void add_skinned(const PutMesh& mesh, const SkinPatch& skin) {
    std::vector<mat4x3> root_from_mesh;
    for (std::size_t i = 0; i < skin.joints.size(); ++i) {
      root_from_mesh.push_back(affine_product(entity_pose(skin.joints[i]), skin.inverse_binds[i]));
    }
    const auto& positions = mesh.vertices->positions;
    for (std::size_t v = 0; v < positions.size(); ++v) {
      const vec4 weights = mesh.topology->weights[v];
      const auto joints = mesh.topology->joints[v];
      vec3 p(0);
      for (int i = 0; i < 4; ++i) {
        if (weights[i] > 0) p += weights[i] * (root_from_mesh[joints[i]] * vec4(positions[v], 1));
      }
      box_.add(p);
    }
  }

  const Asset& asset_;
  std::vector<mat4x3> root_from_;
  std::vector<bool> shown_;  // itself and all above it
  Box box_;
  std::size_t visited_ = 0;
};

}  // namespace

void measure(Loaded& loaded) {
  const Box box = Measure(loaded.asset).box();
  if (!box.finite) refuse("model", "reaches beyond what f32 can hold; scale it down");
  loaded.bounds_min = box.low;
  loaded.bounds_max = box.high;
}

}  // namespace heliograph::assets
