// Directions from surfaces to lights, in lanes: sample_light() of light.h. Called by
// scatter_lanes.h.
#pragma once

#include <cstddef>

#include "kernels/light/flat_lanes.h"
#include "kernels/light/light.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if lights are sampled in lanes, too: even spheres, flat ones, and a dome that is even or
/// has texels.
KERNEL bool has_plain_lights(const SceneView& scene) {
  const DomeView& dome = scene.dome;
  constexpr u64 kMostTexels = u64(1) << 31;  // that lanes can count
  const bool plain_dome =
      dome.row_cdf ? u64(dome.width) * dome.height <= kMostTexels : dome.texture == kNone;
  const bool plain_sky = !(dome.probability > 0) || (plain_dome && dome.portal_count == 0);
  return scene.only_even && scene.sun_count == 0 && plain_sky && has_lights(scene);
}
/// Where points that light comes to have to be taken one by one all the same: from both sides under
/// an even dome.
KERNEL Mask takes_sides(const SceneView& scene, const LitPointOf<Floats>& to) {
  return scene.dome.row_cdf ? Mask(false) : to.both;
}

// LightNode in rows of four.
static_assert(sizeof(LightNode) == 48 && offsetof(LightNode, radius2) == 12 &&
              offsetof(LightNode, axis) == 16 && offsetof(LightNode, cos_spread) == 28 &&
              offsetof(LightNode, power) == 32 && offsetof(LightNode, first) == 36 &&
              offsetof(LightNode, count) == 44 && offsetof(LightNode, two_sided) == 46);
KERNEL FourOf<Floats> row_of(const LightNode* nodes, Ints i, i32 row) {
  return gather4(&nodes[0].center.x, i * i32(sizeof(LightNode) / sizeof(float)) + row * 4);
}
KERNEL LightLinkOf<Floats> link_of(const FourOf<Floats>& last_row) {
  return {IntVector(last_row.of[1].v), IntVector(last_row.of[3].v) & 0xffff};
}
KERNEL LightLinkOf<Floats> link_at(const LightNode* nodes, Ints i) {
  return link_of(row_of(nodes, i, 2));
}
KERNEL LightNodeOf<Floats> node_at(const LightNode* nodes, Ints i) {
  if (const i32 first = get(i, 0); all(i == first)) return node_for_all<Floats>(nodes[first]);
  const FourOf<Floats> a = row_of(nodes, i, 0), b = row_of(nodes, i, 1), c = row_of(nodes, i, 2);
  const Mask two_sided = !((Ints(IntVector(c.of[3].v)) & 0xff0000) == 0);
  return {Vec3<Floats>(a.of[0], a.of[1], a.of[2]),
          a.of[3],
          Vec3<Floats>(b.of[0], b.of[1], b.of[2]),
          b.of[3],
          c.of[0],
          two_sided,
          link_of(c)};
}

/// sample_dome() where the dome has texels; else by the cosine to the normal n.
KERNEL TexelSample<Floats> sample_plain_dome(const DomeView& dome, Vec3<Floats> n, Vec2<Floats> u) {
  if (dome.row_cdf) return sample_texels(dome, u);
  const Vec3<Floats> local = sample_cosine(u);
  return {Vec2<Floats>(0), to_world(make_frame(n), local), local.z * kInvPi * dome.probability};
}

/// Where light comes from, and how often a direction there is taken.
struct LightLanes {
  LightDirectionOf<Floats> to;  // pdf 0: nothing comes from there
  Ints light;                   // LightSample::light
  Vec2<Floats> place;           // LightSample::place
};

/// Points of lights that are spheres or flat, where `wanted`.
KERNEL LightPointOf<Floats> sample_even_lights(const SceneView& scene, Ints light, Mask wanted,
                                               Vec3<Floats> p, Floats probability, Vec2<Floats> u) {
  static_assert(sizeof(LightView) % sizeof(float) == 0 &&
                offsetof(LightView, sphere_radius) == offsetof(LightView, sphere_center) + 12);
  const FourOf<Floats> sphere =
      gather4(&scene.lights[0].sphere_center.x, light * i32(sizeof(LightView) / sizeof(float)));
  const Floats radius = sphere.of[3];
  const Mask flat = wanted & !(radius > 0);
  LightPointOf<Floats> out{};
  if (any(flat)) {
    const Ints one = fill(flat, light);
    const auto lights = [&](u32 i) -> const LightView& { return scene.lights[get(one, i)]; };
    out = sample_flat_lights(flat_lights(scene, lights), p, probability, u);
    if (all(flat | !wanted)) return out;
  }
  const Vec3<Floats> center(sphere.of[0], sphere.of[1], sphere.of[2]), d = center - p;
  LightPointOf<Floats> s = sample_sphere_light(center, radius, p, probability, u);
  s.pdf = select(dot(d, d) > sqr(radius), s.pdf, Floats(0));
  return {select(flat, out.direction, s.direction), select(flat, out.target, s.target),
          select(flat, out.pdf, s.pdf)};
}

/// sample_light() of a scene that has_plain_lights(), but where a point takes_sides().
KERNEL LightLanes sample_plain_lights(const SceneView& scene, const LitPointOf<Floats>& to,
                                      const LightChoiceOf<Floats>& choice, Floats surfaces,
                                      Vec2<Floats> u) {
  const Mask of_tree = choice.of_tree;
  LightLanes out{{to.n, Vec3<Floats>(0), Floats(0), Ints(i32(kAllRays)), of_tree},
                 i32(kNone),
                 Vec2<Floats>(0)};
  if (any(of_tree)) {
    out.light = select(of_tree, link_at(scene.light_nodes, choice.leaf.node).first, Ints(0));
    const LightPointOf<Floats> s =
        sample_even_lights(scene, out.light, of_tree, to.p, choice.leaf.probability,
                           Vec2<Floats>(choice.leaf.rest, u.y));
    out.to.direction = s.direction;
    out.to.target = s.target;
    out.to.pdf = s.pdf;
    out.light = select(of_tree, out.light, Ints(i32(kNone)));
  }
  if (!all(of_tree)) {
    const Floats share = 1 - surfaces;
    const Vec2<Floats> rest(rescale_uniform(u.x - surfaces, share), u.y);
    const TexelSample<Floats> sky = sample_plain_dome(scene.dome, to.n, rest);
    out.place = sky.place;
    out.to.direction = select(of_tree, out.to.direction, sky.direction);
    out.to.pdf = select(of_tree, out.to.pdf, sky.pdf * share);
  }
  return out;
}

/// light_radiance() of what it found, under a dome without a picture.
KERNEL Vec3<Floats> plain_radiance(const SceneView& scene, const LightLanes& lights) {
  const Vec3<Floats> sky(scene.dome.radiance);
  const Mask of_tree = !(lights.light == i32(kNone));
  if (!any(of_tree)) return sky;
  const FourOf<Floats> light =
      gather4(&scene.lights[0].radiance.x,
              select(of_tree, lights.light, Ints(0)) * i32(sizeof(LightView) / sizeof(float)));
  return select(of_tree, Vec3<Floats>(light.of[0], light.of[1], light.of[2]), sky);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
