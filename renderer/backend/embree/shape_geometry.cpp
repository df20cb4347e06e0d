// Embree's callbacks of discs and spheres.
#include "renderer/backend/embree/shape_geometry.h"

#include "kernels/geometry/shape.h"

namespace heliograph::embree {
namespace {

using kernels::Shape;
using kernels::vec3;

constexpr Shape kShapes[] = {Shape::kTriangles, Shape::kDisc, Shape::kSphere};

Shape shape_of(const void* user) { return *static_cast<const Shape*>(user); }

void bounds(const RTCBoundsFunctionArguments* arguments) {
  RTCBounds& b = *arguments->bounds_o;
  b.lower_x = b.lower_y = -1;
  b.upper_x = b.upper_y = 1;
  b.upper_z = shape_of(arguments->geometryUserPtr) == Shape::kSphere ? 1 : 0;
  b.lower_z = -b.upper_z;
}

/// Ray i of a packet.
kernels::ShapeRay ray_of(RTCRayN* rays, unsigned count, unsigned i) {
  return {
      {RTCRayN_org_x(rays, count, i), RTCRayN_org_y(rays, count, i), RTCRayN_org_z(rays, count, i)},
      {RTCRayN_dir_x(rays, count, i), RTCRayN_dir_y(rays, count, i), RTCRayN_dir_z(rays, count, i)},
      RTCRayN_tfar(rays, count, i)};
}

void intersect(const RTCIntersectFunctionNArguments* arguments) {
  const unsigned count = arguments->N;
  RTCRayN* rays = RTCRayHitN_RayN(arguments->rayhit, count);
  RTCHitN* hits = RTCRayHitN_HitN(arguments->rayhit, count);
  const Shape shape = shape_of(arguments->geometryUserPtr);
  for (unsigned i = 0; i < count; ++i) {
    kernels::ShapeHit hit;
    if (!arguments->valid[i] || !kernels::meet_shape(shape, ray_of(rays, count, i), hit)) continue;
    RTCRayN_tfar(rays, count, i) = hit.t;
    RTCHitN_u(hits, count, i) = hit.place.x;
    RTCHitN_v(hits, count, i) = hit.place.y;
    RTCHitN_primID(hits, count, i) = arguments->primID;
    RTCHitN_geomID(hits, count, i) = arguments->geomID;
    RTCHitN_instID(hits, count, i, 0) = arguments->context->instID[0];
  }
}

void occluded(const RTCOccludedFunctionNArguments* arguments) {
  const unsigned count = arguments->N;
  const Shape shape = shape_of(arguments->geometryUserPtr);
  for (unsigned i = 0; i < count; ++i) {
    kernels::ShapeHit hit;
    if (!arguments->valid[i]) continue;
    if (kernels::meet_shape(shape, ray_of(arguments->ray, count, i), hit))
      RTCRayN_tfar(arguments->ray, count, i) = -INFINITY;
  }
}

}  // namespace

GeometryHandle shape_geometry(Shape shape, RTCDevice device) {
  GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER));
  rtcSetGeometryUserPrimitiveCount(geometry.get(), 1);
  rtcSetGeometryUserData(geometry.get(), const_cast<Shape*>(&kShapes[int(shape)]));
  rtcSetGeometryBoundsFunction(geometry.get(), bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry.get(), intersect);
  rtcSetGeometryOccludedFunction(geometry.get(), occluded);
  rtcSetGeometryMask(geometry.get(), ~0u);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

}  // namespace heliograph::embree
