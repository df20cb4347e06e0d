// Instances that stand still, as user geometries of Embree in tight boxes (support.h). Embree's own
// instances lie in the boxes about their turned boxes, and rays enter many of them for nothing.
// Called by top_level.cpp and static_group.cpp.
#pragma once

#include <vector>

#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// Data that a ray needs to enter an instance: a line of the cache.
struct alignas(64) PlacedScene {
  mat4x3 object_from_world;
  RTCScene scene;
  u32 number;      // RTCHit::instID of what is met there
  u32 visibility;  // ray mask bits
};
static_assert(sizeof(PlacedScene) == 64);

/// Some of them.
struct InstanceGeometry {
  std::vector<PlacedScene> instances;
  std::vector<Box> boxes;  // where rays look for them; empty: nowhere
  GeometryHandle geometry;
};

/// Sets the geometry, committed. It reads the rest as long as it lives.
void make_geometry(InstanceGeometry& instances, RTCDevice device);

}  // namespace heliograph::embree
