// Bounds vertex by vertex, of curves sphere by sphere: exact for any pose.
#include "server/convert/bounds.h"

#include <algorithm>

#include "renderer/scene/grid.h"
#include "renderer/scene/motion.h"
#include "renderer/scene/strands.h"

namespace heliograph::server {

WorldBoxes::WorldBoxes(const Snapshot& snapshot)
    : snapshot_(snapshot),
      poses_(world_poses(snapshot, snapshot.time)),
      children_(snapshot.entities.capacity()) {
  snapshot.entities.for_each([&](u32 i, const Entity& entity) {
    if (entity.parent) children_[entity.parent.index()].push_back(i);
  });
}

void WorldBoxes::add(u32 entity, std::optional<Box>& box) const {
  const Entity& row = snapshot_.entities.at(entity);
  const auto extend = [&](const vec3& p, const vec3& reach = vec3(0)) {
    const vec3 p_world = poses_[entity] * vec4(p, 1);
    if (!box) box = Box{p_world, p_world};
    box->min = glm::min(box->min, p_world - reach);
    box->max = glm::max(box->max, p_world + reach);
  };
  if (const auto* volume = snapshot_.find(row.volume))
    for (const vec3& corner : box_corners(*volume->value->density)) extend(corner);
  const Shared<Mesh>* mesh = snapshot_.find(row.mesh);
  if (!mesh) return;
  const auto moved = deform(snapshot_, entity, snapshot_.time, poses_);
  const std::span<const vec3> positions =
      moved ? std::span<const vec3>(moved->positions) : mesh->value->vertices->positions.span();
  const auto radii = mesh->value->topology->radii.span();
  const vec3 unit = sphere_reach(mat3(poses_[entity]));
  for (std::size_t i = 0; i < positions.size(); ++i)
    extend(positions[i], radii.empty() ? vec3(0) : unit * radii[i % radii.size()]);
}

std::optional<Box> WorldBoxes::of(u32 entity) const {
  std::optional<Box> box;
  std::vector<u32> open{entity};
  while (!open.empty()) {
    const u32 next = open.back();
    open.pop_back();
    add(next, box);
    open.insert(open.end(), children_[next].begin(), children_[next].end());
  }
  return box;
}

}  // namespace heliograph::server
