// Remarks on what a picture does not show itself: why it is black or empty. Called by the runner.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "renderer/base/box.h"
#include "renderer/frame/frame.h"

namespace heliograph {

/// Facts of a device's scene that remarks and stop rules need.
struct SceneSummary {
  bool lit = false;           // something gives off light
  bool focused = false;       // by mirrors or glass that lights, suns or a dome's picture reach
  std::span<const u32> idle;  // shown entities with a light that has neither a mesh nor a shape
  resident::Box bounds;       // of all that is shown, m
};

/// Remarks on a frame whose planes are made, a sentence each, with the remedy: a light that shines
/// nowhere, a sensor's signal that is saturated for the most part or black, a camera that sees
/// nothing of the scene, why a beauty is black all over (nothing shines, nothing is to be seen, the
/// camera is inside of something, or none is known), and light groups that are black where it is
/// not. None for planes that the host cannot read.
[[nodiscard]] std::vector<std::string> remarks(const RenderJob& job, const SceneSummary& scene,
                                               const Frame& frame);

}  // namespace heliograph
