// Poses of nodes. Used by loaders of scenes.
#pragma once

#include <optional>

#include "renderer/assets/builder.h"
#include "renderer/scene/invertible.h"

namespace heliograph::assets {

/// `pose` if f32 can invert it. One that flattens along a single direction, as a scale of 0 along
/// one axis does, keeps a share of its longest axis there, so that what is flat already stays where
/// it is; nullopt for others.
[[nodiscard]] std::optional<mat4x3> with_thickness(const mat4x3& pose, double share = 1e-5);

/// Gives an entity its pose, with_thickness(), and returns it. One without an inverse hides the
/// entity, with a warning that names it by `what`, and is taken as none.
mat4x3 set_pose(PutEntity& put, const mat4x3& pose, const std::string& what, Builder& builder);

/// A rotation of length 1; one of length 0 turns nothing, with a warning.
[[nodiscard]] quat unit_rotation(const quat& rotation, const std::string& where, Builder& builder);
[[nodiscard]] mat4x3 compose_trs(vec3 translation, quat rotation, vec3 scale);
/// A pose that makes things flat gets a ten-thousandth of its longest axis across them: what is
/// flat already stays where it is, and the pose has an inverse. One that leaves a line, a point or
/// nothing that f32 can hold still has none.
[[nodiscard]] mat4x3 thickened(const mat4x3& pose);
/// The pose below a node, at its origin, that takes scale and shear of the node's pose in the scene
/// back: -Z looks where the node's does. Identity where that has no inverse.
[[nodiscard]] mat4x3 unscaled(const mat4x3& scene_from_node);

}  // namespace heliograph::assets
