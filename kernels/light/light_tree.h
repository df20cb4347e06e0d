// Light trees: choosing an emitter by what it may send to a point. Called by light.h; who builds a
// tree bounds its leaves and subtrees with the functions here.
#pragma once

#include "kernels/geometry/motion.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Directions that count at a point that receives light.
enum class Facing : u8 {
  kFront,  // those in the hemisphere of its normal
  kBoth,   // all, by their cosine to the normal
  kAny     // all alike: a point of a medium
};

/// A point that light is sampled for, at a time.
struct Receiver {
  vec3 p;
  vec3 n;  // unit; unused for kAny
  Facing facing;
  float time;
  float surface_share;  // probability with which sample_light() chooses among the scene's tree
};

/// The receiver in the object space of an instance that has this pose. Half-spaces stay
/// half-spaces: what cannot count in the world cannot count there.
KERNEL Receiver to_object(const ObjectPose& pose, const Receiver& r) {
  return {transform_point(pose.object_from_world, r.p),
          normalize_or(transform_normal(pose.world_from_object, r.n), vec3(0)), r.facing, r.time,
          r.surface_share};
}

// ---------------------------------------------------------------- bounds

/// Bounds of emitters: where they are, where their fronts face, how much they send.
struct LightBounds {
  vec3 lower{INFINITY};
  vec3 upper{-INFINITY};
  vec3 axis{0, 0, 1};     // unit, of a cone that holds the fronts' normals
  float cos_spread = -1;  // of its half angle; -1: every direction
  float power = 0;
  bool two_sided = false;  // some of them emit from both sides
  friend bool operator==(const LightBounds&, const LightBounds&) = default;
};

/// cos(a + b) for angles in [0, pi], -1 where the sum exceeds pi.
KERNEL float cos_sum(float cos_a, float cos_b) {
  if (cos_a + cos_b <= 0) return -1;
  return cos_a * cos_b - safe_sqrt(1 - cos_a * cos_a) * safe_sqrt(1 - cos_b * cos_b);
}

/// Rounding must not shrink a cone.
KERNEL float widened(float cosine) { return cosine > 1 - 1e-6f ? cosine : cosine - 1e-6f; }

/// The bounds of both. The cone's axis lies between theirs, or is theirs if one holds the other.
KERNEL LightBounds merge(const LightBounds& a, const LightBounds& b) {
  LightBounds m;
  m.lower = glm::min(a.lower, b.lower);
  m.upper = glm::max(a.upper, b.upper);
  m.power = a.power + b.power;
  m.two_sided = a.two_sided || b.two_sided;
  const LightBounds& wide = a.cos_spread <= b.cos_spread ? a : b;
  const LightBounds& narrow = a.cos_spread <= b.cos_spread ? b : a;
  m.axis = wide.axis;
  m.cos_spread = wide.cos_spread;
  if (wide.cos_spread <= -1) return m;
  const float between = min2(dot(a.axis, b.axis), 1.0f);
  if (cos_sum(between, narrow.cos_spread) >= wide.cos_spread) return m;
  m.axis = normalize_or(a.axis + b.axis, a.axis);
  m.cos_spread = max2(widened(min2(cos_sum(min2(dot(m.axis, a.axis), 1.0f), a.cos_spread),
                                   cos_sum(min2(dot(m.axis, b.axis), 1.0f), b.cos_spread))),
                      -1.0f);
  return m;
}

KERNEL LightBounds triangle_bounds(vec3 a, vec3 b, vec3 c) {
  LightBounds bounds;
  bounds.lower = glm::min(a, glm::min(b, c));
  bounds.upper = glm::max(a, glm::max(b, c));
  const vec3 n = cross(b - a, c - a);
  bounds.axis = normalize_or(near_one(n), vec3(0, 0, 1));
  bounds.cos_spread = 1;
  bounds.power = 0.5f * length(n);
  return bounds;
}

