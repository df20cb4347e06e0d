// Meshes of scenes as kernels see them. Included by test_scene.h.
#pragma once

#include <vector>

#include "kernels/scene/scene_view.h"

namespace heliograph::test {

using namespace heliograph::kernels;

struct TestMesh {
  std::vector<vec3> positions, normals;
  std::vector<vec2> uvs;
  std::vector<vec4> colors, tangents;
  std::vector<uvec3> triangles;
  std::vector<u32> parts;
  Shape shape = Shape::kTriangles;
  std::vector<vec4> strand_points;  // of curves
};

/// A unit disc or sphere.
inline TestMesh unit_shape(Shape shape) {
  TestMesh m;
  m.shape = shape;
  m.positions = {{1, -1, 0}, {-1, -1, 0}, {1, 1, 0}};
  m.uvs = {{0, 0}, {1, 0}, {0, 1}};
  m.triangles = {{0, 1, 2}};
  return m;
}

/// A strand through points, each with its radius in w.
inline TestMesh strand(const std::vector<vec4>& points) {
  TestMesh m;
  m.shape = Shape::kCurves;
  for (u32 i = 0; i < points.size(); ++i) {
    m.positions.emplace_back(points[i]);
    m.strand_points.emplace_back(1, 0.5f, 0.25f, points[i].w);
    if (i > 0) m.triangles.emplace_back(i - 1, i, i - 1);
  }
  return m;
}

/// A rectangle in the plane z = 0 that faces +z; uv (0, 0) at (-x, -y).
inline TestMesh rectangle(float half_x, float half_y) {
  TestMesh m;
  m.positions = {
      {-half_x, -half_y, 0}, {half_x, -half_y, 0}, {half_x, half_y, 0}, {-half_x, half_y, 0}};
  m.uvs = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
  m.triangles = {{0, 1, 2}, {0, 2, 3}};
  return m;
}

/// A closed box from one corner to another.
inline TestMesh block(vec3 lower, vec3 upper) {
  TestMesh m;
  for (int axis = 0; axis < 3; ++axis) {
    for (const float side : {-1.0f, 1.0f}) {
      vec3 n(0), t(0);
      n[axis] = side;
      t[(axis + 1) % 3] = side;
      const vec3 b = cross(n, t);
      const u32 first = u32(m.positions.size());
      for (const vec2 c : {vec2(-1, -1), vec2(1, -1), vec2(1, 1), vec2(-1, 1)}) {
        const vec3 p = (n + t * c.x + b * c.y) * 0.5f + 0.5f;
        m.positions.push_back(lower + (upper - lower) * p);
      }
      m.triangles.push_back({first, first + 1, first + 2});
      m.triangles.push_back({first, first + 2, first + 3});
    }
  }
  return m;
}
/// One about the origin.
inline TestMesh block(vec3 half) { return block(-half, half); }

/// A unit sphere of 2 * rings^2 * 2 triangles with smooth normals, facing outwards.
inline TestMesh sphere(u32 rings, bool smooth = true) {
  TestMesh m;
  const u32 columns = 2 * rings;
  for (u32 i = 0; i <= rings; ++i) {
    for (u32 j = 0; j <= columns; ++j) {
      const double theta = M_PI * i / rings;
      const double phi = 2 * M_PI * j / columns;
      const vec3 p(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
      m.positions.push_back(p);
      m.uvs.push_back(vec2(float(j) / float(columns), 1 - float(i) / float(rings)));
    }
  }
  const auto at = [&](u32 i, u32 j) { return i * (columns + 1) + j; };
  for (u32 i = 0; i < rings; ++i) {
    for (u32 j = 0; j < columns; ++j) {
      if (i > 0) m.triangles.push_back({at(i, j), at(i + 1, j), at(i, j + 1)});
      if (i + 1 < rings) m.triangles.push_back({at(i, j + 1), at(i + 1, j), at(i + 1, j + 1)});
    }
  }
  if (smooth) m.normals = m.positions;
  return m;
}

}  // namespace heliograph::test
