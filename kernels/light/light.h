// What surfaces and the sky emit, and how directions to them are chosen. Called by path.h.
#pragma once

#include "kernels/light/light_surface.h"
#include "kernels/light/portal.h"
#include "kernels/light/sun.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Weight of a strategy with density a against one with density b.
///
/// Source: Veach and Guibas 1995, "Optimally Combining Sampling Techniques for Monte Carlo
/// Rendering", section 3.3 (power heuristic, exponent 2).
template <class F>
KERNEL F mis_weight(F a, F b) {
  return 1 / (1 + sqr(b / a));
}

// ---------------------------------------------------------------- choice

/// The lights of the tree, and those of the sky, are chosen at least so often where both exist:
/// none knows what hides the others.
inline constexpr float kMinTechniqueShare = 0.05f;

/// By what the lights of the tree and the sky may send.
template <class F>
KERNEL F share_of_surfaces(F surfaces, F sky) {
  const F share = surfaces / (surfaces + sky);
  return select(share >= 0, min2(max2(share, F(kMinTechniqueShare)), F(1 - kMinTechniqueShare)),
                F(0.5f));
}

/// Receiver::surface_share.
template <class F>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL F surface_share(const SceneView& scene,
                                                       const LitPointOf<F>& to) {
  if (scene.light_count == 0) return F(0);
  if (!(scene.sky_power > 0)) return F(1);
  // Of light from everywhere a surface's side receives a quarter.
  const F received = select(to.all_around, F(1), select(to.both, F(0.5f), F(0.25f)));
  const LightNodeOf<F> root = node_at(scene.light_nodes, IndexOf<F>(0));
  return share_of_surfaces(importance(root, to, BoolOf<F>(false)), F(received * scene.sky_power));
}
KERNEL float surface_share(const SceneView& scene, const Receiver& from) {
  return surface_share(scene, lit_point(from));
}
KERNEL float sky_share(const Receiver& from) { return 1 - from.surface_share; }

KERNEL Receiver receiver_at(const SceneView& scene, vec3 p, vec3 n, Facing facing, float time) {
  Receiver receiver{p, n, facing, time, 0};
  receiver.surface_share = surface_share(scene, receiver);
  return receiver;
}

// ---------------------------------------------------------------- dome

/// place: row 0 at v = 0.
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL vec3 dome_radiance(const SceneView& scene, vec2 place) {
  const DomeView& dome = scene.dome;
  if (dome.texture == kNone) return dome.radiance;
  TextureView texture = scene.textures[dome.texture];
  texture.wrap_u = Wrap::kRepeat;
  texture.wrap_v = Wrap::kClamp;
  return dome.radiance * vec3(sample_texture<true>(texture, vec2(place.x, 1 - place.y)));
}

