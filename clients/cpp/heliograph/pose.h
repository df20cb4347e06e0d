// Vectors, matrices and poses: where things are, which way they look and how they move.
//
// World: right-handed, +Z up, metres, radians. Matrices are row-major and multiply column vectors:
// p_world = world_from_local * p_local.
#pragma once

#include <array>
#include <cstddef>
#include <map>
#include <vector>

namespace heliograph::client {

struct Vec3 {
  double x = 0;
  double y = 0;
  double z = 0;
};

/// Linear Rec.709: three numbers, or one for grey.
struct Color {
  double r = 0;
  double g = 0;
  double b = 0;

  Color() = default;
  Color(double grey) : r(grey), g(grey), b(grey) {}
  Color(double red, double green, double blue) : r(red), g(green), b(blue) {}
};

template <class T, std::size_t R, std::size_t C>
struct Matrix {
  std::array<std::array<T, C>, R> rows{};

  T& operator()(std::size_t row, std::size_t column) { return rows[row][column]; }
  const T& operator()(std::size_t row, std::size_t column) const { return rows[row][column]; }

  static Matrix identity() {
    Matrix out;
    for (std::size_t i = 0; i < (R < C ? R : C); ++i) out(i, i) = T(1);
    return out;
  }
};

template <class T, std::size_t R, std::size_t K, std::size_t C>
Matrix<T, R, C> operator*(const Matrix<T, R, K>& a, const Matrix<T, K, C>& b) {
  Matrix<T, R, C> out;
  for (std::size_t i = 0; i < R; ++i)
    for (std::size_t j = 0; j < C; ++j)
      for (std::size_t k = 0; k < K; ++k) out(i, j) += a(i, k) * b(k, j);
  return out;
}

using Mat3 = Matrix<double, 3, 3>;
using Mat4 = Matrix<double, 4, 4>;
using Mat4f = Matrix<float, 4, 4>;  // as it travels: packed poses in this type are not converted

/// parent_from_local: any affine 4x4, or a position with at most one rotation and a scale, which is
/// applied first, along the local axes.
struct Pose {
  Mat4 matrix = Mat4::identity();

  Pose() = default;
  Pose(const Mat4& parent_from_local) : matrix(parent_from_local) {}
  Pose(Vec3 position) : Pose(position, Mat3::identity()) {}
  Pose(Vec3 position, const Mat3& rotation, Vec3 scale = {1, 1, 1});

  /// A quaternion in the order that the name gives; it is normalised. Length 0 is refused.
  static Pose wxyz(Vec3 position, std::array<double, 4> quaternion, Vec3 scale = {1, 1, 1});
  static Pose xyzw(Vec3 position, std::array<double, 4> quaternion, Vec3 scale = {1, 1, 1});
  /// Radians about the fixed x, then y, then z axis.
  static Pose euler(Vec3 position, Vec3 angles, Vec3 scale = {1, 1, 1});

  [[nodiscard]] Vec3 position() const { return {matrix(0, 3), matrix(1, 3), matrix(2, 3)}; }
};

/// (parent of a) * (a of b): b in a's parent.
inline Pose operator*(const Pose& a, const Pose& b) { return {a.matrix * b.matrix}; }

/// Pose of a camera at `eye` that looks at `at`; `up` is up in its image.
Pose look_at(Vec3 eye, Vec3 at, Vec3 up = {0, 0, 1});

/// Time in seconds to pose.
using Keys = std::map<double, Pose>;

/// Uniform motion, about the pose's own position.
struct Motion {
  Vec3 velocity{};          // metres per second, in the parent's frame
  Vec3 angular_velocity{};  // radians per second about that axis of the parent's frame
};

/// Keys over times.front() .. times.back(), increasing, of a thing that is at `pose` at the first
/// of them: at each time, and in between where the rotation exceeds 60 degrees.
Keys moving(const Pose& pose, const std::vector<double>& times, const Motion& motion);

}  // namespace heliograph::client
