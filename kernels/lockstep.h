// Paths side by side: how a CPU runs the path tracer. Every step of every path is that of path.h.
// Paths that take the same step one after the other find its code in the caches, and what they
// read next is asked for before the first of them waits for it.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include "kernels/later.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Asks for what surface_at() reads first.
KERNEL void prefetch_triangle(const SceneView& scene, const Hit& hit) {
  prefetch(scene.meshes[scene.instances[hit.instance].mesh].triangles + hit.primitive);
}
/// Asks for what it reads then.
KERNEL void prefetch_corners(const SceneView& scene, const Hit& hit) {
  const MeshView& mesh = scene.meshes[scene.instances[hit.instance].mesh];
  const uvec3 triangle = mesh.triangles[hit.primitive];
  for (int i = 0; i < 3; ++i) {
    prefetch(mesh.positions + triangle[i]);
    if (mesh.normals) prefetch(mesh.normals + triangle[i]);
  }
}

/// Samples of some pixels, side by side. They are added to the film in the order in which they
/// began.
template <Tracer T>
class Lockstep {
 public:
  Lockstep(const SceneView& scene, const CameraView& camera, const Settings& settings,
           const T& tracer, const FilmView& film)
      : scene_(scene), camera_(camera), settings_(settings), tracer_(tracer), film_(film) {}

  [[nodiscard]] bool is_full() const {
    // Light groups add up in the film, path by path.
    return count_ == (wants(film_, Plane::BEAUTY_GROUP) ? 1 : kPaths);
  }

  void begin(u32 x, u32 y, u32 sample) {
    Item& item = items_[count_];
    item.key = pixel_key(settings_.seed, x, y);
    item.pixel = u64(y) * film_.width + x;
    item.sample = sample;
    item.time = path_time(camera_.shutter, Sampler(item.key, sample), y);
    const CameraAt now(camera_, item.time);
    static_cast<SampleHead&>(item.values) = {};
    item.path = begin_sample(context(item, now.camera()), x, y, item.values);
    if (item.path.ray.t_max > 0) active_[active_count_++] = count_;
    ++count_;
  }

  /// Traces them to their ends. Returns the rays traced.
  u32 run() {
    while (active_count_ > 0) {
      trace();
      arrive();
      shine();
    }
    u32 rays = 0;
    for (u32 i = 0; i < count_; ++i) {
      const Item& item = items_[i];
      write_sample(film_, item.pixel, item.values, (item.sample + 1) % kBlock == 0);
      rays += item.values.rays;
    }
    count_ = 0;
    return rays;
  }

 private:
  static constexpr u32 kPaths = 32;

  struct Item {
    u64 key;
    u64 pixel;
    u32 sample;
    float time;
    Path path;
    Reach reach;
    Hit hit;
    SampleValues values;
    LaterLight light;
  };

  /// camera: as it is at the item's time; means nothing to a path on its way.
  PathContext<T> context(const Item& item, const CameraView& camera) const {
    return {scene_,    camera,    settings_, tracer_, film_, Sampler(item.key, item.sample),
            item.time, item.pixel};
  }

  void trace() {
    for (u32 i = 0; i < active_count_; ++i) {
      Item& item = items_[active_[i]];
      item.reach = set_out(context(item, camera_), item.path);
      item.hit = tracer_.closest(item.path.ray, item.path.mask);
      if (item.hit.instance != kNone) prefetch_triangle(scene_, item.hit);
    }
    for (u32 i = 0; i < active_count_; ++i) {
      const Hit& hit = items_[active_[i]].hit;
      if (hit.instance != kNone) prefetch_corners(scene_, hit);
    }
  }

  /// Those that go on stay active; those whose light waits are lit_.
  void arrive() {
    u32 left = 0;
    lit_count_ = 0;
    for (u32 i = 0; i < active_count_; ++i) {
      Item& item = items_[active_[i]];
      const PathContext<T> c = context(item, camera_);
      item.light.ray.t_max = 0;
      const auto take_light = [&](const Path& path, const Vertex& v) {
        sample_light_later(c, path, v, item.values, item.light);
      };
      const bool goes_on =
          kernels::arrive(c, item.path, item.reach, item.hit, item.values, take_light);
      if (item.light.ray.t_max > 0) lit_[lit_count_++] = active_[i];
      if (goes_on && item.path.ray.t_max > 0) active_[left++] = active_[i];
    }
    active_count_ = left;
  }

  void shine() {
    for (u32 i = 0; i < lit_count_; ++i) {
      Item& item = items_[lit_[i]];
      if (tracer_.occluded(item.light.ray, kShadowRay)) continue;
      collect(context(item, camera_), item.values, item.light.light, item.light.route);
    }
  }

  const SceneView& scene_;
  const CameraView& camera_;
  const Settings& settings_;
  const T& tracer_;
  const FilmView& film_;
  Item items_[kPaths];
  u32 active_[kPaths];  // items on their way
  u32 lit_[kPaths];
  u32 count_ = 0, active_count_ = 0, lit_count_ = 0;
};

/// Adds samples [first_sample, first_sample + sample_count) of the pixels of a rectangle to the
/// film; returns rays traced.
template <Tracer T>
KERNEL u64 render_rect(const SceneView& scene, const CameraView& camera, const Settings& settings,
                       const T& tracer, const FilmView& film, const PixelRect& rect,
                       u32 first_sample, u32 sample_count) {
  Lockstep<T> paths(scene, camera, settings, tracer, film);
  u64 rays = 0;
  for (u32 y = rect.y0; y < rect.y1; ++y) {
    for (u32 x = rect.x0; x < rect.x1; ++x) {
      for (u32 i = first_sample; i < first_sample + sample_count; ++i) {
        paths.begin(x, y, i);
        if (paths.is_full()) rays += paths.run();
      }
    }
  }
  return rays + paths.run();
}

}  // namespace heliograph::kernels::inline HELIO_ISA
