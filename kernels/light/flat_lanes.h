// Directions to flat lights in lanes: sample_surface_light() of light_surface.h for those. Called
// by light_lanes.h.
#pragma once

#include "kernels/core/lanes.h"
#include "kernels/light/light_flat.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Rows of each lane's light, and the leaf that holds them.
struct FlatLights {
  const FlatTriangle* rows[kLanes];
  u32 most = 0;  // rows of any of them
  Ints count;
  Vec3<Floats> center;
  Floats radius2, power;
  Mat4x3<Floats> object_from_world;

  /// Row k of lane i's light; its last one beyond.
  [[nodiscard]] const FlatTriangle& row(u32 i, u32 k) const {
    return rows[i][min2(k, u32(get(count, i)) - 1)];
  }
};
/// lights(i)   the one of lane i
template <class L>
KERNEL FlatLights flat_lights(const SceneView& scene, const L& lights) {
  FlatLights out;
  const LightNode* leaves[kLanes];
  const mat4x3* poses[kLanes];
  for (u32 i = 0; i < kLanes; ++i) {
    const LightView& light = lights(i);
    out.rows[i] = scene.flat_triangles + light.flat;
    leaves[i] = light.tree.nodes + light.tree.root;
    poses[i] = &scene.instances[light.instance].object_from_world;
    put(out.count, i, leaves[i]->count);
    out.most = max2(out.most, u32(leaves[i]->count));
  }
  const FourOf<Floats> sphere = read4([&](u32 i) { return &leaves[i]->center.x; });
  out.center = {sphere.of[0], sphere.of[1], sphere.of[2]};
  out.radius2 = sphere.of[3];
  out.power = read4([&](u32 i) { return &leaves[i]->power; }).of[0];
  Floats m[12];
  for (u32 row = 0; row < 3; ++row) {
    const FourOf<Floats> four = read4([&](u32 i) { return &(*poses[i])[0].x + 4 * row; });
    for (u32 k = 0; k < 4; ++k) m[4 * row + k] = four.of[k];
  }
  for (i32 c = 0; c < 4; ++c)
    out.object_from_world[c] = Vec3<Floats>(m[3 * c], m[3 * c + 1], m[3 * c + 2]);
  return out;
}

struct FlatTriangleLanes : WorldTriangleOf<Floats> {
  Floats radiosity, power, offset;
  Mask both;
};
/// Row number(i) of each lane i.
template <class N>
KERNEL FlatTriangleLanes triangles_of(const FlatLights& lights, const N& number) {
  const auto row = [&](u32 k) {
    return read4([&](u32 i) { return &lights.row(i, number(i)).a.x + 4 * k; });
  };
  const FourOf<Floats> a = row(0), b = row(1), c = row(2), d = row(3);
  FlatTriangleLanes t;
  t.a = {a.of[0], a.of[1], a.of[2]};
  t.ab = {b.of[0], b.of[1], b.of[2]};
  t.ac = {c.of[0], c.of[1], c.of[2]};
  t.normal = {d.of[0], d.of[1], d.of[2]};
  t.radiosity = a.of[3], t.power = b.of[3], t.offset = c.of[3];
  t.both = d.of[3] > 0;
  return t;
}

/// Triangle that is taken, as sample_leaf() takes it.
struct FlatChoice {
  Ints row = 0;
  Floats weight = 0, rest = 0;  // of the one that is taken: rest in [0, weight)
  SphereTriangleOf<Floats> seen;
  Floats total = 0;  // of weights; 0: none can be seen
};
inline SphereTriangleOf<Floats> select(Mask m, const SphereTriangleOf<Floats>& a,
                                       const SphereTriangleOf<Floats>& b) {
  return {select(m, a.v0, b.v0),
          select(m, a.v1, b.v1),
          select(m, a.v2, b.v2),
          select(m, a.g0, b.g0),
          select(m, a.g1, b.g1),
          select(m, a.g2, b.g2),
          select(m, a.solid_angle, b.solid_angle)};
}

