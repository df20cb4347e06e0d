// Embree's callbacks of user geometries. A geometry's user data is its MeshView.
#include "renderer/backend/embree/primitive_geometry.h"

#include "kernels/geometry/primitive.h"
#include "renderer/base/box.h"

namespace heliograph::embree {
namespace {

using kernels::Shape;

const kernels::MeshView& mesh_of(const void* user) {
  return *static_cast<const kernels::MeshView*>(user);
}

void bounds(const RTCBoundsFunctionArguments* arguments) {
  Box box;
  kernels::bound_primitive(mesh_of(arguments->geometryUserPtr), arguments->primID,
                           arguments->timeStep, box);
  *arguments->bounds_o = {box.lower.x, box.lower.y, box.lower.z, 0,
                          box.upper.x, box.upper.y, box.upper.z, 0};
}

/// One of some rays. A ray that is alone is where it was: a copy would wait for Embree's stores.
class RayAt {
 public:
  RayAt(RTCRayN* rays, unsigned count, unsigned i) : ray_(reinterpret_cast<const RTCRay*>(rays)) {
    if (count == 1) return;
    copy_ = rtcGetRayFromRayN(rays, count, i);
    ray_ = &copy_;
  }
  RayAt(const RayAt&) = delete;
  RayAt& operator=(const RayAt&) = delete;
  const RTCRay& operator*() const { return *ray_; }

 private:
  const RTCRay* ray_;
  RTCRay copy_;
};

/// True if a ray meets a primitive beyond its tnear, asked by either of Embree's two callbacks.
template <class Arguments>
bool meets(const Arguments* arguments, const RTCRay& ray, kernels::ShapeHit& met) {
  const kernels::PrimitiveAt at{mesh_of(arguments->geometryUserPtr), arguments->primID, ray.time};
  const kernels::vec3 direction(ray.dir_x, ray.dir_y, ray.dir_z);
  kernels::ShapeRay own{{ray.org_x, ray.org_y, ray.org_z}, direction, ray.tfar - ray.tnear};
  if (ray.tnear > 0) own.origin += direction * ray.tnear;
  if (!kernels::meet_primitive(at, own, met)) return false;
  met.t += ray.tnear;
  return true;
}
template <class Arguments>
RTCHit hit_of(const Arguments* arguments, const kernels::ShapeHit& met) {
  RTCHit hit{};
  hit.u = met.place.x;
  hit.v = met.place.y;
  hit.primID = arguments->primID;
  hit.geomID = arguments->geomID;
  hit.instID[0] = arguments->context->instID[0];
  return hit;
}

/// True if the filter of the ray's query takes a hit; it may change where the ray ends.
bool passes(const RTCIntersectFunctionNArguments* arguments,
            const RTCFilterFunctionNArguments& filter) {
#if RTC_VERSION_MAJOR >= 4
  rtcInvokeIntersectFilterFromGeometry(arguments, &filter);
#else
  rtcFilterIntersection(arguments, &filter);
#endif
  return *filter.valid != 0;
}
bool passes(const RTCOccludedFunctionNArguments* arguments,
            const RTCFilterFunctionNArguments& filter) {
#if RTC_VERSION_MAJOR >= 4
  rtcInvokeOccludedFilterFromGeometry(arguments, &filter);
#else
  rtcFilterOcclusion(arguments, &filter);
#endif
  return *filter.valid != 0;
}

/// True if a hit at t counts; for a curve the ray's filter decides so, and may move t.
template <class Arguments>
bool takes(const Arguments* arguments, const RTCRay& ray, RTCHit& hit, float& t) {
  if (mesh_of(arguments->geometryUserPtr).shape != Shape::kCurves) return true;
  RTCRay ended = ray;
  ended.tfar = t;
  int valid = -1;
  if (!passes(arguments, {.valid = &valid,
                          .geometryUserPtr = arguments->geometryUserPtr,
                          .context = arguments->context,
                          .ray = reinterpret_cast<RTCRayN*>(&ended),
                          .hit = reinterpret_cast<RTCHitN*>(&hit),
                          .N = 1}))
    return false;
  t = ended.tfar;
  return true;
}

/// True if `hit` is behind `before`. Of two hits at one distance the one of the lower instance, of
/// one instance of the lower primitive, is nearer, in any order: at joints both have their sphere.
bool is_behind(const RTCHit& hit, const RTCHit& before) {
  if (before.geomID == RTC_INVALID_GEOMETRY_ID) return false;
  if (hit.instID[0] != before.instID[0]) return hit.instID[0] > before.instID[0];
  return hit.primID >= before.primID;
}

void intersect(const RTCIntersectFunctionNArguments* arguments) {
  const unsigned count = arguments->N;
  RTCRayN* rays = RTCRayHitN_RayN(arguments->rayhit, count);
  RTCHitN* hits = RTCRayHitN_HitN(arguments->rayhit, count);
  for (unsigned i = 0; i < count; ++i) {
    if (!arguments->valid[i]) continue;
    const RayAt ray(rays, count, i);
    kernels::ShapeHit met;
    if (!meets(arguments, *ray, met)) continue;
    RTCHit hit = hit_of(arguments, met);
    if (met.t == (*ray).tfar && is_behind(hit, rtcGetHitFromHitN(hits, count, i))) continue;
    if (!takes(arguments, *ray, hit, met.t)) continue;
    RTCRayN_tfar(rays, count, i) = met.t;
    rtcCopyHitToHitN(hits, &hit, count, i);
  }
}

void occluded(const RTCOccludedFunctionNArguments* arguments) {
  const unsigned count = arguments->N;
  for (unsigned i = 0; i < count; ++i) {
    if (!arguments->valid[i]) continue;
    const RayAt ray(arguments->ray, count, i);
    kernels::ShapeHit met;
    if (!meets(arguments, *ray, met)) continue;
    RTCHit hit = hit_of(arguments, met);
    if (takes(arguments, *ray, hit, met.t)) RTCRayN_tfar(arguments->ray, count, i) = -INFINITY;
  }
}

}  // namespace

GeometryHandle primitive_geometry(const kernels::MeshView& mesh, RTCDevice device) {
  GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER));
  rtcSetGeometryUserPrimitiveCount(geometry.get(), mesh.triangle_count);
  rtcSetGeometryTimeStepCount(geometry.get(), mesh.segments + 1);
  rtcSetGeometryUserData(geometry.get(), const_cast<kernels::MeshView*>(&mesh));
  rtcSetGeometryBoundsFunction(geometry.get(), bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry.get(), intersect);
  rtcSetGeometryOccludedFunction(geometry.get(), occluded);
  rtcSetGeometryMask(geometry.get(), ~0u);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

}  // namespace heliograph::embree
