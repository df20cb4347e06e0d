// The CPU's answer to rays: kernels::Tracer on Embree. Compiled once for each instruction set.
#pragma once

#include "kernels/geometry/accept.h"
#include "kernels/geometry/motion.h"
#include "kernels/scene/ray.h"
#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// What an EmbreeTracer needs of a scene.
struct TracedScene {
  RTCScene top = nullptr;                     // null: nothing to hit
  const RTCScene* instance_scenes = nullptr;  // by instance: the scene its mesh lies in
  const kernels::SceneView* view = nullptr;
  // The static entities, one instance of the top level: by geometry within it, their instances.
  kernels::u32 group = kernels::kNone;
  const kernels::u32* group_instances = nullptr;

  [[nodiscard]] kernels::u32 instance_of(kernels::u32 instance, kernels::u32 geometry) const {
    return instance == group ? group_instances[geometry] : instance;
  }
  [[nodiscard]] kernels::u32 instance_of(const RTCHit& hit) const {
    return instance_of(hit.instID[0], hit.geomID);
  }
};

inline namespace HELIO_ISA {

/// Thread: any. Lifetime: of the TracedScene's parts.
class EmbreeTracer {
 public:
  explicit EmbreeTracer(const TracedScene& scene) : scene_(scene) {}

  [[nodiscard]] kernels::Hit closest(const kernels::Ray& ray, kernels::u32 mask) const {
    if (!scene_.top || !kernels::is_sound(ray)) return miss();
    RTCRayHit query{};
    fill(query.ray, ray, mask);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    Context context(scene_, ray, kernels::kNone);
    context.intersect(scene_.top, query, scene_.view->any_holes);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return miss();
    return {query.ray.tfar, scene_.instance_of(query.hit), query.hit.primID, query.hit.u,
            query.hit.v};
  }

  void closest(const kernels::CameraRays& rays) const {
    if (!scene_.top || scene_.view->any_holes || rays.count < 2) {
      for (kernels::u32 i = 0; i < rays.count; ++i)
        *rays.hit[i] = closest(*rays.ray[i], kernels::kCameraRay);
      return;
    }
    RTCRayHit8 query;
    alignas(32) int valid[8];
    for (kernels::u32 i = 0; i < 8; ++i) {
      const kernels::Ray& ray = *rays.ray[i < rays.count ? i : 0];
      valid[i] = i < rays.count && kernels::is_sound(ray) ? -1 : 0;
      fill(query.ray, i, ray, kernels::kCameraRay);
      query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
      query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
    }
    Context context(scene_, *rays.ray[0], kernels::kNone);
    context.intersect8(scene_.top, query, valid);
    for (kernels::u32 i = 0; i < rays.count; ++i) {
      const bool met = valid[i] && query.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
      *rays.hit[i] =
          met ? kernels::Hit{query.ray.tfar[i],
                             scene_.instance_of(query.hit.instID[0][i], query.hit.geomID[i]),
                             query.hit.primID[i], query.hit.u[i], query.hit.v[i]}
              : miss();
    }
  }

  [[nodiscard]] bool occluded(const kernels::Ray& ray, kernels::u32 mask) const {
    if (!scene_.top || !kernels::is_sound(ray)) return false;
    RTCRay query{};
    fill(query, ray, mask);
    Context context(scene_, ray, kernels::kNone);
    context.occluded(scene_.top, query, scene_.view->any_holes);
    return query.tfar < 0;
  }

  [[nodiscard]] kernels::Hit closest_in(kernels::u32 instance, const kernels::Ray& ray) const {
    const kernels::InstanceView& view = scene_.view->instances[instance];
    kernels::Ray local = ray;
    const kernels::mat4x3 object_from_world =
        kernels::pose_at(*scene_.view, view, ray.time).object_from_world;
    local.origin = object_from_world * kernels::vec4(ray.origin, 1);
    local.direction = kernels::mat3(object_from_world) * ray.direction;
    if (!kernels::is_sound(local, kernels::kFarthest, kernels::kFarthest)) return miss();
    RTCRayHit query{};
    fill(query.ray, local, kernels::kNone);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    Context context(scene_, ray, instance);
    context.intersect(scene_.instance_scenes[instance], query,
                      (view.flags & kernels::kMayBeHole) != 0);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return miss();
    return {query.ray.tfar, instance, query.hit.primID, query.hit.u, query.hit.v};
  }

  /// Whether a ray of object space, its direction of any length, meets one instance alone.
  [[nodiscard]] bool meets(kernels::u32 instance, const kernels::Ray& ray_object) const {
    if (!kernels::is_sound(ray_object, kernels::kFarthest, kernels::kFarthest)) return false;
    RTCRay query{};
    fill(query, ray_object, kernels::kNone);
    Context context(scene_, ray_object, instance);
    context.occluded(scene_.instance_scenes[instance], query,
                     (scene_.view->instances[instance].flags & kernels::kMayBeHole) != 0);
    return query.tfar < 0;
  }
  /// The same for 8 rays that start and go nearly alike, of an instance without holes; lane i of
  /// `valid` is -1 where there is a ray. Returns a bit for each.
  [[nodiscard]] kernels::u32 meets(kernels::u32 instance, RTCRay8& rays, const int* valid) const {
    Context context(scene_, {}, instance);
    context.occluded8(scene_.instance_scenes[instance], rays, valid);
    kernels::u32 bits = 0;
    for (kernels::u32 i = 0; i < 8; ++i) bits |= kernels::u32(valid[i] && rays.tfar[i] < 0) << i;
    return bits;
  }

 private:
  static kernels::Hit miss() { return {INFINITY, kernels::kNone, kernels::kNone, 0, 0}; }

  static void fill(RTCRay& query, const kernels::Ray& ray, kernels::u32 mask) {
    query.org_x = ray.origin.x;
    query.org_y = ray.origin.y;
    query.org_z = ray.origin.z;
    query.dir_x = ray.direction.x;
    query.dir_y = ray.direction.y;
    query.dir_z = ray.direction.z;
    query.tnear = 0;
    query.tfar = ray.t_max;
    query.mask = mask;
    query.time = ray.time;
  }

  static void fill(RTCRay8& query, kernels::u32 i, const kernels::Ray& ray, kernels::u32 mask) {
    query.org_x[i] = ray.origin.x;
    query.org_y[i] = ray.origin.y;
    query.org_z[i] = ray.origin.z;
    query.dir_x[i] = ray.direction.x;
    query.dir_y[i] = ray.direction.y;
    query.dir_z[i] = ray.direction.z;
    query.tnear[i] = 0;
    query.tfar[i] = ray.t_max;
    query.mask[i] = mask;
    query.time[i] = ray.time;
    query.flags[i] = 0;
    query.id[i] = 0;
  }

  /// Embree's context, followed by what the filter function reads.
  struct Context {
#if RTC_VERSION_MAJOR >= 4
    RTCRayQueryContext base;
#else
    RTCIntersectContext base;
#endif
    const TracedScene* traced;
    kernels::Ray ray;
    kernels::u32 instance;  // of closest_in(); kNone: Embree's own

    Context(const TracedScene& s, const kernels::Ray& r, kernels::u32 i)
        : traced(&s), ray(r), instance(i) {
#if RTC_VERSION_MAJOR >= 4
      rtcInitRayQueryContext(&base);
#else
      rtcInitIntersectContext(&base);
#endif
    }

#if RTC_VERSION_MAJOR >= 4
    void intersect(RTCScene scene, RTCRayHit& query, bool holes) {
      RTCIntersectArguments arguments;
      rtcInitIntersectArguments(&arguments);
      arguments.context = &base;
      if (holes) {
        arguments.filter = filter;
        arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
      }
      rtcIntersect1(scene, &query, &arguments);
    }
    void occluded(RTCScene scene, RTCRay& query, bool holes) {
      RTCOccludedArguments arguments;
      rtcInitOccludedArguments(&arguments);
      arguments.context = &base;
      if (holes) {
        arguments.filter = filter;
        arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
      }
      rtcOccluded1(scene, &query, &arguments);
    }
    void intersect8(RTCScene scene, RTCRayHit8& query, const int* valid) {
      RTCIntersectArguments arguments;
      rtcInitIntersectArguments(&arguments);
      arguments.context = &base;
      arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
      rtcIntersect8(valid, scene, &query, &arguments);
    }
    void occluded8(RTCScene scene, RTCRay8& rays, const int* valid) {
      RTCOccludedArguments arguments;
      rtcInitOccludedArguments(&arguments);
      arguments.context = &base;
      arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
      rtcOccluded8(valid, scene, &rays, &arguments);
    }
#else
    void intersect(RTCScene scene, RTCRayHit& query, bool holes) {
      if (holes) base.filter = filter;
      rtcIntersect1(scene, &base, &query);
    }
    void occluded(RTCScene scene, RTCRay& query, bool holes) {
      if (holes) base.filter = filter;
      rtcOccluded1(scene, &base, &query);
    }
    void intersect8(RTCScene scene, RTCRayHit8& query, const int* valid) {
      base.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcIntersect8(valid, scene, &base, &query);
    }
    void occluded8(RTCScene scene, RTCRay8& rays, const int* valid) {
      base.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcOccluded8(valid, scene, &base, &rays);
    }
#endif
  };

  /// Refuses hits that kernels::accepts() sees through. Embree calls it for single rays only.
  static void filter(const RTCFilterFunctionNArguments* arguments) {
    const auto* context = reinterpret_cast<const Context*>(arguments->context);
    const RTCHit hit = rtcGetHitFromHitN(arguments->hit, arguments->N, 0);
    const kernels::u32 instance =
        context->instance == kernels::kNone ? context->traced->instance_of(hit) : context->instance;
    const kernels::SceneView& view = *context->traced->view;
    if (!(view.instances[instance].flags & kernels::kMayBeHole)) return;
    const float t = RTCRayN_tfar(arguments->ray, arguments->N, 0);
    const kernels::Hit candidate{t, instance, hit.primID, hit.u, hit.v};
    if (!kernels::accepts(view, context->ray, candidate)) arguments->valid[0] = 0;
  }

  TracedScene scene_;
};

}  // namespace HELIO_ISA
}  // namespace heliograph::embree