/// By solid angle times radiosity; u: uniform in [0, 1).
KERNEL FlatChoice choose_near(const FlatLights& lights, Vec3<Floats> p, Floats u) {
  SphereTriangleOf<Floats> seen[kLeafTriangles];
  Floats weights[kLeafTriangles];
  FlatChoice out;
  for (u32 k = 0; k < lights.most; ++k) {
    const Mask there = Ints(i32(k)) < lights.count;
    const FlatTriangleLanes t = triangles_of(lights, [k](u32) { return k; });
    seen[k] = sphere_triangle(t.a, t.ab, t.ac, p);
    const Mask dark = dot(p - t.a, t.normal) <= 0;
    const Mask shows = ((!dark) | t.both) & there & (seen[k].solid_angle > kLeastSolidAngle);
    weights[k] = select(shows, t.radiosity * seen[k].solid_angle, Floats(0));
    out.total += weights[k];
  }
  Floats rest = u * out.total;
  Mask done = false;
  for (u32 k = 0; k < lights.most; ++k) {
    const Mask taken = (weights[k] > 0) & !done;
    out.row = select(taken, Ints(i32(k)), out.row);
    out.weight = select(taken, weights[k], out.weight);
    out.seen = k == 0 ? seen[0] : select(taken, seen[k], out.seen);
    done = done | (taken & (rest < weights[k]));
    rest = select(taken & !done, rest - weights[k], rest);
  }
  out.rest = rest;
  return out;
}
/// By power.
KERNEL FlatChoice choose_far(const FlatLights& lights, Floats u) {
  FlatChoice out;
  out.total = lights.power;
  out.rest = u * lights.power;
  Mask done = false;
  for (u32 k = 0; k < lights.most; ++k) {
    const Floats power = read4([&](u32 i) { return &lights.row(i, k).ab.x; }).of[3];
    out.weight = select(done, out.weight, power);
    const Mask on = (!done) & (out.rest >= power) & (Ints(i32(k) + 1) < lights.count);
    out.rest = select(on, out.rest - power, out.rest);
    out.row = select(on, Ints(i32(k) + 1), out.row);
    done = !on;
  }
  return out;
}

/// Directions from points to lights, which have been chosen with `probability`.
///
/// u   uniform in [0, 1)
KERNEL LightPointOf<Floats> sample_flat_lights(const FlatLights& lights, Vec3<Floats> p,
                                               Floats probability, Vec2<Floats> u) {
  const Mask near =
      is_near(lights.center, lights.radius2, transform_point(lights.object_from_world, p));
  FlatChoice choice;
  if (any(near)) choice = choose_near(lights, p, u.x);
  if (!all(near)) {
    const FlatChoice far = choose_far(lights, u.x);
    choice.row = select(near, choice.row, far.row);
    choice.weight = select(near, choice.weight, far.weight);
    choice.rest = select(near, choice.rest, far.rest);
    choice.total = select(near, choice.total, far.total);
  }
  const FlatTriangleLanes t = triangles_of(lights, [&](u32 i) { return u32(get(choice.row, i)); });
  const Vec2<Floats> own(rescale_uniform(choice.rest, choice.weight), u.y);
  Vec2<Floats> place(0);
  if (!all(near)) place = sample_triangle(own);
  if (any(near)) {
    const Vec3<Floats> direction = sample_sphere_triangle(choice.seen, own);
    place = select(near, place_of<Floats>(t, p, direction), place);
  }
  const Vec3<Floats> target = t.a + t.ab * place.x + t.ac * place.y;
  const Vec3<Floats> d = target - p;
  const Floats distance = sqrt(dot(d, d));
  LightPointOf<Floats> out;
  out.direction = d / distance;
  Floats pdf = area_pdf<Floats>(t, out.direction, distance) * choice.weight / choice.total;
  if (any(near)) pdf = select(near, choice.weight / (choice.total * choice.seen.solid_angle), pdf);
  const Mask front = dot(out.direction, t.normal) < 0;
  out.pdf = select((front | t.both) & (choice.total > 0), probability * pdf, Floats(0));
  const Vec3<Floats> n = normalize(t.normal);
  out.target = target + n * select(front, t.offset, -t.offset);
  return out;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
