// Spatial questions about a scene: rays, picks, visibility, overlap, surface samples.
#pragma once

#include <variant>
#include <vector>

#include "renderer/engine/frame.h"

namespace heliograph {

struct CastRays {
  std::vector<vec3> origins;
  std::vector<vec3> directions;
  float t_max = 0;  // 0: unbounded
  bool any_hit = false;
};
struct Pick {
  EntityId camera;
  std::vector<vec2> pixels;  // K coordinates
};
struct Visible {
  EntityId camera;
  std::vector<EntityId> entities;
};
struct Overlaps {
  std::vector<EntityId> a, b;
};
struct SampleSurface {
  std::vector<EntityId> entities;
  u32 count = 0;
  u64 seed = 0;
};

struct QueryJob {
  std::shared_ptr<const Snapshot> snapshot;
  Time time = 0;
  std::variant<CastRays, Pick, Visible, Overlaps, SampleSurface> query;
};

/// Columns as service.proto names them.
using QueryResult = std::vector<Column>;

}  // namespace heliograph
