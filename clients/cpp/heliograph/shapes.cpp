// Bundled meshes; the same numbers as the Python client's.
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "heliograph/geometry.h"

namespace heliograph::client::shapes {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Point = std::array<float, 3>;
using Uv = std::array<float, 2>;
using Triangle = std::array<std::uint32_t, 3>;

/// A mesh that grows.
struct Builder {
  std::vector<std::array<double, 3>> positions{};
  std::vector<Point> normals{};
  std::vector<Uv> uvs{};
  std::vector<Triangle> triangles{};

  void vertex(Vec3 position, Vec3 normal, double u, double v) {
    positions.push_back({position.x, position.y, position.z});
    normals.push_back({float(normal.x), float(normal.y), float(normal.z)});
    uvs.push_back({float(u), float(v)});
  }

  [[nodiscard]] double area(const Triangle& t) const {
    const auto &p = positions[t[0]], &q = positions[t[1]], &r = positions[t[2]];
    std::array<double, 3> a{}, b{};
    for (std::size_t i = 0; i < 3; ++i) a[i] = q[i] - p[i], b[i] = r[i] - p[i];
    return std::hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                      a[0] * b[1] - a[1] * b[0]);
  }

  /// Quads of a grid of (rows + 1) x (columns + 1) vertices from `first` on, without the triangles
  /// that a pole makes degenerate.
  void quads(std::uint32_t first, int columns, int rows) {
    std::vector<Triangle> lower, upper;
    for (int i = 0; i < rows; ++i)
      for (int j = 0; j < columns; ++j) {
        const auto a = first + std::uint32_t(i * (columns + 1) + j);
        const std::uint32_t b = a + 1, c = a + std::uint32_t(columns) + 2, d = c - 1;
        lower.push_back({a, b, c});
        upper.push_back({a, c, d});
      }
    lower.insert(lower.end(), upper.begin(), upper.end());
    double largest = 0;
    for (const Triangle& t : lower) largest = std::max(largest, area(t));
    for (const Triangle& t : lower)
      if (area(t) > 1e-9 * largest) triangles.push_back(t);
  }

  [[nodiscard]] Geometry finish() const {
    std::vector<Point> points;
    for (const auto& [x, y, z] : positions) points.push_back({float(x), float(y), float(z)});
    Geometry out;
    out.positions = Array(std::move(points));
    out.indices = Array(triangles);
    out.normals = Array(normals);
    out.uvs = Array(uvs);
    return out;
  }
};

/// i of n steps from 0 to 1.
double step(int i, int n) { return i == n ? 1.0 : i * (1.0 / n); }

/// A grid over (u, v) in [0, 1]^2; `surface(u, v, &normal)` gives the position.
template <class Surface>
void add_grid(Builder& out, int columns, int rows, const Surface& surface) {
  const auto first = std::uint32_t(out.positions.size());
  for (int i = 0; i <= rows; ++i)
    for (int j = 0; j <= columns; ++j) {
      const double u = step(j, columns), v = step(i, rows);
      Vec3 normal;
      const Vec3 position = surface(u, v, &normal);
      out.vertex(position, normal, u, v);
    }
  out.quads(first, columns, rows);
}

/// A disc at height z that faces away from the origin.
void add_disc(Builder& out, double radius, double z, int segments) {
  const auto first = std::uint32_t(out.positions.size());
  const Vec3 normal{0, 0, std::copysign(1.0, z)};
  for (int i = 0; i < segments; ++i) {
    const double phi = 2 * kPi * i / segments;
    const double x = std::cos(phi), y = std::sin(phi);
    out.vertex({radius * x, radius * y, z}, normal, 0.5 + 0.5 * x, 0.5 + 0.5 * y);
  }
  out.vertex({0, 0, z}, normal, 0.5, 0.5);
  for (int i = 0; i < segments; ++i) {
    auto a = first + std::uint32_t(i), b = first + std::uint32_t((i + 1) % segments);
    if (z <= 0) std::swap(a, b);
    out.triangles.push_back({a, b, first + std::uint32_t(segments)});
  }
}

}  // namespace

Geometry plane(double size) {
  Builder out;
  const double h = 0.5 * size;
  const std::array<std::array<double, 2>, 4> corners{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
  for (const auto& [u, v] : corners)
    out.vertex({u == 0 ? -h : h, v == 0 ? -h : h, 0}, {0, 0, 1}, u, v);
  out.triangles = {{0, 1, 2}, {0, 2, 3}};
  return out.finish();
}

Geometry cube(double size) {
  struct Side {
    Vec3 x, y, z;
  };
  const std::array<Side, 6> sides{{{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
                                   {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}},
                                   {{0, 1, 0}, {0, 0, 1}, {1, 0, 0}},
                                   {{0, -1, 0}, {0, 0, 1}, {-1, 0, 0}},
                                   {{-1, 0, 0}, {0, 0, 1}, {0, 1, 0}},
                                   {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}}};
  Builder out;
  const double h = double(float(0.5 * size));
  const std::array<std::array<double, 2>, 4> corners{{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
  for (const auto& [x, y, z] : sides) {
    const auto first = std::uint32_t(out.positions.size());
    for (const auto& [u, v] : corners) {
      const double a = u == 0 ? -h : h, b = v == 0 ? -h : h;
      out.vertex(
          {a * x.x + b * y.x + h * z.x, a * x.y + b * y.y + h * z.y, a * x.z + b * y.z + h * z.z},
          z, u, v);
    }
    out.triangles.push_back({first, first + 1, first + 2});
    out.triangles.push_back({first, first + 2, first + 3});
  }
  return out.finish();
}

Geometry sphere(double radius, int segments) {
  Builder out;
  add_grid(out, segments, segments / 2, [&](double u, double v, Vec3* normal) {
    const double phi = 2 * kPi * u, theta = kPi * v;
    *normal = {std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), -std::cos(theta)};
    return Vec3{radius * normal->x, radius * normal->y, radius * normal->z};
  });
  return out.finish();
}

Geometry torus(double radius, double tube, int segments) {
  Builder out;
  add_grid(out, segments, segments / 2, [&](double u, double v, Vec3* normal) {
    const double phi = 2 * kPi * u, theta = 2 * kPi * v;
    const double x = std::cos(phi), y = std::sin(phi);
    *normal = {x * std::cos(theta), y * std::cos(theta), std::sin(theta)};
    return Vec3{radius * x + tube * normal->x, radius * y + tube * normal->y, tube * normal->z};
  });
  return out.finish();
}

Geometry cylinder(double radius, double height, int segments) {
  Builder out;
  add_grid(out, segments, 1, [&](double u, double v, Vec3* normal) {
    const double phi = 2 * kPi * u;
    *normal = {std::cos(phi), std::sin(phi), 0};
    return Vec3{radius * normal->x, radius * normal->y, (v - 0.5) * height};
  });
  add_disc(out, radius, 0.5 * height, segments);
  add_disc(out, radius, -0.5 * height, segments);
  return out.finish();
}

}  // namespace heliograph::client::shapes
