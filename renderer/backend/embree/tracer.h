// The CPU's answer to rays: kernels::Tracer on Embree. Compiled once for each instruction set.
#pragma once

#include <new>

#include "kernels/geometry/accept.h"
#include "kernels/geometry/exact.h"
#include "kernels/geometry/motion.h"
#include "kernels/scene/ray.h"
#include "renderer/backend/embree/second_look.h"

namespace heliograph::embree {

inline void fill(RTCRay& query, const kernels::Ray& ray, kernels::u32 mask) {
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

inline void fill(RTCRay8& query, kernels::u32 i, const kernels::Ray& ray, kernels::u32 mask) {
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
  query.id[i] = i;
}
inline void fill(RTCRayHit8& query, kernels::u32 i, const kernels::Ray& ray, kernels::u32 mask) {
  fill(query.ray, i, ray, mask);
  query.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0][i] = RTC_INVALID_GEOMETRY_ID;
}

inline constexpr kernels::Hit kMiss{INFINITY, kernels::kNone, kernels::kNone, 0, 0};

/// Sets what a ray met, if it met anything. Numbers are written where they stay: a copy of several
/// at a time would wait for them.
inline void set(kernels::Hit& hit, const RTCRayHit& query, const TracedScene& scene) {
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return;
  hit.t = query.ray.tfar;
  hit.instance = scene.instance_of(query.hit);
  hit.primitive = query.hit.primID;
  hit.u = query.hit.u;
  hit.v = query.hit.v;
}
/// Hit of ray i of a packet.
inline kernels::Hit hit_of(const RTCRayHit8& query, kernels::u32 i, const TracedScene& scene) {
  kernels::Hit hit = kMiss;
  if (query.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID) return hit;
  hit.t = query.ray.tfar[i];
  hit.instance = scene.instance_of(query.hit.instID[0][i], query.hit.geomID[i]);
  hit.primitive = query.hit.primID[i];
  hit.u = query.hit.u[i];
  hit.v = query.hit.v[i];
  return hit;
}

/// Surfaces that rays of labels meet: of those that are nearly at the same distance the one that
/// comes_before() the others.
struct Contest {
  const kernels::Ray* ray[8];  // by RTCRay::id
  kernels::Hit best[8];

