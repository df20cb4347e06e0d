// Numbers that a client sent, checked and converted. Called by the daemon, and by the GPU's program
// that does so where they lie.
#pragma once

#include "kernels/core/finite.h"
#include "kernels/core/math.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Noise that a product or an inverse in f32 leaves in the last row of a matrix.
inline constexpr float kLastRowTolerance = 1e-6f;

/// True if f32 shows already that a pose has an inverse, as it does for nearly all: axes of 1e-4 to
/// 1e4, whose volume is off by 2e-6 of their box at most, and is 1e-4 of it.
KERNEL bool plainly_invertible(const mat4x3& m) {
  const float x = dot(m[0], m[0]), y = dot(m[1], m[1]), z = dot(m[2], m[2]);
  const float determinant = dot(m[0], cross(m[1], m[2]));
  const auto is_medium = [](float square) { return square >= 1e-8f && square <= 1e8f; };
  return is_medium(x) && is_medium(y) && is_medium(z) &&
         determinant * determinant >= 1e-8f * x * y * z;
}

/// The first three rows of a row-major matrix of 16 numbers as columns. Whether all are numbers of
/// f32, and the last row is 0 0 0 1.
template <class T>
KERNEL bool take_affine(const T* numbers, mat4x3& out) {
  float f[16];
  bool good = true;
  for (int i = 0; i < 16; ++i) {
    f[i] = float(numbers[i]);
    good &= is_finite(f[i]);
  }
  out = mat4x3(f[0], f[4], f[8], f[1], f[5], f[9], f[2], f[6], f[10], f[3], f[7], f[11]);
  for (int i = 0; i < 4; ++i)
    good &= glm::abs(f[12 + i] - (i == 3 ? 1.0f : 0.0f)) <= kLastRowTolerance;
  return good;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
