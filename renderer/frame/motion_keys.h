// World motion over a span of time as equidistant keys, which ray tracers and kernels interpolate
// alike. Called by backends.
#pragma once

#include <functional>
#include <span>

#include "kernels/scene/scene_view.h"
#include "renderer/scene/motion.h"

namespace heliograph {

/// Largest error of keys against the motion they stand for: `metres` at the corners of a box in the
/// entity's space, and `radians` of its axes. Where as many keys as may be do not reach it, the
/// difference is larger.
struct MotionTolerance {
  vec3 lower{0}, upper{0};
  float metres = 0;
  float radians = INFINITY;
};
/// The share of a thing's size, and of the way it goes in the span, that MotionTolerance::metres is
/// made of: 0.05 pixels of an object 1000 pixels large, or of a trail of 50 pixels.
inline constexpr float kMotionShareOfSize = 5e-5f;
inline constexpr float kMotionShareOfWay = 1e-3f;

/// The most segments: a limit of Embree's.
inline constexpr u32 kMostSegments = 128;
inline constexpr u32 kMostVertexSegments = 32;

[[nodiscard]] kernels::MotionKey motion_key(const mat4x3& world);

/// Mesh that an entity shows, within a box of its own space, scaled before the entity's pose.
struct ShownBox {
  vec3 scale;
  vec3 lower, upper;
};

/// Keys of a mesh that an entity shows; empty: it stands still. Neighbouring keys are at most 60
/// degrees apart unless there are too many.
[[nodiscard]] std::vector<kernels::MotionKey> instance_keys(const Snapshot& snapshot, u32 entity,
                                                            const TimeSpan& span,
                                                            const ShownBox& shown);
/// Keys of what points somewhere: a sun, or a camera with `focal` pixels a radian in its middle.
/// Its scale is dropped.
[[nodiscard]] std::vector<kernels::MotionKey> pointing_keys(const Snapshot& snapshot, u32 entity,
                                                            const TimeSpan& span, float focal);

/// Vertices of a mesh as an entity shows them at segments + 1 equidistant times, one after the
/// other; for each time the world poses of all entities.
struct DeformedKeys {
  DeformedVertices vertices;
  u32 segments = 0;
};
struct WorldAt {
  std::function<const std::vector<mat4x3>&(Time)> poses;
  Pieces in_pieces = in_one_piece;
};
/// nullopt: the mesh's own single key serves all the time.
[[nodiscard]] std::optional<DeformedKeys> deform_within(const Snapshot& snapshot, u32 entity,
                                                        const TimeSpan& span,
                                                        const WorldAt& world_at);

}  // namespace heliograph
