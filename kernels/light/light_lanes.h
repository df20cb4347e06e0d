// Directions from surfaces to lights, in lanes: sample_light() of light.h. Called by
// scatter_lanes.h.
#pragma once

#include <cstddef>

#include "kernels/core/lanes.h"
#include "kernels/light/light.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// True if lights are sampled in lanes, too: even spheres and a dome that is even or has texels.
KERNEL bool has_plain_lights(const SceneView& scene) {
  const DomeView& dome = scene.dome;
  constexpr u64 kMostTexels = u64(1) << 31;  // that lanes can count
  const bool plain_dome =
      dome.row_cdf ? u64(dome.width) * dome.height <= kMostTexels : dome.texture == kNone;
  const bool plain_sky = !(dome.probability > 0) || (plain_dome && dome.portal_count == 0);
  return scene.only_spheres && scene.sun_count == 0 && plain_sky && has_lights(scene);
}
/// Where points that light comes to have to be taken one by one all the same: from both sides under
/// an even dome.
KERNEL Mask takes_sides(const SceneView& scene, const LitPointOf<Floats>& to) {
  return scene.dome.row_cdf ? Mask(false) : to.both;
}

/// Reads a member of LightNodes, given that of the root.
struct NodeLanes {
  Ints place;  // in floats

  explicit NodeLanes(Ints node) : place(node * i32(sizeof(LightNode) / sizeof(float))) {}
  [[nodiscard]] Floats get(const float& of_root) const { return gather(&of_root, place); }
  [[nodiscard]] Vec3<Floats> get(const vec3& of_root) const {
    return Vec3<Floats>(get(of_root.x), get(of_root.y), get(of_root.z));
  }
  [[nodiscard]] Ints word(const void* of_root) const {
    return IntVector(gather(static_cast<const float*>(of_root), place).v);
  }
};
KERNEL LightLinkOf<Floats> link_at(const LightNode* nodes, Ints i) {
  const NodeLanes lanes(i);
  return {lanes.word(&nodes->first), lanes.word(&nodes->count) & 0xffff};
}
KERNEL LightNodeOf<Floats> node_at(const LightNode* nodes, Ints i) {
  static_assert(offsetof(LightNode, two_sided) == offsetof(LightNode, count) + 2);
  const NodeLanes lanes(i);
  const Ints last = lanes.word(&nodes->count);
  return {lanes.get(nodes->center),
          lanes.get(nodes->radius2),
          lanes.get(nodes->axis),
          lanes.get(nodes->cos_spread),
          lanes.get(nodes->power),
          !((last & 0xff0000) == 0),
          {lanes.word(&nodes->first), last & 0xffff}};
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
    constexpr i32 kStride = sizeof(LightView) / sizeof(float);
    static_assert(sizeof(LightView) % sizeof(float) == 0);
    const auto field = [&](const float& of_first) {
      return gather(&of_first, out.light * kStride);
    };
    const LightView& first = scene.lights[0];
    const Vec3<Floats> center(field(first.sphere_center.x), field(first.sphere_center.y),
                              field(first.sphere_center.z));
    const Floats radius = field(first.sphere_radius);
    const Vec3<Floats> d = center - to.p;
    const SphereLightSample<Floats> s = sample_sphere_light(
        center, radius, to.p, choice.leaf.probability, Vec2<Floats>(choice.leaf.rest, u.y));
    out.to.direction = s.direction;
    out.to.target = s.target;
    out.to.pdf = select(dot(d, d) > sqr(radius), s.pdf, Floats(0));
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

}  // namespace heliograph::kernels::inline HELIO_ISA
