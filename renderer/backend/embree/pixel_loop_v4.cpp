// The pixel loops for x86-64-v4.
#define HELIO_ISA v4
#include "renderer/backend/embree/pixel_loop_body.h"

namespace heliograph::embree {
const PixelLoops kPixelLoopsV4{"x86-64-v4", render_rect, probe_rect};
}
