// Resampling: the fewest segments whose interpolation stays within a tolerance, tested where keys
// bend the motion and at quarters of the segments.
#include "renderer/frame/motion_keys.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <map>

#include "kernels/geometry/motion.h"
#include "renderer/frame/image_camera.h"

namespace heliograph {
namespace {

using kernels::MotionKey;
using Poses = std::function<mat4x3(Time)>;

constexpr std::array kSegments{1u,  2u,  3u,  4u,  5u,  6u,  8u,  10u,          12u,
                               16u, 20u, 24u, 32u, 48u, 64u, 96u, kMostSegments};
constexpr float kCosHalfTurn = 0.8660254f;  // of half of 60 degrees

/// Largest displacement of the box's corners, and of the unit axes, between two poses.
struct Difference {
  float metres = 0;
  float radians = 0;
};
Difference difference(const mat4x3& a, const mat4x3& b, const MotionTolerance& tolerance) {
  Difference d;
  for (u32 i = 0; i < 8; ++i) {
    const vec4 corner(i & 1 ? tolerance.upper.x : tolerance.lower.x,
                      i & 2 ? tolerance.upper.y : tolerance.lower.y,
                      i & 4 ? tolerance.upper.z : tolerance.lower.z, 1);
    d.metres = std::max(d.metres, glm::length(a * corner - b * corner));
  }
  for (int i = 0; i < 3; ++i)
    d.radians = std::max(d.radians, glm::length(glm::normalize(a[i]) - glm::normalize(b[i])));
  return d;
}

bool within(const mat4x3& a, const mat4x3& b, const MotionTolerance& tolerance) {
  const Difference d = difference(a, b, tolerance);
  return d.metres <= tolerance.metres && d.radians <= tolerance.radians;
}

/// A motion sampled at equidistant times, on demand.
class Sampled {
 public:
  Sampled(const Poses& poses, const TimeSpan& span, u32 segments)
      : poses_(poses), span_(span), segments_(segments), keys_(segments + 1) {}

  [[nodiscard]] const MotionKey& key(u32 i) {
    if (!keys_[i]) keys_[i] = motion_key(poses_(span_.at(double(i) / segments_)));
    return *keys_[i];
  }
  /// True if the keys about u in (0, 1) give the pose there.
  [[nodiscard]] bool fits(double u, const MotionTolerance& tolerance) {
    const u32 i = std::min(u32(u * segments_), segments_ - 1);
    if (std::abs(glm::dot(key(i).rotation, key(i + 1).rotation)) < kCosHalfTurn) return false;
    const mat4x3 there = kernels::interpolate(key(i), key(i + 1), float(u * segments_ - double(i)));
    return within(there, poses_(span_.at(u)), tolerance);
  }
  [[nodiscard]] std::vector<MotionKey> keys() {
    std::vector<MotionKey> out;
    for (u32 i = 0; i <= segments_; ++i) {
      out.push_back(key(i));
      if (i > 0 && glm::dot(out[i].rotation, out[i - 1].rotation) < 0)
        out[i].rotation = -out[i].rotation;
    }
    return out;
  }

