// Glass whose index depends on the wavelength. A path has one wavelength: it bends by that one's
// index, and takes on its colour where it is bent first. Called by the steps of path.h.
#pragma once

#include "kernels/bsdf/spectrum_table.h"
#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True where surfaces split light by wavelength. Sheets do not: light leaves them as it came.
KERNEL bool disperses(const MaterialView& material, const MaterialValues& m) {
  return kRich && m.dispersion > 0 && m.transmission > 0 && !material.thin_walled;
}

/// A wavelength, by what it does.
struct Spectral {
  float bend;  // index less that of 587.6 nm, over the latter less 1, for an Abbe number of 1
  vec3 color;  // of its light; white on average over all u
};
/// u   uniform in [0, 1): wavelengths are chosen by how much of the three colours they hold
KERNEL Spectral spectral_at(float u) {
  const float at = u * kSpectrumSteps;
  const u32 i = min2(u32(at), kSpectrumSteps - 1);
  const float f = at - float(i);
  const auto mix = [&](const float* table) { return table[i] + (table[i + 1] - table[i]) * f; };
  return {mix(kSpectrumBend), vec3(mix(kSpectrumRed), mix(kSpectrumGreen), mix(kSpectrumBlue))};
}

/// Index of refraction at a wavelength.
///
/// Source: Cauchy 1836, of two terms; glTF's KHR_materials_dispersion: dispersion is 20 over the
/// Abbe number.
KERNEL float dispersed_ior(float ior, float dispersion, float u) {
  return max2(ior + (ior - 1) * dispersion * 0.05f * spectral_at(u).bend, 1.0f);
}
KERNEL float dispersed_ior(const MaterialValues& m, float u) {
  return dispersed_ior(m.ior, m.dispersion, u);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
