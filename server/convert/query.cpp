// Checks a QueryRequest, one function per query.
#include "server/convert/query.h"

#include <fmt/format.h>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/frame.h"
#include "server/convert/resolve.h"

namespace heliograph::server {
namespace {

/// Context that every query is read with.
struct Reader {
  const Snapshot& snapshot;
  ArraySource& source;
  const QueryLimits& limits;
};

Status check_count(u64 count, const QueryLimits& limits) {
  if (count <= limits.items) return {};
  auto error =
      fail(Code::kResourceExhausted, "",
           fmt::format("asks for {} at once, {} are allowed; ask in parts", count, limits.items));
  error.error().limit = "query_items";
  error.error().needed = count;
  error.error().available = limits.items;
  return error;
}

template <class T>
Expected<std::vector<T>> read_vectors(const Reader& in, const v1::Array& array, const Dims& dims) {
  if (array.shape_size() > 0) HELIO_TRY(check_count(array.shape(0), in.limits));
  auto values = read_floats<T>(array, in.source, dims);
  if (!values) return std::unexpected(std::move(values).error());
  return std::vector<T>(values->begin(), values->end());
}

Expected<CastRays> to_cast_rays(const v1::CastRays& message, const Reader& in) {
  CastRays query{.any_hit = message.any_hit()};
  HELIO_TAKE(query.origins, read_vectors<vec3>(in, message.origins(), {{"N", {}}, kThree}),
             "origins");
  const Dims dims{{"N", query.origins.size()}, kThree};
  HELIO_TAKE(query.directions, read_vectors<vec3>(in, message.directions(), dims), "directions");
  for (std::size_t i = 0; i < query.directions.size(); ++i)
    if (const float square = glm::dot(query.directions[i], query.directions[i]);
        !(square > 0) || !std::isfinite(square))
      return fail(Code::kInvalidArgument, indexed("directions", i),
                  "has no usable length; give a direction longer than 1e-19 and shorter than 1e19");
  HELIO_TAKE(query.t_max, in_range(message.t_max(), kNotNegative), "t_max");
  return query;
}

Expected<Pick> to_pick(const v1::Pick& message, const Reader& in) {
  Pick query;
  HELIO_TAKE(query.camera, resolve_camera(message.camera(), in.snapshot), "camera");
  HELIO_TAKE(query.pixels, read_vectors<vec2>(in, message.pixels(), {{"N", {}}, kTwo}), "pixels");
  return query;
}

/// Reads a list of at least one entity.
Expected<std::vector<EntityId>> read_entities(
    const google::protobuf::RepeatedPtrField<v1::Ref>& refs, const Reader& in) {
  if (refs.empty()) return fail(Code::kInvalidArgument, "", "is empty; name at least one entity");
  return resolve_entities(refs, in.snapshot);
}

Expected<Visible> to_visible(const v1::Visible& message, const Reader& in) {
  Visible query;
  HELIO_TAKE(query.camera, resolve_camera(message.camera(), in.snapshot), "camera");
  HELIO_TAKE(query.entities, read_entities(message.entities(), in), "entities");
  return query;
}

Expected<Overlaps> to_overlaps(const v1::Overlaps& message, const Reader& in) {
  Overlaps query;
  HELIO_TAKE(query.a, read_entities(message.a(), in), "a");
  HELIO_TAKE(query.b, read_entities(message.b(), in), "b");
  HELIO_CHECK(check_count(query.a.size() * query.b.size(), in.limits), "b");
  return query;
}

Expected<SampleSurface> to_sample_surface(const v1::SampleSurface& message, const Reader& in) {
  SampleSurface query{.count = message.count(), .seed = message.seed()};
  HELIO_TAKE(query.entities, read_entities(message.entities(), in), "entities");
  if (query.count == 0)
    return fail(Code::kInvalidArgument, "count", "is 0; ask for at least one point");
  HELIO_CHECK(check_count(query.count, in.limits), "count");
  return query;
}

}  // namespace

Expected<QueryJob> to_query(const v1::QueryRequest& request,
                            std::shared_ptr<const Snapshot> snapshot, ArraySource& source,
                            const QueryLimits& limits) {
  HELIO_TRY(check_known(request));
  QueryJob job{.snapshot = std::move(snapshot)};
  job.time = job.snapshot->time;
  if (request.has_time()) HELIO_TAKE(job.time, in_range(request.time(), {-1e9, 1e9}), "time");
  const Reader in{*job.snapshot, source, limits};
  switch (request.query_case()) {
    case v1::QueryRequest::kCastRays:
      HELIO_TAKE(job.query, to_cast_rays(request.cast_rays(), in), "cast_rays");
      break;
    case v1::QueryRequest::kPick:
      HELIO_TAKE(job.query, to_pick(request.pick(), in), "pick");
      break;
    case v1::QueryRequest::kVisible:
      HELIO_TAKE(job.query, to_visible(request.visible(), in), "visible");
      break;
    case v1::QueryRequest::kOverlaps:
      HELIO_TAKE(job.query, to_overlaps(request.overlaps(), in), "overlaps");
      break;
    case v1::QueryRequest::kSampleSurface:
      HELIO_TAKE(job.query, to_sample_surface(request.sample_surface(), in), "sample_surface");
      break;
    case v1::QueryRequest::QUERY_NOT_SET:
      return fail(Code::kInvalidArgument, "query", "is not set; set one of its cases");
  }
  return job;
}

}  // namespace heliograph::server
