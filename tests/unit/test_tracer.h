// A plain tracer over the primitives of a TestScene, and a film for it. Included by the kernels'
// unit tests.
#pragma once

#include <algorithm>
#include <cstring>
#include <deque>
#include <numeric>
#include <vector>

#include "kernels/geometry/accept.h"
#include "kernels/label/probe.h"
#include "kernels/schedule/scalar.h"
#include "tests/unit/test_scene.h"

namespace heliograph::test {

/// A bounding volume hierarchy over all triangles in world space, halved at the median.
class TestTracer {
 public:
  explicit TestTracer(const SceneView& scene) : scene_(&scene) {
    for (u32 i = 0; i < scene.instance_count; ++i) {
      const InstanceView& instance = scene.instances[i];
      const MeshView& mesh = scene.meshes[instance.mesh];
      if (mesh.shape != Shape::kTriangles) {
        shapes_.push_back(i);
        continue;
      }
      for (u32 p = 0; p < mesh.triangle_count; ++p) {
        const uvec3 t = mesh.triangles[p];
        const auto world = [&](u32 v) {
          return transform_point(instance.world_from_object, mesh.positions[v]);
        };
        triangles_.push_back({world(t.x), world(t.y), world(t.z), i, p});
      }
    }
    if (!triangles_.empty()) build(0, u32(triangles_.size()));
  }
  Hit closest(const Ray& ray, u32 mask) const { return trace(ray, mask, kNone, false); }
  bool occluded(const Ray& ray, u32 mask) const {
    return trace(ray, mask, kNone, true).instance != kNone;
  }
  Hit closest_in(u32 instance, const Ray& ray) const { return trace(ray, ~0u, instance, false); }

 private:
  struct Triangle {
    vec3 a, b, c;
    u32 instance, primitive;
  };
  struct Node {
    vec3 low, high;
    u32 first, count;  // count 0: children at first and first + 1 in node order
    u32 left, right;
  };

  u32 build(u32 first, u32 count) {
    const u32 index = u32(nodes_.size());
    nodes_.push_back({vec3(INFINITY), vec3(-INFINITY), first, count, 0, 0});
    vec3 low(INFINITY), high(-INFINITY);
    for (u32 i = first; i < first + count; ++i) {
      const Triangle& t = triangles_[i];
      low = glm::min(low, glm::min(t.a, glm::min(t.b, t.c)));
      high = glm::max(high, glm::max(t.a, glm::max(t.b, t.c)));
    }
    const vec3 size = high - low;
    const vec3 pad = abs3(low) * 1e-5f + abs3(high) * 1e-5f + vec3(1e-6f);
    nodes_[index].low = low - pad;
    nodes_[index].high = high + pad;
    if (count <= 4) return index;
    const int axis = size.x > size.y && size.x > size.z ? 0 : size.y > size.z ? 1 : 2;
    const auto begin = triangles_.begin() + first;
    std::nth_element(begin, begin + count / 2, begin + count,
                     [&](const Triangle& l, const Triangle& r) {
                       return l.a[axis] + l.b[axis] + l.c[axis] < r.a[axis] + r.b[axis] + r.c[axis];
                     });
    const u32 left = build(first, count / 2);
    const u32 right = build(first + count / 2, count - count / 2);
    nodes_[index].count = 0;
    nodes_[index].left = left;
    nodes_[index].right = right;
    return index;
  }

  Hit trace(Ray ray, u32 mask, u32 only, bool any) const {
    Hit best{INFINITY, kNone, 0, 0, 0};
    for (const u32 i : shapes_) {
      const InstanceView& instance = scene_->instances[i];
      if ((only != kNone && i != only) || !(instance.visibility & mask)) continue;
      const mat4x3& to_object = instance.object_from_world;
      const ShapeRay local{transform_point(to_object, ray.origin),
                           transform_vector(to_object, ray.direction), ray.t_max};
      const MeshView& mesh = scene_->meshes[instance.mesh];
      for (u32 p = 0; p < mesh.triangle_count; ++p) {
        ShapeHit hit;
        if (!meet_primitive({mesh, p, ray.time}, {local.origin, local.direction, ray.t_max}, hit))
          continue;
        best = {hit.t, i, p, hit.place.x, hit.place.y};
        ray.t_max = hit.t;
      }
    }
    if (nodes_.empty()) return best;
    float t_max = ray.t_max;
    const vec3 inverse = vec3(1) / ray.direction;
    u32 stack[64];
    u32 size = 0;
    stack[size++] = 0;
    while (size > 0) {
      const Node& node = nodes_[stack[--size]];
      const vec3 a = (node.low - ray.origin) * inverse;
      const vec3 b = (node.high - ray.origin) * inverse;
      const vec3 near = glm::min(a, b);
      const vec3 far = glm::max(a, b);
      if (std::max({near.x, near.y, near.z, 0.0f}) > std::min({far.x, far.y, far.z, t_max})) {
        continue;
      }
      if (node.count == 0) {
        stack[size++] = node.left;
        stack[size++] = node.right;
        continue;
      }
      for (u32 i = node.first; i < node.first + node.count; ++i) {
        const Triangle& t = triangles_[i];
        if (only != kNone && t.instance != only) continue;
        if (!(scene_->instances[t.instance].visibility & mask)) continue;
        Hit hit;
        if (!intersect(t, ray, t_max, hit)) continue;
        const bool holes = scene_->instances[t.instance].flags & kMayBeHole;
        if (holes && !accepts(*scene_, ray, hit)) continue;
        best = hit;
        t_max = hit.t;
        if (any) return best;
      }
    }
    return best;
  }