 private:
  const Poses& poses_;
  const TimeSpan& span_;
  u32 segments_;
  std::vector<std::optional<MotionKey>> keys_;
};

/// Where in the span interpolation is tested: at the bends first, where it fails first.
std::vector<double> tests(const TimeSpan& span, const std::vector<Time>& bends, u32 segments,
                          u32 parts) {
  std::vector<double> out;
  for (const Time bend : bends) out.push_back((bend - span.begin) / (span.end - span.begin));
  for (u32 i = 1; i < segments * parts; ++i)
    if (i % parts != 0) out.push_back(double(i) / (segments * parts));
  return out;
}

std::vector<MotionKey> resample(const Poses& poses, const TimeSpan& span,
                                const std::vector<Time>& bends, const MotionTolerance& tolerance) {
  for (const u32 segments : kSegments) {
    Sampled sampled(poses, span, segments);
    const std::vector<double> all = tests(span, bends, segments, 4);
    if (segments == kMostSegments ||
        std::ranges::all_of(all, [&](double u) { return sampled.fits(u, tolerance); }))
      return sampled.keys();
  }
  return {};
}

/// The longest way that a point goes from where it is at the span's begin.
float way(const Poses& poses, const TimeSpan& span, vec3 point) {
  constexpr int kSteps = 8;
  const vec3 start = poses(span.begin) * vec4(point, 1);
  float longest = 0;
  for (int i = 1; i <= kSteps; ++i)
    longest =
        std::max(longest, glm::length(poses(span.at(double(i) / kSteps)) * vec4(point, 1) - start));
  return longest;
}

bool stands_still(const std::vector<MotionKey>& keys) {
  return std::ranges::all_of(
      keys, [&](const MotionKey& key) { return std::memcmp(&key, &keys[0], sizeof key) == 0; });
}

// ---------------------------------------------------------------- vertices

/// Vertices at times, each made once.
class Deformation {
 public:
  Deformation(const Snapshot& snapshot, u32 entity, const WorldAt& world_at)
      : snapshot_(snapshot), entity_(entity), world_at_(world_at) {}
  [[nodiscard]] const DeformedVertices& at(Time time) {
    auto& known = known_[time];
    if (!known) {
      known = deform(snapshot_, entity_, time, {world_at_.poses(time), world_at_.in_pieces});
      if (!known) {
        const Mesh& mesh = *snapshot_.find(snapshot_.entities.at(entity_).mesh)->value;
        const auto rest = mesh.vertices->positions.span().first(mesh.topology->vertex_count);
        const auto normals = mesh.vertices->normals.span().first(
            mesh.vertices->normals.empty() ? 0 : mesh.topology->vertex_count);
        known = DeformedVertices{{rest.begin(), rest.end()}, {normals.begin(), normals.end()}};
      }
    }
    return *known;
  }