  /// Hit of ray i, for which Embree reports `last`: discs and spheres take no part in contests.
  [[nodiscard]] kernels::Hit winner(kernels::u32 i, const kernels::Hit& last,
                                    const kernels::SceneView& scene) const {
    if (last.instance == kernels::kNone) return last;
    const bool whole = kernels::is_whole(scene.meshes[scene.instances[last.instance].mesh].shape);
    return whole ? last : best[i];
  }
};

/// Lanes of a packet that are all there.
alignas(32) inline constexpr int kEvery[8] = {-1, -1, -1, -1, -1, -1, -1, -1};

inline namespace HELIO_ISA {

/// Thread: any. Lifetime: of the TracedScene's parts.
class EmbreeTracer {
 public:
  explicit EmbreeTracer(const TracedScene& scene, const SecondLook& look = {})
      : scene_(scene), look_(look) {}

  [[nodiscard]] kernels::Hit closest(const kernels::Ray& ray, kernels::u32 mask) const {
    kernels::Hit hit = kMiss;
    if (!scene_.top || !kernels::is_sound(ray)) return hit;
    RTCRayHit query{};
    fill(query.ray, ray, mask);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
    Context context(scene_, ray, kernels::kNone);
    if (look_.of == SecondLook::Of::kAll) {
      Contest contest{{&ray}, {kMiss}};
      context.contest = &contest;
      context.intersect(scene_.top, query, true);
      set(hit, query, scene_);
      hit = look_again(scene_, ray, mask, contest.winner(0, hit, *scene_.view));
      return hit;
    }
    context.intersect(scene_.top, query, scene_.view->any_holes);
    set(hit, query, scene_);
    check(ray, mask, hit);
    return hit;
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
      fill(query, i, ray, kernels::kCameraRay);
    }
    Context context(scene_, *rays.ray[0], kernels::kNone);
    context.intersect8(scene_.top, query, valid, false);
    for (kernels::u32 i = 0; i < rays.count; ++i) {
      kernels::Hit& hit = *rays.hit[i];
      new (&hit) kernels::Hit(hit_of(query, i, scene_));  // none where a ray is not valid
      check(*rays.ray[i], kernels::kCameraRay, hit);
    }
  }
  /// 8 sound rays at once, to whom holes are what they are to `ray`; lane i of `valid` is -1 where
  /// there is one. Nothing is looked at again.
  void closest(RTCRayHit8& query, const int* valid, const kernels::Ray& ray) const {
    Context context(scene_, ray, kernels::kNone);
    context.intersect8(scene_.top, query, valid, scene_.view->any_holes);
  }
  /// The same; what they meet is in `contest`.
  void closest(RTCRayHit8& query, const int* valid, Contest& contest) const {
    Context context(scene_, *contest.ray[0], kernels::kNone);
    context.contest = &contest;
    context.intersect8(scene_.top, query, valid, true);
  }
  /// The same in the object space of one instance alone.
  void closest_in(kernels::u32 instance, RTCRayHit8& query, const kernels::Ray& ray_object) const {
    Context context(scene_, ray_object, instance);
    context.intersect8(scene_.instance_scenes[instance], query, kEvery,
                       (scene_.view->instances[instance].flags & kernels::kMayBeHole) != 0);
  }

  [[nodiscard]] bool occluded(const kernels::Ray& ray, kernels::u32 mask) const {
    if (!scene_.top || !kernels::is_sound(ray)) return false;
    RTCRay query{};
    fill(query, ray, mask);
    Context context(scene_, ray, kernels::kNone);
    context.occluded(scene_.top, query, scene_.view->any_holes);
    if (query.tfar < 0) return true;
    kernels::Hit hit = kMiss;
    check(ray, mask, hit);
    return hit.instance != kernels::kNone;
  }

  [[nodiscard]] kernels::Hit closest_in(kernels::u32 instance, const kernels::Ray& ray) const {
    const kernels::InstanceView& view = scene_.view->instances[instance];
    kernels::Ray local = ray;
    const kernels::mat4x3 object_from_world =
        kernels::pose_at(*scene_.view, view, ray.time).object_from_world;
    local.origin = object_from_world * kernels::vec4(ray.origin, 1);
    local.direction = kernels::mat3(object_from_world) * ray.direction;
    if (!kernels::is_sound(local, kernels::kFarthest, kernels::kFarthest)) return kMiss;
    RTCRayHit query{};
    fill(query.ray, local, kernels::kNone);
    query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    Context context(scene_, ray, instance);
    context.intersect(scene_.instance_scenes[instance], query,
                      (view.flags & kernels::kMayBeHole) != 0);
    if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return kMiss;
    return {query.ray.tfar, instance, query.hit.primID, query.hit.u, query.hit.v};
  }

  /// True if a ray of object space, its direction of any length, meets one instance alone.
  [[nodiscard]] bool meets(kernels::u32 instance, const kernels::Ray& ray_object) const {
    if (!kernels::is_sound(ray_object, kernels::kFarthest, kernels::kFarthest)) return false;
    RTCRay query{};
    fill(query, ray_object, kernels::kNone);
    Context context(scene_, ray_object, instance);
    context.occluded(scene_.instance_scenes[instance], query,
                     (scene_.view->instances[instance].flags & kernels::kMayBeHole) != 0);
    return query.tfar < 0 ||
           (look_.of == SecondLook::Of::kAll && meets_after_all(scene_, instance, ray_object));
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
  /// Looks at an answer of Embree again where it should be.
  void check(const kernels::Ray& ray, kernels::u32 mask, kernels::Hit& hit) const {
    if (look_.is_due(ray, kernels::min2(hit.t, ray.t_max)))
      hit = look_again(scene_, ray, mask, hit);
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
    Contest* contest = nullptr;

    Context(const TracedScene& s, const kernels::Ray& r, kernels::u32 i)
        : traced(&s), ray(r), instance(i) {
#if RTC_VERSION_MAJOR >= 4
      rtcInitRayQueryContext(&base);
#else
      rtcInitIntersectContext(&base);
#endif
    }

#if RTC_VERSION_MAJOR >= 4
    void intersect(RTCScene scene, RTCRayHit& query, bool filtered) {
      RTCIntersectArguments arguments;
      rtcInitIntersectArguments(&arguments);
      arguments.context = &base;
      if (filtered) {
        arguments.filter = filter;
        arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
      }
      rtcIntersect1(scene, &query, &arguments);
    }
    void occluded(RTCScene scene, RTCRay& query, bool filtered) {
      RTCOccludedArguments arguments;
      rtcInitOccludedArguments(&arguments);
      arguments.context = &base;
      if (filtered) {
        arguments.filter = filter;
        arguments.flags = RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER;
      }
      rtcOccluded1(scene, &query, &arguments);
    }
    void intersect8(RTCScene scene, RTCRayHit8& query, const int* valid, bool filtered) {
      RTCIntersectArguments arguments;
      rtcInitIntersectArguments(&arguments);
      arguments.context = &base;
      arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
      if (filtered) {
        arguments.filter = filter;
        arguments.flags =
            RTCRayQueryFlags(arguments.flags | RTC_RAY_QUERY_FLAG_INVOKE_ARGUMENT_FILTER);
      }
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
    void intersect(RTCScene scene, RTCRayHit& query, bool filtered) {
      if (filtered) base.filter = filter;
      rtcIntersect1(scene, &base, &query);
    }
    void occluded(RTCScene scene, RTCRay& query, bool filtered) {
      if (filtered) base.filter = filter;
      rtcOccluded1(scene, &base, &query);
    }
    void intersect8(RTCScene scene, RTCRayHit8& query, const int* valid, bool filtered) {
      if (filtered) base.filter = filter;
      base.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcIntersect8(valid, scene, &base, &query);
    }
    void occluded8(RTCScene scene, RTCRay8& rays, const int* valid) {
      base.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
      rtcOccluded8(valid, scene, &base, &rays);
    }
#endif
  };

  /// Refuses hits that kernels::accepts() sees through, and those that lose a contest.
  static void filter(const RTCFilterFunctionNArguments* arguments) {
    const auto* context = reinterpret_cast<const Context*>(arguments->context);
    const kernels::SceneView& view = *context->traced->view;
    for (unsigned i = 0; i < arguments->N; ++i) {
      if (!arguments->valid[i]) continue;
      const RTCHit hit = rtcGetHitFromHitN(arguments->hit, arguments->N, i);
      const kernels::u32 instance = context->instance == kernels::kNone
                                        ? context->traced->instance_of(hit)
                                        : context->instance;
      float& t = RTCRayN_tfar(arguments->ray, arguments->N, i);
      const kernels::Hit candidate{t, instance, hit.primID, hit.u, hit.v};
      const bool may_be_hole = (view.instances[instance].flags & kernels::kMayBeHole) != 0;
      if (may_be_hole && !kernels::accepts(view, context->ray, candidate)) {
        arguments->valid[i] = 0;
      } else if (context->contest) {
        const kernels::u32 ray = RTCRayN_id(arguments->ray, arguments->N, i);
        if (wins(view, *context->contest, ray, candidate))
          t *= 1 + kernels::kUnclear;  // others as far away may come before it
        else
          arguments->valid[i] = 0;
      }
    }
  }

  static bool wins(const kernels::SceneView& view, Contest& contest, kernels::u32 ray,
                   const kernels::Hit& hit) {
    kernels::Hit& best = contest.best[ray];
    const bool takes = kernels::takes_over(view, *contest.ray[ray], hit, best);
    if (takes) best = hit;
    return takes;
  }

  TracedScene scene_;
  SecondLook look_;
};

}  // namespace HELIO_ISA
}  // namespace heliograph::embree
