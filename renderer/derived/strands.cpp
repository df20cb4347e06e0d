#include "renderer/derived/strands.h"

#include <glm/glm.hpp>
#include <vector>

namespace heliograph::resident {
namespace {

/// A unit vector across a unit vector.
glm::dvec3 any_across(const glm::dvec3& axis) {
  const bool along_z = std::abs(axis.z) > 0.9;
  return glm::normalize(glm::cross(axis, along_z ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 0, 1)));
}

/// Turn from the unit vector `from` to `to` by the shortest way, applied to a vector across it.
glm::dvec3 turned(const glm::dvec3& across, const glm::dvec3& from, const glm::dvec3& to) {
  const double opposite = 1 + glm::dot(from, to);
  if (!(opposite > 1e-12)) return across;
  return across - (from + to) * (glm::dot(to, across) / opposite);
}

/// Directions of the segments from the points of a strand; those of no length have the one before.
std::vector<glm::dvec3> axes_of(std::span<const vec3> points) {
  std::vector<glm::dvec3> axes;
  glm::dvec3 last(0, 0, 1);
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const glm::dvec3 edge = glm::dvec3(points[i + 1]) - glm::dvec3(points[i]);
    const double length = glm::length(edge);
    if (length > 0) last = edge / length;
    axes.push_back(last);
  }
  return axes;
}

/// Vectors across the segments of a strand that turn with them as little as they can.
///
/// After Wang et al. 2008, "Computation of Rotation Minimizing Frames", ACM TOG 27(1), section 1:
/// frames without torsion, here of a polyline.
void add_points(std::span<const vec3> points, std::span<const float> radii,
                std::vector<vec4>& out) {
  const std::vector<glm::dvec3> axes = axes_of(points);
  glm::dvec3 across = any_across(axes[0]);
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (i > 0 && i < axes.size()) across = turned(across, axes[i - 1], axes[i]);
    out.emplace_back(vec3(across), radii[i]);
  }
}

void add_uvs(std::span<const vec3> points, std::vector<vec2>& out) {
  std::vector<double> lengths{0};
  for (std::size_t i = 1; i < points.size(); ++i)
    lengths.push_back(lengths.back() +
                      glm::distance(glm::dvec3(points[i - 1]), glm::dvec3(points[i])));
  for (const double length : lengths)
    out.emplace_back(lengths.back() > 0 ? float(length / lengths.back()) : 0, 0);
}

}  // namespace

std::shared_ptr<const Strands> strands_of(const MeshTopology& topology, const VertexKeys& vertices,
                                          DerivedCache& cache) {
  if (topology.curves.empty()) return nullptr;
  const DerivedKey key{Derived::kStrands,
                       {vertices.positions.serial(), topology.triangles.serial()}};
  const Sources sources{vertices.positions.buffer(), topology.triangles.buffer()};
  return cache.get<Strands>(key, sources, [&] {
    std::vector<vec4> points;
    std::vector<vec2> uvs;
    points.reserve(topology.vertex_count);
    uvs.reserve(topology.vertex_count);
    u32 first = 0;
    for (const u32 count : topology.curves.span()) {
      const auto strand = vertices.positions.span().subspan(first, count);
      add_points(strand, topology.radii.span().subspan(first, count), points);
      add_uvs(strand, uvs);
      first += count;
    }
    auto strands = std::make_shared<Strands>();
    strands->points = ArrayOf(std::move(points));
    strands->uvs = ArrayOf(std::move(uvs));
    return strands;
  });
}

}  // namespace heliograph::resident
