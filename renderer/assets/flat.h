// Poses that flatten what they hold. Used by loaders of scenes.
#pragma once

#include <optional>

#include "renderer/scene/invertible.h"

namespace heliograph::assets {

/// `pose` if f32 can invert it. One that flattens along a single direction, as a scale of 0 along
/// one axis does, keeps a share of its longest axis there, so that what is flat already stays where
/// it is; nullopt for others.
[[nodiscard]] std::optional<mat4x3> with_thickness(const mat4x3& pose, double share = 1e-5);

}  // namespace heliograph::assets
