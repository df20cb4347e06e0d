// Checks a TracksRequest: every point lies on a triangle or segment of its entity's mesh.
#include "server/convert/tracks.h"

#include <fmt/format.h>

#include <unordered_map>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/frame.h"
#include "server/convert/resolve.h"

namespace heliograph::server {
namespace {

constexpr Range kSeconds{-1e9, 1e9};
constexpr float kRounding = 1e-5f;  // tolerance of barycentric weights

struct Reader {
  const v1::TracksRequest& request;
  const Snapshot& snapshot;
  ArraySource& source;
};

std::unexpected<Error> missing(const char* field, const char* remedy) {
  return fail(Code::kInvalidArgument, field, std::string("is missing; ") + remedy);
}

Expected<const MeshTopology*> topology_of(const Snapshot& snapshot, EntityId id) {
  const Entity& entity = *snapshot.find(id);
  if (const auto* mesh = snapshot.find(entity.mesh)) return mesh->value->topology.get();
  return fail(Code::kInvalidArgument, "entities",
              fmt::format("{} shows no mesh; name an entity that does", object_text(id, snapshot)));
}

/// Returns the count by the array's shape, before any bytes are read.
u64 row_count(const v1::Array& array) { return array.shape_size() > 0 ? array.shape(0) : 0; }

Expected<std::vector<double>> read_instants(const Reader& in, const TrackLimits& limits) {
  if (!in.request.has_times()) return missing("", "give the seconds to follow the points at");
  if (const u64 count = row_count(in.request.times()); count > limits.times) {
    auto error =
        fail(Code::kResourceExhausted, "",
             fmt::format("has {} times, {} are allowed; ask in parts", count, limits.times));
    error.error().limit = "track_times";
    error.error().needed = count;
    error.error().available = limits.times;
    return error;
  }
  auto times = read_f64(in.request.times(), in.source, {{"T", {}}}, 1);
  if (!times) return times;
  if (times->empty()) return fail(Code::kInvalidArgument, "", "is empty; give at least one time");
  for (u64 i = 0; i < times->size(); ++i)
    HELIO_CHECK(in_range((*times)[i], kSeconds), fmt::format("[{}]", i));
  return times;
}

struct Place {
  u32 primitive = kernels::kNone;
  vec2 barycentric{0};
};

/// Finds, for each vertex of a mesh, the first triangle that uses it and its corner there.
std::vector<Place> vertex_places(const MeshTopology& topology) {
  static constexpr vec2 kCorners[3] = {vec2(0, 0), vec2(1, 0), vec2(0, 1)};
  std::vector<Place> places(topology.vertex_count);
  const auto triangles = topology.triangles.span();
  for (u32 t = u32(triangles.size()); t-- > 0;)
    for (int corner = 0; corner < 3; ++corner) places[triangles[t][corner]] = {t, kCorners[corner]};
  return places;
}

Status place_on_vertices(const Reader& in, std::vector<TrackPoint>& points,
                         std::span<const u32> vertices) {
  std::unordered_map<const MeshTopology*, std::vector<Place>> known;
  for (u64 i = 0; i < points.size(); ++i) {
    const auto topology = topology_of(in.snapshot, points[i].entity);
    if (!topology) return std::unexpected(topology.error());
    if (!(*topology)->curves.empty())
      return fail(Code::kInvalidArgument, "vertices",
                  fmt::format("{} shows curves, whose points lie within; give primitive and "
                              "barycentric, as a query or a plane has them",
                              object_text(points[i].entity, in.snapshot)));
    auto& places = known[*topology];
    if (places.empty()) places = vertex_places(**topology);
    if (vertices[i] >= places.size())
      return fail(Code::kInvalidArgument, indexed("vertices", i),
                  fmt::format("is {}; the mesh has {} vertices", vertices[i], places.size()));
    const Place& place = places[vertices[i]];
    if (place.primitive == kernels::kNone)
      return fail(Code::kInvalidArgument, indexed("vertices", i),
                  fmt::format("{} is a vertex of no triangle", vertices[i]));
    points[i].primitive = place.primitive;
    points[i].barycentric = place.barycentric;
  }
  return {};
}

/// The share of the way along a segment, beyond it over the spheres at its ends, and turns around.
Status check_strand_place(vec2 place) {
  if (place.x >= -1 && place.x <= 2 && place.y >= 0 && place.y <= 1) return {};
  return fail(Code::kInvalidArgument, "",
              fmt::format("({}, {}) is no place of a curve's segment; give its share of the way in "
                          "[-1, 2] and turns around it in [0, 1]",
                          place.x, place.y));
}

Status place_on_triangles(const Reader& in, std::vector<TrackPoint>& points,
                          std::span<const u32> primitives, std::span<const vec2> weights) {
  for (u64 i = 0; i < points.size(); ++i) {
    const auto topology = topology_of(in.snapshot, points[i].entity);
    if (!topology) return std::unexpected(topology.error());
    const bool has_curves = !(*topology)->curves.empty();
    if (primitives[i] >= (*topology)->triangles.size())
      return fail(
          Code::kInvalidArgument, indexed("primitive", i),
          fmt::format("is {}; the mesh has {} {}", primitives[i], (*topology)->triangles.size(),
                      has_curves ? "segments" : "triangles"));
    const vec2 w = weights[i];
    if (has_curves) {
      HELIO_CHECK(check_strand_place(w), indexed("barycentric", i));
      points[i].primitive = primitives[i];
      points[i].barycentric = w;
      continue;
    }
    if (w.x < -kRounding || w.y < -kRounding || w.x + w.y > 1 + kRounding)
      return fail(Code::kInvalidArgument, indexed("barycentric", i),
                  fmt::format("({}, {}) lies outside the triangle; give weights of its vertices 1 "
                              "and 2 that are at least 0 and sum to at most 1",
                              w.x, w.y));
    points[i].primitive = primitives[i];
    points[i].barycentric = w;
  }
  return {};
}

/// Reads the entity of each of the `count` points.
Expected<std::vector<TrackPoint>> read_entities(const Reader& in, u64 count) {
  if (in.request.entities().empty())
    return fail(Code::kInvalidArgument, "entities", "is empty; name at least one entity");
  std::vector<EntityId> entities;
  HELIO_TAKE(entities, resolve_entities(in.request.entities(), in.snapshot), "entities");
  std::vector<TrackPoint> points(count, TrackPoint{.entity = entities[0]});
  if (!in.request.has_entity()) return points;
  ArrayOf<u32> index;
  HELIO_TAKE(index,
             (read_integers<u32>(in.request.entity(), in.source, {{"N", count}}, v1::D_TYPE_U32)),
             "entity");
  HELIO_CHECK(check_below(index.span(), u32(entities.size()), 1, "entities"), "entity");
  for (u64 i = 0; i < count; ++i) points[i].entity = entities[index.span()[i]];
  return points;
}

Expected<std::vector<TrackPoint>> read_points(const Reader& in) {
  const v1::TracksRequest& request = in.request;
  const bool by_vertex = request.has_vertices();
  if (by_vertex && (request.has_primitive() || request.has_barycentric()))
    return fail(Code::kInvalidArgument, "vertices",
                "excludes primitive and barycentric; give one or the other");
  if (!by_vertex && !request.has_primitive())
    return missing("primitive", "give triangles with barycentric, or vertices");
  ArrayOf<u32> number;
  HELIO_TAKE(number,
             (read_integers<u32>(by_vertex ? request.vertices() : request.primitive(), in.source,
                                 {{"N", {}}}, v1::D_TYPE_U32)),
             by_vertex ? "vertices" : "primitive");
  auto points = read_entities(in, number.size());
  if (!points) return points;
  if (by_vertex) {
    HELIO_TRY(place_on_vertices(in, *points, number.span()));
    return points;
  }
  if (!request.has_barycentric())
    return missing("barycentric", "give the weights of vertices 1 and 2");
  ArrayOf<vec2> weights;
  HELIO_TAKE(weights,
             read_floats<vec2>(request.barycentric(), in.source, {{"N", number.size()}, kTwo}),
             "barycentric");
  HELIO_TRY(place_on_triangles(in, *points, number.span(), weights.span()));
  return points;
}

}  // namespace

Expected<QueryJob> to_tracks(const v1::TracksRequest& request,
                             std::shared_ptr<const Snapshot> snapshot, ArraySource& source,
                             const TrackLimits& limits) {
  HELIO_TRY(check_known(request));
  QueryJob job{.snapshot = std::move(snapshot)};
  job.time = job.snapshot->time;
  const Reader in{request, *job.snapshot, source};
  Tracks tracks{.through_transmission = request.through_transmission()};
  HELIO_TAKE(tracks.camera, resolve_camera(request.camera(), *job.snapshot), "camera");
  HELIO_TAKE(tracks.times, read_instants(in, limits), "times");
  const u64 count = row_count(request.has_vertices() ? request.vertices() : request.primitive());
  if (count > limits.items / tracks.times.size()) {
    auto error = fail(Code::kResourceExhausted, "times",
                      fmt::format("{} points at {} times, {} in all are allowed; ask in parts",
                                  count, tracks.times.size(), limits.items));
    error.error().limit = "query_items";
    error.error().needed =
        count > ~u64{0} / tracks.times.size() ? ~u64{0} : count * tracks.times.size();
    error.error().available = limits.items;
    return error;
  }
  auto points = read_points(in);
  if (!points) return std::unexpected(std::move(points).error());
  tracks.points = *std::move(points);
  job.query = std::move(tracks);
  return job;
}

}  // namespace heliograph::server
