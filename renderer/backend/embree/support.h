// How far points reach in every direction: the support function of their convex hull. The box that
// it gives a turned mesh is as tight as its vertices are; the box about its turned box is not.
//
// Tested: tests/unit/support_test.cpp.
#pragma once

#include <span>

#include "renderer/base/box.h"

namespace heliograph::embree {

using namespace resident;

/// It is known in 146 directions, those of a grid on an octahedron. In others it is interpolated,
/// which gives no less than there is, as a support function is convex; at most 4 % more for a ball.
class Support {
 public:
  Support() = default;  // of no points
  explicit Support(std::span<const vec3> points);

  [[nodiscard]] bool is_empty() const { return farthest_ < 0; }
  /// About the points, of which there are some, under an affine map; with a margin for rounding.
  [[nodiscard]] Box under(const mat4x3& map) const;

 private:
  static constexpr int kSteps = 6;            // of the grid, from one axis to the next
  static constexpr int kMiddle = kSteps + 1;  // of the table, one step wider at each end

  /// No less than the greatest dot product of a point and the direction, of any length.
  [[nodiscard]] float along(vec3 direction) const;

  // By whether z is negative, then x and y in steps; of directions with |x| + |y| + |z| = 1.
  float reach_[2][2 * kMiddle + 1][2 * kMiddle + 1] = {};
  float farthest_ = -1;  // the largest |coordinate|; < 0: there is no point
};

}  // namespace heliograph::embree
