// The dome: its radiance, and how directions to it are chosen. Called by light.h.
#pragma once

#include "kernels/light/light_surface.h"
#include "kernels/light/portal.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// place: row 0 at v = 0.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 dome_radiance(const SceneView& scene, vec2 place) {
  const DomeView& dome = scene.dome;
  if (dome.texture == kNone) return dome.radiance;
  TextureView texture = scene.textures[dome.texture];
  texture.wrap_u = Wrap::kRepeat;
  texture.wrap_v = Wrap::kClamp;
  return dome.radiance * vec3(sample_texture<true>(texture, vec2(place.x, 1 - place.y)));
}

/// Places of directions in the dome's picture, and the sines of their polar angles.
template <class F>
struct DomePlaceOf {
  Vec2<F> uv;
  F sine;
};
using DomePlace = DomePlaceOf<float>;
template <class F>
KERNEL DomePlaceOf<F> dome_place(const DomeView& dome, Vec3<F> direction) {
  const Vec3<F> d = turned(dome.dome_from_world, direction);
  const F sine = sqrt(d.x * d.x + d.y * d.y);
  return {Vec2<F>(0.5f - atan2_turns(d.y, d.x), 2 * atan2_turns(sine, d.z)), sine};
}
KERNEL DomePlace dome_place(const DomeView& dome, vec3 direction) {
  return dome_place<float>(dome, direction);
}

/// The texel of a dome's tables that a place lies in.
struct DomeTexel {
  u32 x, y;
};
KERNEL DomeTexel dome_texel(const DomeView& dome, vec2 uv) {
  return {min2(u32(max2(uv.x, 0.0f) * float(dome.width)), dome.width - 1),
          min2(u32(uv.y * float(dome.height)), dome.height - 1)};
}

/// Asks for what dome_radiance() and dome_pdf() read.
HELIO_ALWAYS_INLINE KERNEL void prefetch_dome(const SceneView& scene, const DomePlace& place) {
  const DomeView& dome = scene.dome;
  if (dome.row_cdf) {
    const DomeTexel at = dome_texel(dome, place.uv);
    prefetch(dome.column_cdf + u64(at.y) * dome.width + at.x);
  }
  prefetch_texel(scene.textures[dome.texture], place.uv);
}

/// From probabilities of texels to densities of directions, 1/sr.
template <class F>
KERNEL F dome_density(const DomeView& dome, F probability, F sine) {
  return dome.probability * probability * float(dome.width) * float(dome.height) /
         (2 * kPi * kPi * max2(sine, F(1e-6f)));
}

/// A direction to a dome without texels, by the receiver's cosine, and its density.
KERNEL vec3 sample_even_dome(const Receiver& from, vec2 u, float& pdf) {
  if (from.facing == Facing::kAny) {
    pdf = 0.25f * kInvPi;
    return sample_sphere(u);
  }
  float share = 1, side = 1;
  if (from.facing == Facing::kBoth) {
    share = 0.5f;
    side = u.x < share ? 1.0f : -1.0f;
    u.x = rescale_uniform(u.x < share ? u.x : u.x - share, share);
  }
  const vec3 local = sample_cosine(u);
  pdf = share * local.z * kInvPi;
  return to_world(make_frame(side * from.n), local);
}
KERNEL float even_dome_pdf(const Receiver& from, vec3 direction) {
  if (from.facing == Facing::kAny) return 0.25f * kInvPi;
  const float cosine = dot(from.n, direction);
  if (from.facing == Facing::kBoth) return 0.5f * kInvPi * std::fabs(cosine);
  return max2(cosine, 0.0f) * kInvPi;
}

/// Density [1/sr] with which sample_sky() takes a direction to the dome, by its texels.
KERNEL float texel_pdf(const DomeView& dome, const DomePlace& place) {
  const auto [x, y] = dome_texel(dome, place.uv);
  const float* columns = dome.column_cdf + u64(y) * dome.width;
  const float row = dome.row_cdf[y] - (y > 0 ? dome.row_cdf[y - 1] : 0);
  const float column = columns[x] - (x > 0 ? columns[x - 1] : 0);
  return dome_density(dome, row * column, place.sine);
}

