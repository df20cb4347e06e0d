// Instances that stand still as a geometry of our own: Embree's boxes about its instances are those
// about turned boxes, and twice as many are entered for nothing. Called by top_level.cpp.
#pragma once

#include <span>
#include <vector>

#include "renderer/backend/embree/embree.h"

namespace heliograph::embree {

/// What a ray needs to enter an instance: a line of the cache.
struct alignas(64) PlacedScene {
  mat4x3 object_from_world;
  RTCScene scene;
  u32 number;      // RTCHit::instID of what is met there
  u32 visibility;  // ray mask bits
};
static_assert(sizeof(PlacedScene) == 64);

struct InstanceGeometry {
  std::vector<PlacedScene> instances;
  std::vector<Box> boxes;  // where rays look for them; empty: nowhere
  GeometryHandle geometry;
};

/// Sets the geometry, committed, which reads the rest. Lifetime: of `instances`.
void make_geometry(InstanceGeometry& instances, RTCDevice device);

}  // namespace heliograph::embree