 private:
  const Snapshot& snapshot_;
  u32 entity_;
  const WorldAt& world_at_;
  std::map<Time, std::optional<DeformedVertices>> known_;
};

float largest_step(const DeformedVertices& a, const DeformedVertices& b) {
  float largest = 0;
  for (std::size_t v = 0; v < a.positions.size(); ++v)
    largest = std::max(largest, glm::length(a.positions[v] - b.positions[v]));
  return largest;
}

/// Largest distance of vertices from where they are between two keys.
float largest_error(const DeformedVertices& a, const DeformedVertices& b, float u,
                    const DeformedVertices& there) {
  float largest = 0;
  for (std::size_t v = 0; v < a.positions.size(); ++v)
    largest = std::max(
        largest, glm::length(glm::mix(a.positions[v], b.positions[v], u) - there.positions[v]));
  return largest;
}

float size_of(const DeformedVertices& vertices) {
  vec3 lower(INFINITY), upper(-INFINITY);
  for (const vec3 p : vertices.positions) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  return glm::length(upper - lower);
}

u32 vertex_segments(Deformation& vertices, const TimeSpan& span, const std::vector<Time>& bends) {
  const DeformedVertices& first = vertices.at(span.begin);
  const float tolerance =
      std::max(kMotionShareOfSize * size_of(first),
               kMotionShareOfWay * std::max(largest_step(first, vertices.at(span.middle())),
                                            largest_step(first, vertices.at(span.end))));
  for (const u32 n : kSegments) {
    if (n >= kMostVertexSegments) break;
    const auto fits = [&](double u) {
      const u32 i = std::min(u32(u * n), n - 1);
      return largest_error(vertices.at(span.at(double(i) / n)),
                           vertices.at(span.at(double(i + 1) / n)), float(u * n - double(i)),
                           vertices.at(span.at(u))) <= tolerance;
    };
    const std::vector<double> all = tests(span, bends, n, 2);
    if (std::ranges::all_of(all, fits)) return n;
  }
  return kMostVertexSegments;
}

}  // namespace

MotionKey motion_key(const mat4x3& world) {
  const glm::dvec3 x(world[0]), y(world[1]), z(world[2]);
  MotionKey key{};
  key.translation = world[3];
  const double xx = glm::length(x);
  const glm::dvec3 r0 = x / xx;
  const double xy = glm::dot(r0, y);
  const double yy = glm::length(y - xy * r0);
  const glm::dvec3 r1 = (y - xy * r0) / yy;
  const glm::dvec3 r2 = glm::cross(r0, r1);
  const glm::dquat q = glm::normalize(glm::quat_cast(glm::dmat3(r0, r1, r2)));
  key.rotation = vec4(q.x, q.y, q.z, q.w);
  key.xx = float(xx);
  key.xy = float(xy);
  key.xz = float(glm::dot(r0, z));
  key.yy = float(yy);
  key.yz = float(glm::dot(r1, z));
  key.zz = float(glm::dot(r2, z));
  return key;
}

std::vector<MotionKey> instance_keys(const Snapshot& snapshot, u32 entity, const TimeSpan& span,
                                     const ShownBox& shown) {
  std::vector<Time> bends;
  if (!moves_within(snapshot, entity, span, bends)) return {};
  const Poses poses = [&](Time time) {
    mat4x3 world = world_pose(snapshot, entity, time);
    for (int i = 0; i < 3; ++i) world[i] *= shown.scale[i];
    return world;
  };
  const mat3 linear(poses(span.middle()));
  MotionTolerance tolerance{.lower = shown.lower, .upper = shown.upper};
  tolerance.metres =
      std::max(kMotionShareOfSize * glm::length(linear * (shown.upper - shown.lower)),
               kMotionShareOfWay * way(poses, span, 0.5f * (shown.lower + shown.upper)));
  auto keys = resample(poses, span, bends, tolerance);
  if (stands_still(keys)) keys.clear();
  return keys;
}

std::vector<MotionKey> pointing_keys(const Snapshot& snapshot, u32 entity, const TimeSpan& span,
                                     float focal) {
  std::vector<Time> bends;
  if (!moves_within(snapshot, entity, span, bends)) return {};
  const Poses poses = [&](Time time) {
    return mat4x3(rigid_camera(world_pose(snapshot, entity, time)));
  };
  constexpr float kPixels = 0.05f;
  const MotionTolerance tolerance{.metres = kMotionShareOfWay * way(poses, span, vec3(0)),
                                  .radians = kPixels / std::max(focal, 1000.0f)};
  auto keys = resample(poses, span, bends, tolerance);
  if (stands_still(keys)) keys.clear();
  return keys;
}

std::optional<DeformedKeys> deform_within(const Snapshot& snapshot, u32 entity,
                                          const TimeSpan& span, const WorldAt& world_at) {
  std::vector<Time> bends;
  DeformedKeys out;
  if (deforms_within(snapshot, entity, span, bends)) {
    Deformation vertices(snapshot, entity, world_at);
    out.segments = vertex_segments(vertices, span, bends);
    for (u32 i = 0; i <= out.segments; ++i) {
      const DeformedVertices& key = vertices.at(span.at(double(i) / out.segments));
      out.vertices.positions.insert(out.vertices.positions.end(), key.positions.begin(),
                                    key.positions.end());
      out.vertices.normals.insert(out.vertices.normals.end(), key.normals.begin(),
                                  key.normals.end());
    }
    return out;
  }
  auto deformed =
      deform(snapshot, entity, span.middle(), {world_at.poses(span.middle()), world_at.in_pieces});
  if (!deformed) return std::nullopt;
  out.vertices = *std::move(deformed);
  return out;
}

}  // namespace heliograph
