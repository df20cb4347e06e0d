// Embree's callbacks of instances. A geometry's user data is its InstanceGeometry.
#include "renderer/backend/embree/instance_geometry.h"

#include <algorithm>

namespace heliograph::embree {
namespace {

const InstanceGeometry& instances_of(const void* user) {
  return *static_cast<const InstanceGeometry*>(user);
}

void bounds(const RTCBoundsFunctionArguments* arguments) {
  const Box& box = instances_of(arguments->geometryUserPtr).boxes[arguments->primID];
  *arguments->bounds_o = {box.lower.x, box.lower.y, box.lower.z, 0,
                          box.upper.x, box.upper.y, box.upper.z, 0};
}

/// Origin, tnear, direction and time of a ray, or of some. Rows are written at once, as Embree
/// reads them: it would wait for smaller stores.
using Row [[gnu::vector_size(16), gnu::may_alias]] = float;
using Rows [[gnu::vector_size(32), gnu::may_alias]] = float;

/// A ray in the space of an instance, while this lives.
class InObject {
 public:
  InObject(RTCRay& ray, const mat4x3& m) : rows_(reinterpret_cast<Row*>(&ray)) {
    std::copy_n(rows_, 2, world_);
    const vec3 o = m[0] * ray.org_x + m[1] * ray.org_y + m[2] * ray.org_z + m[3];
    const vec3 d = m[0] * ray.dir_x + m[1] * ray.dir_y + m[2] * ray.dir_z;
    rows_[0] = Row{o.x, o.y, o.z, world_[0][3]};
    rows_[1] = Row{d.x, d.y, d.z, world_[1][3]};
  }
  ~InObject() { std::copy_n(world_, 2, rows_); }
  InObject(const InObject&) = delete;
  InObject& operator=(const InObject&) = delete;

 private:
  Row* rows_;
  Row world_[2];
};
/// The same of 8.
class PacketInObject {
 public:
  PacketInObject(RTCRay8& rays, const mat4x3& m) : rows_(reinterpret_cast<Rows*>(&rays)) {
    std::copy_n(rows_, 8, world_);
    const Rows *o = world_, *d = world_ + 4;
    for (int i = 0; i < 3; ++i) {
      rows_[i] = m[0][i] * o[0] + m[1][i] * o[1] + m[2][i] * o[2] + m[3][i];
      rows_[4 + i] = m[0][i] * d[0] + m[1][i] * d[1] + m[2][i] * d[2];
    }
  }
  ~PacketInObject() { std::copy_n(world_, 8, rows_); }
  PacketInObject(const PacketInObject&) = delete;
  PacketInObject& operator=(const PacketInObject&) = delete;

 private:
  Rows* rows_;
  Rows world_[8];
};

/// Rays, of 8, that an instance shows itself to.
struct Seeing {
  alignas(32) int valid[8];

  Seeing(const int* asked, const RTCRay8& rays, u32 visibility) {
    for (int i = 0; i < 8; ++i) valid[i] = (rays.mask[i] & visibility) != 0 ? asked[i] : 0;
  }
  [[nodiscard]] bool any() const {
    return std::ranges::any_of(valid, [](int lane) { return lane != 0; });
  }
};

// Traces what the callback was given, in the scene of an instance.
#if RTC_VERSION_MAJOR >= 4
void enter(const RTCIntersectFunctionNArguments* from, const PlacedScene& at, RTCRay& ray) {
  rtcForwardIntersect1(from, at.scene, &ray, at.number);
}
void enter(const RTCIntersectFunctionNArguments* from, const PlacedScene& at, RTCRay8& rays,
           const int* valid) {
  rtcForwardIntersect8(valid, from, at.scene, &rays, at.number);
}
void enter(const RTCOccludedFunctionNArguments* from, const PlacedScene& at, RTCRay& ray) {
  rtcForwardOccluded1(from, at.scene, &ray, at.number);
}
void enter(const RTCOccludedFunctionNArguments* from, const PlacedScene& at, RTCRay8& rays,
           const int* valid) {
  rtcForwardOccluded8(valid, from, at.scene, &rays, at.number);
}
#else
/// Whose hits come, while it lives.
class Numbered {
 public:
  Numbered(RTCIntersectContext* context, u32 number) : context_(context) {
    context->instID[0] = number;
  }
  ~Numbered() { context_->instID[0] = RTC_INVALID_GEOMETRY_ID; }
  Numbered(const Numbered&) = delete;
  Numbered& operator=(const Numbered&) = delete;

 private:
  RTCIntersectContext* context_;
};

void enter(const RTCIntersectFunctionNArguments* from, const PlacedScene& at, RTCRay& ray) {
  const Numbered numbered(from->context, at.number);
  rtcIntersect1(at.scene, from->context, reinterpret_cast<RTCRayHit*>(&ray));
}
void enter(const RTCIntersectFunctionNArguments* from, const PlacedScene& at, RTCRay8& rays,
           const int* valid) {
  const Numbered numbered(from->context, at.number);
  rtcIntersect8(valid, at.scene, from->context, reinterpret_cast<RTCRayHit8*>(&rays));
}
void enter(const RTCOccludedFunctionNArguments* from, const PlacedScene& at, RTCRay& ray) {
  const Numbered numbered(from->context, at.number);
  rtcOccluded1(at.scene, from->context, &ray);
}
void enter(const RTCOccludedFunctionNArguments* from, const PlacedScene& at, RTCRay8& rays,
           const int* valid) {
  const Numbered numbered(from->context, at.number);
  rtcOccluded8(valid, at.scene, from->context, &rays);
}
#endif

/// rays   what the query began with
template <class Arguments>
void enter(const Arguments* arguments, void* rays) {
  const PlacedScene& at = instances_of(arguments->geometryUserPtr).instances[arguments->primID];
  if (arguments->N == 1) {
    auto& ray = *static_cast<RTCRay*>(rays);
    if ((ray.mask & at.visibility) == 0) return;
    const InObject in_object(ray, at.object_from_world);
    enter(arguments, at, ray);
  } else {
    auto& packet = *static_cast<RTCRay8*>(rays);
    const Seeing seeing(arguments->valid, packet, at.visibility);
    if (!seeing.any()) return;
    const PacketInObject in_object(packet, at.object_from_world);
    enter(arguments, at, packet, seeing.valid);
  }
}
void intersect(const RTCIntersectFunctionNArguments* arguments) {
  enter(arguments, arguments->rayhit);
}
void occluded(const RTCOccludedFunctionNArguments* arguments) { enter(arguments, arguments->ray); }

}  // namespace

void make_geometry(InstanceGeometry& instances, RTCDevice device) {
  GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_USER));
  rtcSetGeometryUserPrimitiveCount(geometry.get(), unsigned(instances.boxes.size()));
  rtcSetGeometryUserData(geometry.get(), &instances);
  rtcSetGeometryBoundsFunction(geometry.get(), bounds, nullptr);
  rtcSetGeometryIntersectFunction(geometry.get(), intersect);
  rtcSetGeometryOccludedFunction(geometry.get(), occluded);
  rtcSetGeometryMask(geometry.get(), ~0u);
  rtcCommitGeometry(geometry.get());
  instances.geometry = std::move(geometry);
}

}  // namespace heliograph::embree
