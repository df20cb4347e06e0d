// The pixel loops for x86-64-v3.
#define HELIO_ISA v3
#include "renderer/backend/embree/pixel_loop_body.h"

namespace heliograph::embree {
const PixelLoops kPixelLoopsV3{"x86-64-v3", render_rect, probe_rect};
}
