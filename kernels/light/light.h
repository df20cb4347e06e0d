// Light that surfaces and the sky emit, and choice of directions to it. Called by path.h.
#pragma once

#include "kernels/light/dome.h"
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
  // A surface's side receives a quarter of the light from everywhere.
  const F received = select(to.all_around, F(1), select(to.both, F(0.5f), F(0.25f)));
  const auto root = node_for_all<F>(scene.light_nodes[0]);
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

/// Part of LightSample that concerns directions to lights.
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

/// Choice between the lights of the tree, with the leaf, and those of the sky.
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
