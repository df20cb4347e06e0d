#include "renderer/backend/embree/mesh.h"

#include <cstring>

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/primitive_geometry.h"

namespace heliograph::embree {
namespace {

constexpr u64 kBytesPerTriangle = 96;  // measured with Embree's memory monitor

/// Embree reads 16 bytes for each vertex: 4 past the end of the last one, which is harmless unless
/// a page ends there.
bool readable_past_end(const vec3* end) { return reinterpret_cast<std::uintptr_t>(end) % 4096; }

void set_vertices(RTCGeometry geometry, u32 step, const vec3* positions, u32 count) {
  if (readable_past_end(positions + count)) {
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, step, RTC_FORMAT_FLOAT3, positions,
                               0, sizeof(vec3), count);
    return;
  }
  void* copy = rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, step, RTC_FORMAT_FLOAT3,
                                       sizeof(vec3), count);
  if (copy) std::memcpy(copy, positions, count * sizeof(vec3));
}

GeometryHandle triangle_geometry(const DeviceMesh& mesh, RTCDevice device) {
  const ArrayOf<uvec3>& triangles = mesh.topology->triangles;
  GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  const u32 count = mesh.topology->vertex_count;
  rtcSetGeometryTimeStepCount(geometry.get(), mesh.segments + 1);
  for (u32 step = 0; step <= mesh.segments; ++step)
    set_vertices(geometry.get(), step, mesh.positions.data() + u64(step) * count, count);
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             triangles.data(), 0, sizeof(uvec3), triangles.size());
  rtcSetGeometryMask(geometry.get(), ~0u);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

}  // namespace

Expected<std::shared_ptr<const EmbreeMesh>> build_mesh(const DeviceMesh& mesh, RTCDevice device,
                                                       const Interrupt& interrupt) {
  auto made = std::make_shared<EmbreeMesh>(mesh);
  made->scene = new_scene(device);
  const GeometryHandle geometry = mesh.shape() == kernels::Shape::kTriangles
                                      ? triangle_geometry(mesh, device)
                                      : primitive_geometry(made->view, device);
  rtcAttachGeometryByID(made->scene.get(), geometry.get(), 0);
  HELIO_TRY(commit(made->scene.get(), device, interrupt));
  if (mesh.shape() == kernels::Shape::kTriangles) made->support = Support(mesh.positions.span());
  made->bytes_ = sizeof(EmbreeMesh) +
                 mesh.topology->triangles.size() * kBytesPerTriangle * (mesh.segments > 0 ? 2 : 1);
  return made;
}

}  // namespace heliograph::embree
