// Light trees: choosing an emitter by what it may send to a point. Called by light.h; who builds a
// tree bounds its leaves and subtrees with the functions here.
#pragma once

#include "kernels/geometry/motion.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Which directions count at a point that receives light.
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
KERNEL float cos_difference(float cos_a, float cos_b, float sin_b) {
  if (cos_a >= cos_b) return 1;
  return cos_a * cos_b + safe_sqrt(1 - cos_a * cos_a) * sin_b;
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

/// importance() of emitters that face everywhere, to the front of a surface with normal n. d: from
/// there to the node's centre
template <class F>
KERNEL F front_importance(Vec3<F> d, F radius2, F power, Vec3<F> n) {
  const NodeSphere<F> sphere(d, radius2);
  const F along = dot(n, d);
  return power * sphere.fall_off() *
         typical_cosine(along * sqrt(sphere.inverse2), sphere.largest_cosine(along));
}

/// How much the emitters of a node may send to a point, up to a common factor: never 0 where they
/// send any.
///
/// Source: Conty Estevez and Kulla 2018, "Importance Sampling of Many Lights with Adaptive Tree
/// Splitting", section 4.1, with the receiver's cosine. Their cosines are the largest ones, and
/// their distance is at least the node's radius; typical cosines and half of the radius have a
/// tenth of the variance (1,000 lights on a ceiling).
KERNEL float importance(const LightNode& node, const Receiver& r, bool two_sided) {
  const vec3 d = node.center - r.p;
  const NodeSphere<float> sphere(d, node.radius2);
  const float scale = std::sqrt(sphere.inverse2);
  float result = node.power * sphere.fall_off();
  if (node.cos_spread > -1) {
    float along = -dot(node.axis, d);
    if (two_sided || node.two_sided) along = std::fabs(along);
    float center = along * scale;
    if (node.cos_spread < 1) {
      const float nearest =
          cos_difference(center, node.cos_spread, safe_sqrt(1 - sqr(node.cos_spread)));
      center = 0.5f * (center + nearest);
      along = nearest * (sphere.distance2 * scale);
    }
    result *= typical_cosine(center, sphere.largest_cosine(along));
    if (!(result > 0)) return 0;
  }
  if (r.facing == Facing::kAny) return result;
  float along = dot(r.n, d);
  if (r.facing == Facing::kBoth) along = std::fabs(along);
  return result * typical_cosine(along * scale, sphere.largest_cosine(along));
}

/// Probability of the first of two siblings. Where neither sends anything, any choice will do.
template <class F>
KERNEL F first_share(F first, F second) {
  const F share = first / (first + second);
  return select(share >= 0, share, F(0.5f));
}
KERNEL float first_share(const LightNode& first, const LightNode& second, const Receiver& r,
                         bool two_sided) {
  return first_share(importance(first, r, two_sided), importance(second, r, two_sided));
}

struct LeafChoice {
  u32 node;
  float probability;
  float rest;  // uniform in [0, 1)
};

/// Descends from io.node to a leaf.
KERNEL void choose_leaf(const LightNode* nodes, const Receiver& r, bool two_sided, LeafChoice& io) {
  LightNode node = nodes[io.node];
  while (node.count == 0) {
    const LightNode a = nodes[node.first], b = nodes[node.first + 1];
    const float share = first_share(a, b, r, two_sided);
    const bool second = io.rest >= share;
    const float part = second ? 1 - share : share;
    io.rest = rescale_uniform(second ? io.rest - share : io.rest, part);
    io.probability *= part;
    io.node = node.first + u32(second);
    node = second ? b : a;
  }
}

/// Probability with which choose_leaf() ends in `leaf`.
KERNEL float leaf_probability(const LightNode* nodes, u32 leaf, const Receiver& r, bool two_sided) {
  float probability = 1;
  for (u32 node = leaf; nodes[node].parent != kNone; node = nodes[node].parent) {
    const u32 first = nodes[nodes[node].parent].first;
    const LightNode a = nodes[first], b = nodes[first + 1];
    const float share = first_share(a, b, r, two_sided);
    probability *= node == first ? share : 1 - share;
  }
  return probability;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
