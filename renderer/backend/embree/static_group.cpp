// Many meshes to one scene of triangles.
#include "renderer/backend/embree/static_group.h"

#include "renderer/backend/embree/commit.h"
#include "renderer/backend/embree/traced_scene.h"
#include "renderer/base/parallel.h"

namespace heliograph::embree {
namespace {

GeometryHandle world_triangles(const StaticMember& member, RTCDevice device) {
  const DeviceMesh& mesh = *member.mesh;
  const u32 count = mesh.topology->vertex_count;
  GeometryHandle geometry(rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE));
  auto* vertices = static_cast<vec3*>(rtcSetNewGeometryBuffer(
      geometry.get(), RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, sizeof(vec3), count));
  if (!vertices) return geometry;
  for (u32 i = 0; i < count; ++i) vertices[i] = member.world * vec4(mesh.positions[i], 1);
  rtcSetSharedGeometryBuffer(geometry.get(), RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.topology->triangles.data(), 0, sizeof(uvec3),
                             mesh.topology->triangles.size());
  rtcSetGeometryMask(geometry.get(), member.visibility);
  rtcCommitGeometry(geometry.get());
  return geometry;
}

Status build(StaticGroup& group, RTCDevice device, const Interrupt& interrupt) {
  std::vector<GeometryHandle> geometries(group.members.size());
  parallel_for(geometries.size(),
               [&](std::size_t i) { geometries[i] = world_triangles(group.members[i], device); });
  group.scene = new_scene(device);
  for (u32 i = 0; i < geometries.size(); ++i)
    rtcAttachGeometryByID(group.scene.get(), geometries[i].get(), i);
  return commit(group.scene.get(), device, interrupt);
}

}  // namespace

u64 StaticGroup::bytes() const {
  constexpr u64 kBytesPerTriangle = 100;  // with its share of nodes and vertices
  u64 triangles = 0;
  for (const StaticMember& member : members) triangles += member.mesh->topology->triangles.size();
  return triangles * kBytesPerTriangle;
}

Expected<std::shared_ptr<const StaticGroup>> make_static_group(
    std::vector<StaticMember> members, const std::shared_ptr<const StaticGroup>& before,
    RTCDevice device, const Interrupt& interrupt) {
  if (members.empty()) return nullptr;
  auto group = std::make_shared<StaticGroup>();
  group->members = std::move(members);
  for (const StaticMember& member : group->members) group->slots.push_back(member.slot);
  const bool is_kept = before && same_members(before->members, group->members);
  if (is_kept && before->slots == group->slots) return before;
  if (is_kept)
    group->scene = before->scene;
  else
    HELIO_TRY(build(*group, device, interrupt));
  group->instance.instances = {{mat4x3(1), group->scene.get(), kStaticGroup, ~0u}};
  group->instance.boxes = {bounds_of(group->scene.get())};
  make_geometry(group->instance, device);
  return group;
}

}  // namespace heliograph::embree
