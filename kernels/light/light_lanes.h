// Directions from surfaces to lights, in lanes: sample_light() of light.h. Called by
// scatter_lanes.h.
#pragma once

#include <cstddef>

#include "kernels/core/lanes.h"
#include "kernels/light/light.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Whether lights are sampled in lanes, too: even spheres under an even sky.
KERNEL bool has_plain_lights(const SceneView& scene) {
  const DomeView& dome = scene.dome;
  const bool even =
      scene.sun_count == 0 && (!(dome.probability > 0) ||
                               (dome.texture == kNone && !dome.row_cdf && dome.portal_count == 0));
  return scene.only_spheres && even && has_lights(scene);
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

/// Where light comes from, and how often a direction there is taken.
struct LightLanes {
  LightDirectionOf<Floats> to;  // pdf 0: nothing comes from there
  Ints light;                   // LightSample::light
};

/// sample_light() of a scene that has_plain_lights(), for points that light comes to from the
/// front.
KERNEL LightLanes sample_plain_lights(const SceneView& scene, const LitPointOf<Floats>& to,
                                      const LightChoiceOf<Floats>& choice, Floats surfaces,
                                      Vec2<Floats> u) {
  const Mask of_tree = choice.of_tree;
  LightLanes out{{to.n, Vec3<Floats>(0), Floats(0), Ints(i32(kAllRays)), of_tree}, i32(kNone)};
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
    const Vec3<Floats> local =
        sample_cosine(Vec2<Floats>(rescale_uniform(u.x - surfaces, share), u.y));
    out.to.direction = select(of_tree, out.to.direction, to_world(make_frame(to.n), local));
    out.to.pdf = select(of_tree, out.to.pdf, local.z * kInvPi * scene.dome.probability * share);
  }
  return out;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
