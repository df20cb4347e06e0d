#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Neither NaN nor infinite.
KERNEL bool is_finite(float x) { return glm::abs(x) < INFINITY; }

}  // namespace heliograph::kernels::inline HELIO_ISA
