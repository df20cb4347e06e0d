// Rays of labels: those through the pixels of a patch are traced together. Called by the pixel
// loops.
#pragma once

#include <span>

#include "renderer/backend/embree/tracer.h"

namespace heliograph::embree::inline HELIO_ISA {

/// A kernels::Tracer whose answers to labels are watertight. Thread: one.
class ProbeTracer {
 public:
  explicit ProbeTracer(const TracedScene& scene) : scene_(scene), tracer_(scene, kAlwaysAgain) {}

  /// Traces camera rays of probes, at most 8, before they are asked for. Each has a ray beside it
  /// in another packet. Where that meets another triangle before it, or where a ray meets nothing
  /// and others of its patch do, it is looked at again.
  void trace_ahead(std::span<const kernels::Sight> sights) {
    ahead_ = {};
    if (!scene_.top) return;
    RTCRayHit8 packet, beside;
    Contest contest;
    for (kernels::u32 i = 0; i < 8; ++i) {
      const kernels::Ray& ray = sights[i < sights.size() ? i : 0].ray;
      valid_[i] = i < sights.size() && ray.t_max > 0 && kernels::is_sound(ray) ? -1 : 0;
      const kernels::Frame frame = kernels::make_frame(ray.direction);
      contest.ray[i] = &ray;
      contest.best[i] = kMiss;
      kernels::Ray aside = ray;
      aside.direction += (frame.s * 0.43f + frame.t * 0.9f) * 0x1p-16f;
      fill(packet, i, ray, kernels::kCameraRay);
      fill(beside, i, aside, kernels::kCameraRay);
    }
    tracer_.closest(packet, valid_, contest);
    tracer_.closest(beside, valid_, sights[0].ray);
    ahead_ = sights;
    bool any = false;
    for (kernels::u32 i = 0; i < sights.size(); ++i) {
      hits_[i] = contest.winner(i, hit_of(packet, i, scene_), *scene_.view);
      any |= hits_[i].instance != kernels::kNone;
    }
    for (kernels::u32 i = 0; any && i < sights.size(); ++i) {
      const kernels::Hit next = hit_of(beside, i, scene_);
      const bool other = next.primitive != hits_[i].primitive || next.instance != hits_[i].instance;
      if (valid_[i] && (hits_[i].instance == kernels::kNone || (next.t < hits_[i].t && other)))
        hits_[i] = look_again(scene_, sights[i].ray, kernels::kCameraRay, hits_[i]);
    }
  }

  [[nodiscard]] kernels::Hit closest(const kernels::Ray& ray, kernels::u32 mask) const {
    if (mask == kernels::kCameraRay)
      for (kernels::u32 i = 0; i < ahead_.size(); ++i)
        if (valid_[i] && ray.direction == ahead_[i].ray.direction &&
            ray.origin == ahead_[i].ray.origin)
          return hits_[i];
    return tracer_.closest(ray, mask);
  }
  [[nodiscard]] bool occluded(const kernels::Ray& ray, kernels::u32 mask) const {
    return tracer_.occluded(ray, mask);
  }
  [[nodiscard]] kernels::Hit closest_in(kernels::u32 instance, const kernels::Ray& ray) const {
    return tracer_.closest_in(instance, ray);
  }

 private:
  TracedScene scene_;
  EmbreeTracer tracer_;
  std::span<const kernels::Sight> ahead_;
  kernels::Hit hits_[8];
  alignas(32) int valid_[8];
};

}  // namespace heliograph::embree::inline HELIO_ISA
