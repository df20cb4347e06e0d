// Light of black bodies. Called by lights.cpp and volumes.cpp.
#pragma once

#include <array>

#include "kernels/scene/scene_view.h"
#include "renderer/base/types.h"

namespace heliograph::resident {

/// Linear Rec.709 colour of the Planckian locus at unit luminance; kelvin in [200, 100000].
/// Channels outside the gamut are 0, which keeps the luminance by rescaling the others.
[[nodiscard]] vec3 planckian_color(double kelvin);

/// Luminance of a black body, over 683 lm/W: W sr^-1 m^-2.
[[nodiscard]] double black_body_luminance(double kelvin);

/// The table that kernels::black_body() reads.
using BlackBodyTable = std::array<vec4, kernels::kBlackBodyEntries>;
[[nodiscard]] const BlackBodyTable& black_body_table();

}  // namespace heliograph::resident
