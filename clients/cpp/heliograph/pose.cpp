// Poses in double precision; the same formulas, in the same order, as the Python client.
#include "heliograph/pose.h"

#include <algorithm>
#include <cmath>
#include <functional>

#include "heliograph/error.h"

namespace heliograph::client {
namespace {

constexpr double kPi = 3.14159265358979323846;

double dot(Vec3 a, Vec3 b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
double length(Vec3 v) { return std::sqrt(dot(v, v)); }
Vec3 cross(Vec3 a, Vec3 b) {
  return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
Vec3 over(Vec3 v, double s) { return {v.x / s, v.y / s, v.z / s}; }

Mat3 rotation_of(std::array<double, 4> wxyz) {
  auto [w, x, y, z] = wxyz;
  const double norm = std::sqrt(w * w + x * x + y * y + z * z);
  if (!(norm >= 1e-9))
    throw ClientError(Code::kInvalidArgument,
                      "wxyz: a quaternion of length 0 is no rotation; give one of length 1",
                      {"wxyz"});
  w /= norm;
  x /= norm;
  y /= norm;
  z /= norm;
  Mat3 out;
  out.rows = {{{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
               {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
               {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}}};
  return out;
}

Mat3 rotation_of(Vec3 angles) {
  const double cx = std::cos(angles.x), cy = std::cos(angles.y), cz = std::cos(angles.z);
  const double sx = std::sin(angles.x), sy = std::sin(angles.y), sz = std::sin(angles.z);
  Mat3 about_x, about_y, about_z;
  about_x.rows = {{{1, 0, 0}, {0, cx, -sx}, {0, sx, cx}}};
  about_y.rows = {{{cy, 0, sy}, {0, 1, 0}, {-sy, 0, cy}}};
  about_z.rows = {{{cz, -sz, 0}, {sz, cz, 0}, {0, 0, 1}}};
  return about_z * about_y * about_x;
}

/// Rodrigues' formula; an axis of any length.
Mat3 rotation_about(Vec3 axis, double angle) {
  const double norm = length(axis);
  Mat3 out = Mat3::identity();
  if (norm == 0) return out;
  const Vec3 a = over(axis, norm);
  Mat3 k;
  k.rows = {{{0, -a.z, a.y}, {a.z, 0, -a.x}, {-a.y, a.x, 0}}};
  const Mat3 kk = k * k;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j)
      out(i, j) += std::sin(angle) * k(i, j) + (1 - std::cos(angle)) * kk(i, j);
  return out;
}

}  // namespace

Pose::Pose(Vec3 position, const Mat3& rotation, Vec3 scale) {
  const std::array<double, 3> at{position.x, position.y, position.z};
  const std::array<double, 3> by{scale.x, scale.y, scale.z};
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3; ++j) matrix(i, j) = rotation(i, j) * by[j];
    matrix(i, 3) = at[i];
  }
}

Pose Pose::wxyz(Vec3 position, std::array<double, 4> quaternion, Vec3 scale) {
  return {position, rotation_of(quaternion), scale};
}

Pose Pose::xyzw(Vec3 position, std::array<double, 4> q, Vec3 scale) {
  return wxyz(position, {q[3], q[0], q[1], q[2]}, scale);
}

Pose Pose::euler(Vec3 position, Vec3 angles, Vec3 scale) {
  return {position, rotation_of(angles), scale};
}

Pose look_at(Vec3 eye, Vec3 at, Vec3 up) {
  const Vec3 towards{at.x - eye.x, at.y - eye.y, at.z - eye.z};
  const double distance = length(towards);
  if (!(distance > 0))
    throw ClientError(Code::kInvalidArgument, "at: eye and at are the same point; move one of them",
                      {"at"});
  const Vec3 forward = over(towards, distance);
  Vec3 right = cross(forward, up);
  if (length(right) < 1e-9 * std::max(1.0, length(up)))
    right = cross(forward, std::abs(forward.y) < 0.9 ? Vec3{0, 1, 0} : Vec3{1, 0, 0});
  right = over(right, length(right));
  const Vec3 upwards = cross(right, forward);
  Mat3 rotation;
  rotation.rows = {{{right.x, upwards.x, -forward.x},
                    {right.y, upwards.y, -forward.y},
                    {right.z, upwards.z, -forward.z}}};
  return {eye, rotation};
}

Keys moving(const Pose& pose, const std::vector<double>& times, const Motion& motion) {
  const bool increasing =
      times.size() >= 2 &&
      std::adjacent_find(times.begin(), times.end(), std::greater_equal<>()) == times.end();
  if (!increasing)
    throw ClientError(Code::kInvalidArgument, "times: give at least two, increasing", {"times"});
  Mat3 start;
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t j = 0; j < 3; ++j) start(i, j) = pose.matrix(i, j);
  const double speed = length(motion.angular_velocity);
  Keys out;
  for (std::size_t i = 0; i + 1 < times.size(); ++i) {
    const double span = times[i + 1] - times[i];
    const int parts = std::max(1, int(std::ceil(span * speed / (kPi / 3) - 1e-9)));
    for (int part = 0; part <= parts; ++part) {
      const double t = part == parts ? times[i + 1] : times[i] + part * (span / parts);
      const double elapsed = t - times[0];
      const Vec3 at = pose.position();
      out[t] = Pose({at.x + motion.velocity.x * elapsed, at.y + motion.velocity.y * elapsed,
                     at.z + motion.velocity.z * elapsed},
                    rotation_about(motion.angular_velocity, speed * elapsed) * start);
    }
  }
  return out;
}

}  // namespace heliograph::client
