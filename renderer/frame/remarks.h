// What a picture does not say of itself: why it is black or empty. Called by the runner.
#pragma once

#include <string>
#include <vector>

#include "renderer/frame/frame.h"

namespace heliograph {

/// Of a frame whose planes are made, a sentence each, with the remedy: a light that shines nowhere,
/// a signal of a sensor that is saturated for the most part, and of a beauty that is black all over
/// why: there is no light, nothing to see, the camera is inside of something, or none is known.
/// None for planes that the host cannot read.
[[nodiscard]] std::vector<std::string> remarks(const RenderJob& job, const Frame& frame);

}  // namespace heliograph
