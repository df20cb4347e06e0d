// Where things are at a time: interpolation of keys, parents, skins. Used by backends and by Read.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "renderer/scene/snapshot.h"

namespace heliograph {

/// Seconds from `begin` to `end`; an instant where they are the same.
struct TimeSpan {
  Time begin = 0;
  Time end = 0;
  [[nodiscard]] bool instant() const { return begin == end; }
  [[nodiscard]] Time at(double u) const { return begin + u * (end - begin); }
  [[nodiscard]] Time middle() const { return at(0.5); }
  friend bool operator==(const TimeSpan&, const TimeSpan&) = default;
};

/// Translation, rotation, symmetric stretch: matrix = translate * rotate * stretch. A reflection
/// (negative determinant) stays in the stretch.
struct Decomposed {
  vec3 translation{0};
  quat rotation{1, 0, 0, 0};
  mat3 stretch{1};
};

/// Polar decomposition. Source: Shoemake & Duff 1992, "Matrix Animation and Polar Decomposition".
[[nodiscard]] Decomposed decompose(const mat4x3& m);
[[nodiscard]] mat4x3 compose(const Decomposed& d);
/// Translation and stretch linearly, rotation by slerp along the shorter arc; u in [0, 1].
[[nodiscard]] mat4x3 interpolate(const mat4x3& a, const mat4x3& b, float u);

[[nodiscard]] mat4x3 multiply(const mat4x3& a, const mat4x3& b);  // a * b as affine maps
[[nodiscard]] mat4x3 inverse(const mat4x3& m);

/// The local pose of a live entity at `time`. An entity with keys follows them and is held outside
/// their range. One without moves from its pose in `previous` (if it was alive there under the same
/// id and did not teleport since) to its present one between previous->time and snapshot.time.
[[nodiscard]] mat4x3 local_pose(const Snapshot& snapshot, u32 entity, Time time);

/// The same entity before the last Advance; null when there was none, it was not there, or it
/// jumped since.
[[nodiscard]] const Entity* before_advance(const Snapshot& snapshot, u32 entity);
/// The mesh that it showed then, if that was the same surface in the same skin; else null.
[[nodiscard]] const Mesh* mesh_before_advance(const Snapshot& snapshot, u32 entity);

/// World poses of all entities at one time, computed once, parents first; [index], identity where
/// not alive.
[[nodiscard]] std::vector<mat4x3> world_poses(const Snapshot& snapshot, Time time);
/// World pose of one entity: walks up its parents.
[[nodiscard]] mat4x3 world_pose(const Snapshot& snapshot, u32 entity, Time time);

/// True if what has no keys is, at this time, between where it was before the last Advance and
/// where it is.
[[nodiscard]] inline bool in_history(const Snapshot& snapshot, Time time) {
  return snapshot.previous && time < snapshot.time;
}

/// True if the world pose of an entity may change within a span. The times in it at which keys bend
/// the motion are appended to `bends`: in between it moves smoothly.
[[nodiscard]] bool moves_within(const Snapshot& snapshot, u32 entity, const TimeSpan& span,
                                std::vector<Time>& bends);
/// The same of what deform() makes of its mesh.
[[nodiscard]] bool deforms_within(const Snapshot& snapshot, u32 entity, const TimeSpan& span,
                                  std::vector<Time>& bends);

/// True if entity and all its ancestors are `visible`.
[[nodiscard]] bool visible(const Snapshot& snapshot, u32 entity);

/// The morph weights of an entity at a time, morph_count values; empty when it has none.
[[nodiscard]] std::vector<float> morph_weights(const Entity& entity, u32 morph_count, Time time);

/// Positions and normals of a mesh as an entity shows them at `time`: vertex keys (and, as for
/// poses, vertices and weights edited since `previous`), then morph targets, then the skin; in mesh
/// coordinates
/// (skinned: relative to the entity's own world pose). nullopt: the mesh's own single key serves as
/// it is.
struct DeformedVertices {
  std::vector<vec3> positions;
  std::vector<vec3> normals;  // empty when the mesh has none
};
/// Calls f(begin, end) for pieces of what is below count, which are done in any order.
using Pieces = void (*)(std::size_t count, const std::function<void(std::size_t, std::size_t)>& f);
inline void in_one_piece(std::size_t count,
                         const std::function<void(std::size_t, std::size_t)>& f) {
  f(0, count);
}
/// World poses at that time, and how vertices are gone through.
struct DeformContext {
  DeformContext(const std::vector<mat4x3>& poses, Pieces pieces = in_one_piece)
      : world_poses(poses), in_pieces(pieces) {}
  const std::vector<mat4x3>& world_poses;
  Pieces in_pieces;
};
[[nodiscard]] std::optional<DeformedVertices> deform(const Snapshot& snapshot, u32 entity,
                                                     Time time, const DeformContext& context);

/// Fails unless flow between `time` and `other` is defined for all of the scene and these cameras:
/// every visible entity with a mesh or volume, and every camera, has keys (its or an ancestor's, or
/// vertex keys, or a skin), or both times lie within [previous->time, snapshot.time]. Otherwise
/// FAILED_PRECONDITION names an entity that has none and the remedy (keys=, advance(), hold=True).
[[nodiscard]] Status flow_defined(const Snapshot& snapshot, Time time, Time other,
                                  const std::vector<EntityId>& cameras);
/// True if this entity's own flow over (time, other) is valid: it, its joints and the ancestors of
/// both existed and did not teleport in between, and it showed the same surface.
[[nodiscard]] bool flow_valid(const Snapshot& snapshot, u32 entity, Time time, Time other);

}  // namespace heliograph
