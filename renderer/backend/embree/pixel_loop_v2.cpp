// The pixel loops for x86-64-v2.
#define HELIO_ISA v2
#include "renderer/backend/embree/pixel_loop_body.h"

namespace heliograph::embree {
const PixelLoops kPixelLoopsV2{"x86-64-v2", render_rect, probe_rect};
}