/// A node with these bounds and without children.
KERNEL LightNode node_of(const LightBounds& b) {
  LightNode node{};
  const vec3 half = 0.5f * (b.upper - b.lower);
  node.center = b.lower + half;
  node.radius2 = dot(half, half);
  node.axis = b.axis;
  node.cos_spread = b.cos_spread;
  node.power = b.power;
  node.parent = kNone;
  node.two_sided = b.two_sided;
  return node;
}

// ---------------------------------------------------------------- choice

/// cos(max(a - b, 0)) for angles in [0, pi].
template <class F>
KERNEL F cos_difference(F cos_a, F cos_b, F sin_b) {
  return select(cos_a >= cos_b, F(1), cos_a * cos_b + safe_sqrt(1 - cos_a * cos_a) * sin_b);
}

/// Points that light is sampled for, as trees see them.
template <class F>
struct LitPointOf {
  Vec3<F> p, n;                // as Receiver has them
  BoolOf<F> both, all_around;  // Facing::kBoth, Facing::kAny
};
KERNEL LitPointOf<float> lit_point(const Receiver& r) {
  return {r.p, r.n, r.facing == Facing::kBoth, r.facing == Facing::kAny};
}

/// Children or lights below nodes of a tree, as LightNode has them.
template <class F>
struct LightLinkOf {
  IndexOf<F> first, count;
};
KERNEL LightLinkOf<float> link_at(const LightNode* nodes, u32 i) {
  return {nodes[i].first, nodes[i].count};
}

/// Nodes of a tree.
template <class F>
struct LightNodeOf {
  Vec3<F> center;
  F radius2;
  Vec3<F> axis;
  F cos_spread, power;
  BoolOf<F> two_sided;
  LightLinkOf<F> link;
};
/// The same one to all points.
template <class F>
KERNEL LightNodeOf<F> node_for_all(const LightNode& node) {
  return {Vec3<F>(node.center),
          F(node.radius2),
          Vec3<F>(node.axis),
          F(node.cos_spread),
          F(node.power),
          BoolOf<F>(node.two_sided),
          {IndexOf<F>(node.first), IndexOf<F>(node.count)}};
}
KERNEL LightNodeOf<float> node_at(const LightNode* nodes, u32 i) {
  return node_for_all<float>(nodes[i]);
}

/// A node's sphere from a point.
template <class F>
struct NodeSphere {
  F distance2, inverse2;  // of its centre: squared, and 1 over that
  F tangent;              // length of a tangent; 0 from within
  F radius2;

  /// d: from the point to its centre; square: of its radius
  KERNEL NodeSphere(Vec3<F> d, F square)
      : distance2(max2(dot(d, d), F(1e-20f))),
        inverse2(1 / distance2),
        tangent(safe_sqrt(distance2 - square)),
        radius2(square) {}

  /// The largest cosine over the sphere to an axis along which its centre is `along` metres away.
  [[nodiscard]] KERNEL F largest_cosine(F along) const {
    const BoolOf<F> whole = (distance2 <= radius2) | (along >= tangent);
    if (all(whole)) return 1;
    const F cosine =
        (along * tangent + safe_sqrt((distance2 - along * along) * radius2)) * inverse2;
    return select(whole, F(1), cosine);
  }
  /// 1 / distance^2, of half of the radius at least.
  [[nodiscard]] KERNEL F fall_off() const {
    const F least2 = 0.25f * radius2;
    return select(distance2 < least2, 1 / least2, inverse2);
  }
};

/// From a cosine at a node's centre and the largest one over the node to a typical one, which is 0
/// only where the largest is. Of 1, 1/2, 1/4 and 1/10, this share of the largest had the least
/// variance.
template <class F>
KERNEL F typical_cosine(F center, F largest) {
  return 0.25f * max2(largest, F(0)) + 0.75f * max2(center, F(0));
}