/// Density [1/sr] with which sample_sky() takes a direction to the dome. place: of that direction.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL float dome_pdf(const DomeView& dome, const Receiver& from,
                                                      vec3 direction, const DomePlace& place) {
  if (dome.portal_count > 0 && portal_faces(dome, from.p)) {
    return dome.probability * portal_pdf(dome, from.p, direction);
  }
  return dome.row_cdf ? texel_pdf(dome, place) : dome.probability * even_dome_pdf(from, direction);
}

/// A table of sums in DomeView, which begins at `begin` of an array, and its guide.
template <class F>
struct DomeSums {
  const float* cdf;
  IndexOf<F> begin;
  u32 count;
  const u16* guides;  // null: none
  IndexOf<F> guide;   // where the table's begins
};
/// choose() with a guide, if there is one, that narrows the search to a few neighbours.
template <class F>
KERNEL ChoiceOf<F> choose_guided(const DomeSums<F>& sums, F u) {
  using Index = IndexOf<F>;
  if (!sums.guides) return choose(sums.cdf, sums.begin, Index(0), Index(sums.count), u);
  const Index i = min2(Index(to_int(u * kDomeGuide)), Index(kDomeGuide - 1));
  const BoolOf<F> inner = i < Index(kDomeGuide - 1);
  const Index at = sums.guide + i;
  const Index next = gather(sums.guides, select(inner, at + Index(1), at));
  const Index first = gather(sums.guides, at);
  const Index last = select(inner, next, Index(sums.count - 1));
  return choose(sums.cdf, sums.begin, first, last + Index(1) - first, u);
}
template <class F>
KERNEL DomeSums<F> rows_of(const DomeView& dome) {
  return {dome.row_cdf, 0, dome.height, dome.guides, dome.height * kDomeGuide};
}
template <class F>
KERNEL DomeSums<F> columns_of(const DomeView& dome, IndexOf<F> row) {
  return {dome.column_cdf, row * IndexOf<F>(dome.width), dome.width, dome.guides,
          row * IndexOf<F>(kDomeGuide)};
}

/// Directions to the dome by its texels.
template <class F>
struct TexelSample {
  Vec2<F> place;
  Vec3<F> direction;
  F pdf;  // 1/sr; 0: no light comes from there
};
template <class F>
KERNEL TexelSample<F> sample_texels(const DomeView& dome, Vec2<F> u) {
  const ChoiceOf<F> row = choose_guided(rows_of<F>(dome), u.y);
  const ChoiceOf<F> column = choose_guided(columns_of<F>(dome, row.index), u.x);
  const Vec2<F> place((to_float(column.index) + column.rest) / float(dome.width),
                      (to_float(row.index) + row.rest) / float(dome.height));
  const SinCosOf<F> theta = sincos_turns(F(0.5f * place.y));
  const SinCosOf<F> phi = sincos_turns(F(0.5f - place.x));
  const Vec3<F> d(theta.sin * phi.cos, theta.sin * phi.sin, theta.cos);
  const F pdf = dome_density(dome, F(row.probability * column.probability), theta.sin);
  return {place, turned(dome.world_from_dome, d), select(theta.sin > 1e-6f, pdf, F(0))};
}

HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL bool sample_dome(const SceneView& scene,
                                                        const Receiver& from, vec2 u,
                                                        LightSample& out) {
  const DomeView& dome = scene.dome;
  out.light = out.sun = kNone;
  out.visibility = kAllRays;
  if (dome.portal_count > 0 && portal_faces(dome, from.p)) {
    if (!sample_portals(dome, from.p, u, out.direction, out.pdf)) return false;
    out.place = dome_place(dome, out.direction).uv;
    out.pdf *= dome.probability;
    return true;
  }
  if (!dome.row_cdf) {
    out.direction = sample_even_dome(from, u, out.pdf);
    out.place = dome.texture == kNone ? vec2(0) : dome_place(dome, out.direction).uv;
    out.pdf *= dome.probability;
    return out.pdf > 0;
  }
  const TexelSample<float> texel = sample_texels(dome, u);
  out.place = texel.place;
  out.direction = texel.direction;
  out.pdf = texel.pdf;
  return out.pdf > 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
