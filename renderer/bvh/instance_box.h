// Where an instance is at any time of its motion. Called by accelerator.cpp.
#pragma once

#include <span>

#include "kernels/scene_view.h"
#include "renderer/resident/box.h"

namespace heliograph::bvh {

using resident::Box;

/// A box of the world about the box of an object.
[[nodiscard]] Box placed_box(const Box& object, const mat4x3& world_from_object);
/// The same while it moves along its keys as kernels::interpolate() has it.
[[nodiscard]] Box moving_box(const Box& object, std::span<const kernels::MotionKey> keys);

}  // namespace heliograph::bvh