/// How much the emitters of a node may send to a point, up to a common factor: never 0 where they
/// send any.
///
/// Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
/// Splitting", section 4.1, with the receiver's cosine. Their cosines are the largest ones, and
/// their distance is at least the node's radius; typical cosines and half of the radius have a
/// tenth of the variance (1,000 lights on a ceiling).
template <class F>
KERNEL F importance(const LightNodeOf<F>& node, const LitPointOf<F>& to, BoolOf<F> two_sided) {
  const Vec3<F> d = node.center - to.p;
  const NodeSphere<F> sphere(d, node.radius2);
  const F scale = sqrt(sphere.inverse2);
  F result = node.power * sphere.fall_off();
  if (const auto cones = node.cos_spread > -1; any(cones)) {
    F along = -dot(node.axis, d);
    along = select(two_sided | node.two_sided, abs(along), along);
    F center = along * scale;
    if (const auto wide = node.cos_spread < 1; any(wide)) {
      const F nearest =
          cos_difference(center, node.cos_spread, safe_sqrt(1 - sqr(node.cos_spread)));
      center = select(wide, 0.5f * (center + nearest), center);
      along = select(wide, nearest * (sphere.distance2 * scale), along);
    }
    const F facing = result * typical_cosine(center, sphere.largest_cosine(along));
    result = select(cones, max2(facing, F(0)), result);
    if (!any(result > 0)) return result;
  }
  if (all(to.all_around)) return result;
  F along = dot(to.n, d);
  along = select(to.both, abs(along), along);
  const F received = result * typical_cosine(along * scale, sphere.largest_cosine(along));
  return select(to.all_around, result, received);
}

/// Probability of the first of two siblings. Where neither sends anything, any choice will do.
template <class F>
KERNEL F first_share(F first, F second) {
  const F share = first / (first + second);
  return select(share >= 0, share, F(0.5f));
}

template <class F>
struct LeafChoiceOf {
  IndexOf<F> node;
  F probability;
  F rest;  // uniform in [0, 1)
};
using LeafChoice = LeafChoiceOf<float>;

/// Descends from io.node to leaves, where it is wanted. two_sided: all emitters are
template <class F>
KERNEL void choose_leaf(const LightNode* nodes, const LitPointOf<F>& to, BoolOf<F> two_sided,
                        BoolOf<F> wanted, LeafChoiceOf<F>& io) {
  LightLinkOf<F> link = link_at(nodes, io.node);
  for (;;) {
    const BoolOf<F> inner = wanted & (link.count == 0);
    if (!any(inner)) return;
    const IndexOf<F> first = fill(inner, link.first);
    const LightNodeOf<F> a = node_at(nodes, first), b = node_at(nodes, first + 1);
    const F share = first_share(importance(a, to, two_sided), importance(b, to, two_sided));
    const BoolOf<F> second = io.rest >= share;
    const F part = select(second, 1 - share, share);
    const F rest = rescale_uniform(F(select(second, io.rest - share, io.rest)), part);
    io.rest = select(inner, rest, io.rest);
    io.probability = select(inner, io.probability * part, io.probability);
    io.node = select(inner, select(second, first + 1, first), io.node);
    link.first = select(second, b.link.first, a.link.first);
    link.count = select(inner, select(second, b.link.count, a.link.count), IndexOf<F>(1));
  }
}
KERNEL void choose_leaf(const LightNode* nodes, const Receiver& r, bool two_sided, LeafChoice& io) {
  choose_leaf(nodes, lit_point(r), two_sided, true, io);
}

/// Probability with which choose_leaf() ends in `leaf`.
KERNEL float leaf_probability(const LightNode* nodes, u32 leaf, const Receiver& r, bool two_sided) {
  const LitPointOf<float> to = lit_point(r);
  float probability = 1;
  for (u32 node = leaf; nodes[node].parent != kNone; node = nodes[node].parent) {
    const u32 first = nodes[nodes[node].parent].first;
    const auto a = node_at(nodes, first), b = node_at(nodes, first + 1);
    const float share = first_share(importance(a, to, two_sided), importance(b, to, two_sided));
    probability *= node == first ? share : 1 - share;
  }
  return probability;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
