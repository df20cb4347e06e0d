// Directions from surfaces to lights, in lanes: sample_light() of light.h. Called by
// scatter_lanes.h.
#pragma once

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

/// Nodes of a light tree, one in each lane.
struct NodeLanes {
  Vec3<Floats> center;
  Floats radius2, power;
};
KERNEL NodeLanes nodes_at(const LightNode* nodes, Ints index) {
  constexpr i32 kStride = sizeof(LightNode) / sizeof(float);
  const Ints first = index * kStride;
  const auto field = [&](const float& of_root) { return gather(&of_root, first); };
  const LightNode& root = *nodes;
  return {Vec3<Floats>(field(root.center.x), field(root.center.y), field(root.center.z)),
          field(root.radius2), field(root.power)};
}

struct LeafLanes {
  Ints light;
  Floats probability, rest;
};
/// choose_leaf() in a tree over spheres, of receivers that face the front.
KERNEL LeafLanes choose_light(const LightNode* nodes, Mask wanted, Vec3<Floats> p, Vec3<Floats> n,
                              LeafLanes io) {
  Ints first, inner;
  const auto read = [&](Ints node) {
    for (u32 i = 0; i < kLanes; ++i) {
      const LightNode& at_lane = nodes[node.v[i]];
      first.v[i] = i32(at_lane.first);
      inner.v[i] = at_lane.count == 0 ? -1 : 0;
    }
  };
  read(0);
  for (;;) {
    const Mask goes_down = Mask{inner.v} & wanted;
    if (!any(goes_down)) break;
    const Ints child = select(goes_down, first, Ints(0));
    const NodeLanes a = nodes_at(nodes, child);
    const NodeLanes b = nodes_at(nodes, select(goes_down, child + 1, Ints(0)));
    const Floats share = first_share(front_importance(a.center - p, a.radius2, a.power, n),
                                     front_importance(b.center - p, b.radius2, b.power, n));
    const Mask second = io.rest >= share;
    const Floats part = select(second, 1 - share, share);
    const Floats rest = rescale_uniform(select(second, io.rest - share, io.rest), part);
    io.rest = select(goes_down, rest, io.rest);
    io.probability = select(goes_down, io.probability * part, io.probability);
    read(select(goes_down, child + select(second, Ints(1), Ints(0)), Ints(0)));
    // A lane that is at its light already stays there.
    first = select(goes_down, first, io.light);
    inner = select(goes_down, inner, Ints(0));
    io.light = first;
  }
  return io;
}

/// Where light comes from, and how often a direction there is taken.
struct LightLanes {
  Vec3<Floats> direction, target;
  Floats pdf;  // 0: nothing comes from there
  Ints light;  // LightSample::light
  Floats surface_share;
};

/// sample_light() of a scene that has_plain_lights(), for receivers that face the front.
KERNEL LightLanes sample_lights(const SceneView& scene, Mask wanted, Vec3<Floats> p, Vec3<Floats> n,
                                Vec2<Floats> random) {
  const Floats u = random.x;
  Floats surfaces(scene.light_count > 0 ? 1 : 0);
  if (scene.light_count > 0 && scene.sky_power > 0) {
    const NodeLanes root = nodes_at(scene.light_nodes, 0);
    surfaces = share_of_surfaces(front_importance(root.center - p, root.radius2, root.power, n),
                                 Floats(0.25f * scene.sky_power));
  }
  const Mask sky = u >= surfaces;
  Mask found = wanted & sky;
  LightLanes out{n, Vec3<Floats>(0), Floats(0), Ints(i32(kNone)), surfaces};
  if (const Mask lamps = wanted & !sky; any(lamps)) {
    const u32 root_light = scene.light_nodes[0].count > 0 ? scene.light_nodes[0].first : 0;
    const LeafLanes leaf = choose_light(scene.light_nodes, lamps, p, n,
                                        {i32(root_light), surfaces, rescale_uniform(u, surfaces)});
    constexpr i32 kStride = sizeof(LightView) / sizeof(float);
    static_assert(sizeof(LightView) % sizeof(float) == 0);
    const auto field = [&](const float& of_first) {
      return gather(&of_first, leaf.light * kStride);
    };
    const LightView& first = scene.lights[0];
    const Vec3<Floats> center(field(first.sphere_center.x), field(first.sphere_center.y),
                              field(first.sphere_center.z));
    const Floats radius = field(first.sphere_radius);
    const Vec3<Floats> d = center - p;
    found = found | (lamps & (dot(d, d) > sqr(radius)));
    const SphereLightSample<Floats> s =
        sample_sphere_light(center, radius, p, leaf.probability, Vec2<Floats>(leaf.rest, random.y));
    out.direction = s.direction;
    out.target = s.target;
    out.pdf = s.pdf;
    out.light = select(sky, out.light, leaf.light);
  }
  if (any(wanted & sky)) {
    const Floats share = 1 - surfaces;
    const Vec3<Floats> local =
        sample_cosine(Vec2<Floats>(rescale_uniform(u - surfaces, share), random.y));
    out.direction = select(sky, to_world(make_frame(n), local), out.direction);
    out.pdf = select(sky, local.z * kInvPi * scene.dome.probability * share, out.pdf);
  }
  out.pdf = select(found, out.pdf, Floats(0));
  return out;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