  /// Möller and Trumbore 1997.
  static bool intersect(const Triangle& t, const Ray& ray, float t_max, Hit& hit) {
    const vec3 ab = t.b - t.a;
    const vec3 ac = t.c - t.a;
    const vec3 p = cross(ray.direction, ac);
    const float det = dot(ab, p);
    if (det == 0) return false;
    const vec3 s = ray.origin - t.a;
    const float u = dot(s, p) / det;
    const vec3 q = cross(s, ab);
    const float v = dot(ray.direction, q) / det;
    const float distance = dot(ac, q) / det;
    if (!(u >= 0 && v >= 0 && u + v <= 1 && distance > 0 && distance < t_max)) return false;
    hit = {distance, t.instance, t.primitive, u, v};
    return true;
  }

  const SceneView* scene_;
  std::vector<Triangle> triangles_;
  std::vector<Node> nodes_;
  std::vector<u32> shapes_;  // instances
};

/// A film in host memory, with the planes asked for.
class TestFilm {
 public:
  /// rank_of_group: of BEAUTY_GROUP, by light group of the scene.
  TestFilm(uvec2 size, PlaneSet wanted, std::vector<u32> rank_of_group = {0})
      : rank_of_group_(std::move(rank_of_group)) {
    view.wanted = wanted;
    view.width = size.x;
    view.height = size.y;
    for (u32 i = 0; i < kPlanes; ++i) {
      if (!(wanted >> i & 1)) continue;
      memory_[i].assign(size_t(size.x) * size.y * 4 * std::max<size_t>(1, rank_of_group_.size()),
                        0);
      partial_[i] = memory_[i];
      view.planes[i] = memory_[i].data();
      view.partial[i] = partial_[i].data();
    }
    view.rank_of_group = rank_of_group_.data();
    for (const u32 rank : rank_of_group_) view.groups += rank != kNone;
    moments_.assign(size_t(size.x) * size.y * 2, 0);
    moments_partial_ = moments_;
    if (wanted & plane_bit(Plane::BEAUTY)) {
      view.moments = moments_.data();
      view.moments_partial = moments_partial_.data();
    }
  }
  /// A channel of a mean plane.
  [[nodiscard]] float mean(Plane plane, u64 i, u32 samples) const {
    return mean_value(view, plane, i, samples);
  }
  /// How many values there is room for in a plane.
  [[nodiscard]] u64 room(Plane plane) const { return memory_[u32(plane)].size(); }
  /// A channel of a centre plane.
  template <class T = float>
  [[nodiscard]] T centre(Plane plane, u64 i) const {
    return static_cast<const T*>(view.planes[u32(plane)])[i];
  }

  FilmView view{};

 private:
  std::vector<u32> rank_of_group_;
  std::vector<float> memory_[kPlanes], partial_[kPlanes];
  std::vector<float> moments_, moments_partial_;
};

/// How many values of a mean plane differ by more than a share of the first; 0: in any bit.
inline u64 different_means(const TestFilm& a, const TestFilm& b, Plane plane, u32 samples,
                           float tolerance = 0) {
  u64 different = 0;
  for (u64 i = 0; i < a.room(plane); ++i) {
    const float x = a.mean(plane, i, samples), y = b.mean(plane, i, samples);
    different += tolerance > 0 ? std::abs(x - y) > tolerance * std::abs(x) : x != y;
  }
  return different;
}

/// A pixel's value of a centre plane of three channels.
inline vec3 at3(const TestFilm& film, Plane plane, u64 pixel) {
  return vec3(film.centre(plane, 3 * pixel), film.centre(plane, 3 * pixel + 1),
              film.centre(plane, 3 * pixel + 2));
}

inline Settings standard_settings(u32 max_depth) {
  return {.seed = 1,
          .max_depth = max_depth,
          .roulette_depth = kNone,
          .clamp = INFINITY,
          .clamp_indirect = INFINITY,
          .filter = PixelFilter::kBox};
}

inline constexpr PlaneSet kBeauty = PlaneSet(1) << u32(Plane::BEAUTY);

/// The mean over all pixels of the film's beauty after `samples` samples each.
inline vec3 mean_beauty(const SceneView& scene, const CameraView& camera, const Settings& settings,
                        u32 samples) {
  const TestTracer tracer(scene);
  const TestFilm film({camera.width, camera.height}, kBeauty);
  vec3 sum(0);
  for (u32 y = 0; y < camera.height; ++y) {
    for (u32 x = 0; x < camera.width; ++x) {
      render_pixel(scene, camera, settings, tracer, film.view, x, y, 0, samples);
      const u64 pixel = u64(y) * camera.width + x;
      for (int c = 0; c < 3; ++c) sum[c] += film.mean(Plane::BEAUTY, 4 * pixel + u64(c), samples);
    }
  }
  return sum / float(camera.width * camera.height);
}

}  // namespace heliograph::test
