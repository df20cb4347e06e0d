// When the rows of an image, or its pixels, are seen: by samples, and by labels. Used by the runner
// and backends.
#pragma once

#include "kernels/scene/scene_view.h"
#include "renderer/scene/components.h"
#include "renderer/scene/motion.h"

namespace heliograph {

/// All times at which samples of a frame at `time` are taken: each row is open from its own `open`
/// to its own `close`.
[[nodiscard]] TimeSpan shutter_span(const Shutter& shutter, Time time);
/// All times at which labels are taken: row y of `height` at `time` + rolling * y / (height - 1), a
/// pixel of a ray table at `time` + its own. Poses are those of the middle.
[[nodiscard]] TimeSpan label_span(const Shutter& shutter, Time time);

/// The same for kernels, whose time axis is the span.
[[nodiscard]] kernels::ShutterView shutter_view(const Camera& camera, u32 height);
[[nodiscard]] kernels::ShutterView label_view(const Camera& camera, u32 height);

}  // namespace heliograph