/// Place of a direction in the dome's picture, and the sine of its polar angle.
struct DomePlace {
  vec2 uv;
  float sine;
};
KERNEL DomePlace dome_place(const DomeView& dome, vec3 direction) {
  const vec3 d = dome.dome_from_world * direction;
  const float sine = std::sqrt(d.x * d.x + d.y * d.y);
  return {vec2(0.5f - atan2_turns(d.y, d.x), 2 * atan2_turns(sine, d.z)), sine};
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
KERNEL void prefetch_dome(const SceneView& scene, const DomePlace& place) {
  const DomeView& dome = scene.dome;
  if (dome.row_cdf) {
    const DomeTexel at = dome_texel(dome, place.uv);
    prefetch(dome.column_cdf + u64(at.y) * dome.width + at.x);
  }
  prefetch_texel(scene.textures[dome.texture], place.uv);
}

/// From the probability of a texel to a density of directions, 1/sr.
KERNEL float dome_density(const DomeView& dome, float probability, float sine) {
  return dome.probability * probability * float(dome.width) * float(dome.height) /
         (2 * kPi * kPi * max2(sine, 1e-6f));
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

/// choose() with a guide, if there is one, that narrows the search to a few neighbours.
KERNEL Choice choose_guided(const float* cdf, u32 count, const u16* guide, float u) {
  if (!guide) return choose(cdf, count, u);
  const u32 i = min2(u32(u * kDomeGuide), kDomeGuide - 1);
  const u32 last = i + 1 < kDomeGuide ? guide[i + 1] : count - 1;
  return choose(cdf, guide[i], last + 1 - guide[i], u);
}
KERNEL Choice choose_row(const DomeView& dome, float u) {
  const u16* guide = dome.guides ? dome.guides + u64(dome.height) * kDomeGuide : nullptr;
  return choose_guided(dome.row_cdf, dome.height, guide, u);
}
KERNEL Choice choose_column(const DomeView& dome, u32 row, float u) {
  const u16* guide = dome.guides ? dome.guides + u64(row) * kDomeGuide : nullptr;
  return choose_guided(dome.column_cdf + u64(row) * dome.width, dome.width, guide, u);
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
  const Choice row = choose_row(dome, u.y);
  const Choice column = choose_column(dome, row.index, u.x);
  out.place = vec2((float(column.index) + column.rest) / float(dome.width),
                   (float(row.index) + row.rest) / float(dome.height));
  const SinCos theta = sincos_turns(0.5f * out.place.y);
  const SinCos phi = sincos_turns(0.5f - out.place.x);
  out.direction = dome.world_from_dome * vec3(theta.sin * phi.cos, theta.sin * phi.sin, theta.cos);
  out.pdf = dome_density(dome, row.probability * column.probability, theta.sin);
  return theta.sin > 1e-6f && out.pdf > 0;
}

// ---------------------------------------------------------------- all

/// Radiance that arrives along a sampled direction if nothing stands in the way.
KERNEL vec3 light_radiance(const SceneView& scene, const LightSample& sample) {
  if (sample.light != kNone) return surface_radiance(scene, sample);
  return sample.sun != kNone ? scene.suns[sample.sun].radiance : dome_radiance(scene, sample.place);
}

KERNEL u32 light_group(const SceneView& scene, const LightSample& sample) {
  if (sample.light != kNone) {
    return scene.instances[scene.lights[sample.light].instance].light_group;
  }
  return sample.sun != kNone ? scene.suns[sample.sun].light_group : scene.dome.light_group;
}

/// What LightSample says of directions to lights.
template <class F>
struct LightDirectionOf {
  Vec3<F> direction, target;
  F pdf;
  IntOf<F> visibility;
  BoolOf<F> near;  // the light is at `target`; if not it is infinitely far away
};
KERNEL LightDirectionOf<float> direction_of(const LightSample& light) {
  return {light.direction, light.target, light.pdf, i32(light.visibility), light.light != kNone};
}

/// The rays from points to sampled lights.
template <class F>
struct ShadowRayOf {
  Vec3<F> origin, direction;
  F end;               // Ray::t_max
  BoolOf<F> is_there;  // the light is not where the ray begins
};
template <class F>
KERNEL ShadowRayOf<F> shadow_ray(Vec3<F> origin, const LightDirectionOf<F>& light) {
  if (!any(light.near)) return {origin, light.direction, F(INFINITY), true};
  const Vec3<F> d = light.target - origin;
  const F distance = sqrt(dot(d, d));
  const BoolOf<F> is_there = (!light.near) | (distance > 0);
  return {origin, select(light.near, d / distance, light.direction),
          select(light.near, distance * kJustBefore, F(INFINITY)), is_there};
}

KERNEL bool has_lights(const SceneView& scene) {
  return scene.light_count > 0 || scene.sun_count > 0 || scene.dome.probability > 0;
}

/// Chooses a sun or the dome.
///
/// u   uniform in [0, 1)
KERNEL bool sample_sky(const SceneView& scene, const Receiver& from, vec2 u, LightSample& out) {
  for (u32 i = 0; i < scene.sun_count; ++i) {
    const SunView& sun = scene.suns[i];
    if (u.x < sun.probability) {
      out.direction = sample_sun(sun, out.time, vec2(rescale_uniform(u.x, sun.probability), u.y));
      out.pdf = sun_pdf(sun);
      out.light = kNone;
      out.sun = i;
      out.visibility = sun.visibility;
      return true;
    }
    u.x -= sun.probability;
  }
  if (!(scene.dome.probability > 0)) return false;
  return sample_dome(scene, from, vec2(rescale_uniform(u.x, scene.dome.probability), u.y), out);
}

/// Whether one of the lights of the tree is taken, and which leaf; if not, it is one of the sky.
template <class F>
struct LightChoiceOf {
  BoolOf<F> of_tree;
  LeafChoiceOf<F> leaf;
};
/// surfaces   Receiver::surface_share
/// wanted     where light is
/// u          uniform in [0, 1)
template <class F>
KERNEL LightChoiceOf<F> choose_light(const SceneView& scene, const LitPointOf<F>& to, F surfaces,
                                     BoolOf<F> wanted, F u) {
  LightChoiceOf<F> choice{BoolOf<F>(wanted & (u < surfaces)),
                          {IndexOf<F>(0), surfaces, rescale_uniform(u, surfaces)}};
  if (any(choice.of_tree))
    choose_leaf(scene.light_nodes, to, BoolOf<F>(false), choice.of_tree, choice.leaf);
  return choice;
}

/// A direction to a light that has been chosen; false when no light comes from there.
KERNEL bool sample_light(const SceneView& scene, const Receiver& from,
                         const LightChoiceOf<float>& choice, vec2 u, LightSample& out) {
  if (choice.of_tree) return sample_surface_light(scene, from, choice.leaf, u.y, out);
  out.time = from.time;
  const float sky = sky_share(from);
  const vec2 rest(rescale_uniform(u.x - from.surface_share, sky), u.y);
  if (!sample_sky(scene, from, rest, out)) return false;
  out.pdf *= sky;
  return true;
}

/// Chooses a light and a direction to it; false when no light comes from there.
///
/// u   uniform in [0, 1): the number that chooses goes on to say where, so that the samples of a
///     pixel are as even over each light as over all
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL bool sample_light(const SceneView& scene,
                                                         const Receiver& from, vec2 u,
                                                         LightSample& out) {
  const LightChoiceOf<float> choice =
      choose_light(scene, lit_point(from), from.surface_share, true, u.x);
  return sample_light(scene, from, choice, u, out);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
