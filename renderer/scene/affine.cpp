// Affine maps: products, inverses, polar decomposition and interpolation. Declared in motion.h.
#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/geometry/place.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// Turns columns p and q of `a`, and of `v` with them, until they are orthogonal. Whether they
/// were.
bool orthogonalise(glm::dmat3& a, glm::dmat3& v, int p, int q) {
  const double pp = glm::dot(a[p], a[p]), qq = glm::dot(a[q], a[q]), pq = glm::dot(a[p], a[q]);
  if (std::abs(pq) <= 1e-15 * std::sqrt(pp * qq)) return true;
  const double zeta = (qq - pp) / (2 * pq);
  const double t = std::copysign(1 / (std::abs(zeta) + std::sqrt(1 + zeta * zeta)), zeta);
  const double c = 1 / std::sqrt(1 + t * t), s = c * t;
  for (glm::dmat3* m : {&a, &v}) {
    const glm::dvec3 column = (*m)[p];
    (*m)[p] = c * column - s * (*m)[q];
    (*m)[q] = s * column + c * (*m)[q];
  }
  return false;
}

glm::dvec3 any_perpendicular(const glm::dvec3& n) {
  const glm::dvec3 axis = std::abs(n.x) < 0.5 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  return glm::normalize(glm::cross(n, axis));
}

/// The rotation nearest to m, or to -m when m mirrors; a direction that m flattens is chosen so
/// that the result is a rotation.
///
/// Source: one-sided Jacobi, Hestenes 1958, "Inversion of Matrices by Biorthogonalization".
glm::dmat3 nearest_rotation(const glm::dmat3& m) {
  glm::dmat3 u = m, v(1);
  for (int sweep = 0; sweep < 32; ++sweep) {
    const bool first = orthogonalise(u, v, 0, 1), second = orthogonalise(u, v, 0, 2);
    if (orthogonalise(u, v, 1, 2) && first && second) break;
  }
  std::array<int, 3> order{0, 1, 2};  // the largest stretch first
  std::ranges::sort(order, std::greater(), [&](int i) { return glm::length(u[i]); });
  const auto [a, b, c] = order;
  const double flat = 1e-14 * glm::length(u[a]);
  if (glm::length(u[a]) == 0) return glm::dmat3(1);
  u[a] = glm::normalize(u[a]);
  u[b] = glm::length(u[b]) > flat ? glm::normalize(u[b]) : any_perpendicular(u[a]);
  const glm::dvec3 third = glm::cross(u[a], u[b]) * (b == (a + 1) % 3 ? 1.0 : -1.0);
  u[c] = glm::length(u[c]) > flat ? glm::normalize(u[c]) : third;
  const glm::dmat3 q = u * glm::transpose(v);
  return glm::determinant(q) < 0 ? -q : q;
}

}  // namespace

Decomposed decompose(const mat4x3& m) {
  const glm::dmat3 linear{mat3(m)};
  const glm::dmat3 q = nearest_rotation(linear);
  const glm::dmat3 stretch = glm::transpose(q) * linear;
  return {m[3], quat(glm::normalize(glm::quat_cast(q))),
          mat3(0.5 * (stretch + glm::transpose(stretch)))};
}

mat4x3 compose(const Decomposed& d) {
  const mat3 linear = glm::mat3_cast(d.rotation) * d.stretch;
  return {linear[0], linear[1], linear[2], d.translation};
}

mat4x3 interpolate(const mat4x3& a, const mat4x3& b, float u) {
  if (u <= 0 || a == b) return a;
  if (u >= 1) return b;
  const vec3 translation = glm::mix(a[3], b[3], u);
  if (mat3(a) == mat3(b)) return {a[0], a[1], a[2], translation};
  const Decomposed x = decompose(a), y = decompose(b);
  return compose(
      {translation, glm::slerp(x.rotation, y.rotation, u), x.stretch * (1 - u) + y.stretch * u});
}

mat4x3 multiply(const mat4x3& a, const mat4x3& b) {
  const mat3 linear = mat3(a) * mat3(b);
  return {linear[0], linear[1], linear[2], a * vec4(b[3], 1)};
}

mat4x3 inverse(const mat4x3& m) { return kernels::exact_inverse(m); }

}  // namespace heliograph
