// Curves of animated properties, and the keys that they become. Used by glTF, COLLADA and the
// formats of assimp.
//
// Our keys interpolate translation and stretch linearly and rotation by slerp, so linear curves
// keep their own times. Steps get a second key just before each jump; splines are resampled.
#pragma once

#include <initializer_list>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "renderer/assets/builder.h"

namespace heliograph::assets {

/// `width` floats at each key; splines have in-tangent, value, out-tangent. Times strictly
/// increase. Source: glTF 2.0, appendix C (interpolation).
struct Curve {
  enum class Kind : u8 { kStep, kLinear, kSpline } kind = Kind::kLinear;
  bool rotation = false;  // quaternions x y z w
  u32 width = 0;
  std::vector<float> times;  // seconds
  std::vector<float> values;

  [[nodiscard]] const float* value(std::size_t key) const {
    return values.data() + (kind == Kind::kSpline ? 3 * key + 1 : key) * width;
  }
  [[nodiscard]] const float* in_tangent(std::size_t key) const { return value(key) - width; }
  [[nodiscard]] const float* out_tangent(std::size_t key) const { return value(key) + width; }

  /// The times at which our keys must lie.
  void add_times(std::set<double>& out) const;
  void evaluate(double time, float* out) const;
};

/// The curves of one node.
struct Track {
  std::optional<Curve> translation, rotation, scale, weights;
};

/// A node where nothing moves it.
struct Rest {
  std::string name, where;  // for messages
  vec3 translation{0};
  quat rotation{1, 0, 0, 0};
  vec3 scale{1};
};

/// Makes keys, and counts them.
class Keys {
 public:
  explicit Keys(Builder& builder) : builder_(builder) {}

  [[nodiscard]] PosePatch poses(const Rest& rest, const Track& track);
  [[nodiscard]] MorphWeights weights(const Curve& curve);
  /// For loaders that make keys themselves: these count too.
  void add(u64 keys);
  /// A scale of 0 has no inverse; a ten-thousandth cannot be seen either.
  [[nodiscard]] vec3 visible_scale(const std::string& name, const float* s);

 private:
  [[nodiscard]] std::vector<Time> times(std::initializer_list<const std::optional<Curve>*> curves);

  Builder& builder_;
  u64 count_ = 0;
};

}  // namespace heliograph::assets
