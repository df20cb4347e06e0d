// Rest boxes to what the planes of object coordinates need. Called by label_frames.cpp.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/frame/label_columns.h"
#include "renderer/scene/motion.h"

namespace heliograph::resident {

/// Root entity's coordinates to the object frame: its scale, and its shear if there is any.
[[nodiscard]] inline mat3 object_from_root(const ObjectFrame& frame,
                                           const mat4x3& world_from_root) {
  if (frame.rigid) return mat3(frame.scale.x, 0, 0, 0, frame.scale.y, 0, 0, 0, frame.scale.z);
  return mat3(glm::transpose(glm::dmat3(frame.world_from_object)) *
              glm::dmat3(glm::mat3(world_from_root)));
}

/// frame_from_entity   to the frame that the box is in
[[nodiscard]] inline kernels::RestBoxView rest_box_view(const RestBox& box,
                                                        const mat4x3& frame_from_entity) {
  const vec3 size = box.upper - box.lower;
  const float diagonal = glm::length(size);
  mat4x3 normalise(1);
  for (int axis = 0; axis < 3; ++axis) {
    const bool flat = !(size[axis] > 0);
    normalise[axis][axis] = flat ? 0 : 1 / size[axis];
    normalise[3][axis] = flat ? 0.5f : -box.lower[axis] / size[axis];
  }
  return {multiply(normalise, frame_from_entity), diagonal > 0 ? size / diagonal : vec3(0)};
}

}  // namespace heliograph::resident
