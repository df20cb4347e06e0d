// Spatial questions about a scene: rays, picks, visibility, overlap, surface samples, tracks.
#pragma once

#include <variant>
#include <vector>

#include "renderer/frame/frame.h"

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
/// A point of a triangle of an entity's mesh.
struct TrackPoint {
  EntityId entity;
  u32 primitive = 0;
  vec2 barycentric{0};  // weights of vertices 1 and 2
};
/// Points followed over time, as a camera sees them.
struct Tracks {
  EntityId camera;
  std::vector<TrackPoint> points;
  std::vector<Time> times;
  bool through_transmission = false;
};

struct QueryJob {
  std::shared_ptr<const Snapshot> snapshot;
  Time time = 0;  // Tracks have their own
  std::variant<CastRays, Pick, Visible, Overlaps, SampleSurface, Tracks> query;
  Origin origin;
};

/// Rows of its answer, about.
[[nodiscard]] inline u64 items_of(const QueryJob& job) {
  struct Count {
    u64 operator()(const CastRays& q) const { return q.origins.size(); }
    u64 operator()(const Pick& q) const { return q.pixels.size(); }
    u64 operator()(const Visible& q) const { return q.entities.size(); }
    u64 operator()(const Overlaps& q) const { return q.a.size(); }
    u64 operator()(const SampleSurface& q) const { return q.entities.size() * q.count; }
    u64 operator()(const Tracks& q) const { return q.points.size() * q.times.size(); }
  };
  return std::visit(Count(), job.query);
}

/// Columns as service.proto names them.
using QueryResult = std::vector<Column>;

}  // namespace heliograph
