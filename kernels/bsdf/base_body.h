// The body under the coat of the base: its diffuse light leaves on this side, on the far one or
// elsewhere. Called by base_weights.h and base_lobes.h.
#pragma once

#include "kernels/bsdf/base.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Light under the coat: a share of it travels inside, the rest is Lambert's on this side or the
/// far one. Where there is no inside to travel in, all of it is Lambert's.
template <class F>
struct BodyOf {
  Vec3<F> color, through;
  F inside;
};
template <Features S, class F>
KERNEL BodyOf<F> body_of(const MaterialValuesOf<F>& m, const ShadingPointOf<F>& at) {
  const BoolOf<F> body = rich<S>((m.subsurface > 0) | (m.diffuse_transmission > 0));
  if (!any(body)) return {m.base_color, Vec3<F>(0), F(0)};
  const BoolOf<F> is_opaque = is_black(m.subsurface_radius);
  const BoolOf<F> walks = body & !at.thin_walled & (dot(at.wo, at.ng) >= 0) & !is_opaque;
  const F surface = 1 - m.subsurface;
  const Vec3<F> color = m.base_color * (surface * (1 - m.diffuse_transmission));
  const Vec3<F> through = m.diffuse_transmission_color * (surface * m.diffuse_transmission);
  const Vec3<F> whole = color + m.subsurface_color * m.subsurface;
  return {select(body, select(walks, color, whole), m.base_color),
          select(body, through, Vec3<F>(0)), select(walks, m.subsurface, F(0))};
}

/// True where some diffuse light leaves on the far side.
template <class F, Features S>
KERNEL BoolOf<F> is_translucent(const BaseOf<F, S>& b) {
  return rich<S>(b.diffuse_through_share > 0);
}
/// Index of what light below the surface is in, over that on wo's side: radiance there is its
/// square times as large.
template <class F, Features S>
KERNEL F index_below(const BaseOf<F, S>& b) {
  return select(is_glass(b) & !(b.interface == Interface::kSheet), b.eta, F(1));
}
/// Probability of sampling by cosine on wo's side.
template <class F, Features S>
KERNEL F above_probability(const BaseOf<F, S>& b) {
  if constexpr (S != Features::kAll) return b.diffuse_probability;
  return b.diffuse_probability * (1 - b.diffuse_through_share);
}

/// Diffuse light from the far side. Returns its albedo.
///
/// through   light that leaves towards wo
/// scale     of its lobe, 1/sr
/// above     albedo of the lobes sampled by cosine on wo's side
template <class F, Features S>
KERNEL F set_diffuse_through(BaseOf<F, S>& b, Vec3<F> through, F scale, F above) {
  if constexpr (S != Features::kAll) return F(0);
  const F share = luminance(through);
  b.diffuse_through = through * scale;
  b.diffuse_through_share = select(share > 0, share / (share + above), F(0));
  return share;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
