// Spatial queries of a scene, in packed columns.
#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "heliograph/scene.h"
#include "wire/arrays.h"
#include "wire/draft.h"
#include "wire/session.h"

namespace heliograph::client {
namespace {

constexpr std::size_t kRows = 65536;      // of a message: 768 KiB of origins, as many of directions
constexpr std::size_t kTracksTimes = 64;  // of a message

/// Arrays that differ in the length of one axis, one after another along it.
Array join(const std::vector<const Array*>& parts, std::size_t axis) {
  Shape shape = parts.front()->shape();
  std::size_t outer = 1;
  for (std::size_t i = 0; i < axis; ++i) outer *= shape[i];
  shape[axis] = 0;
  for (const Array* part : parts) shape[axis] += part->shape()[axis];
  Array out = wire::empty_array(parts.front()->dtype(), shape);
  std::byte* to = wire::writable(out);
  for (std::size_t i = 0; i < outer; ++i)
    for (const Array* part : parts) {
      const std::size_t bytes = outer == 0 ? 0 : part->bytes() / outer;
      std::memcpy(to, part->data() + i * bytes, bytes);
      to += bytes;
    }
  return out;
}

Columns join(const std::vector<Columns>& replies, std::size_t axis) {
  if (replies.size() == 1) return replies.front();
  std::vector<Columns::Column> out;
  for (const std::string& name : replies.front().names()) {
    std::vector<const Array*> parts;
    for (const Columns& reply : replies) parts.push_back(&reply[name]);
    out.push_back({name, join(parts, axis)});
  }
  return Columns(std::move(out));
}

/// Rows of an answer, which come in pieces; each request after the first names its revision.
template <class Request, class Reply>
Columns ask(const wire::SceneCore& scene,
            std::unique_ptr<grpc::ClientReader<Reply>> (wire::Session::Stub::*method)(
                grpc::ClientContext*, const Request&),
            Request& request) {
  request.set_scene(scene.id);
  const std::vector<Reply> replies = scene.session->call(method, request);
  if (replies.empty())
    throw ClientError(Code::kInternal, "the daemon gave no answer; client and daemon do not fit");
  request.set_revision(replies.front().revision());
  std::vector<Columns> pieces;
  for (const Reply& reply : replies) pieces.push_back(wire::columns_of(reply.columns()));
  return join(pieces, 0);
}

Columns ask(const wire::SceneCore& scene, v1::QueryRequest& request) {
  return ask(scene, &wire::Session::Stub::Query, request);
}

void put_refs(const std::vector<Ref>& refs, const std::string& field,
              google::protobuf::RepeatedPtrField<v1::Ref>* out) {
  for (const Ref& ref : refs) wire::put_ref(ref, nullptr, field, out->Add());
}

/// Columns of an array's rows, a message at a time.
template <class Fill>
Columns in_pieces(const wire::SceneCore& scene, std::size_t rows, const Fill& fill) {
  v1::QueryRequest request;
  std::vector<Columns> replies;
  std::size_t first = 0;
  do {
    const std::size_t last = std::min(rows, first + kRows);
    fill(request, first, last);
    replies.push_back(ask(scene, request));
    first = last;
  } while (first < rows);
  return join(replies, 0);
}

}  // namespace

Columns Scene::cast_rays(const Array& origins, const Array& directions, double t_max,
                         bool any_hit) const {
  wire::check_rows(origins, {3}, "origins");
  wire::check_rows(directions, {3}, "directions");
  const std::size_t count = origins.shape()[0];
  if (directions.shape()[0] != count)
    throw ClientError(Code::kInvalidArgument, "directions: give as many as origins",
                      {"directions"});
  return in_pieces(*core_, count, [&](v1::QueryRequest& request, std::size_t from, std::size_t to) {
    v1::CastRays* rays = request.mutable_cast_rays();
    const Array starts = wire::as_f32(wire::rows_of(origins, from, to), "origins");
    const Array ways = wire::as_f32(wire::rows_of(directions, from, to), "directions");
    wire::put_inline(starts, rays->mutable_origins());
    wire::put_inline(ways, rays->mutable_directions());
    rays->set_t_max(float(t_max));
    rays->set_any_hit(any_hit);
  });
}

Columns Scene::pick(const Ref& camera, const Array& pixels) const {
  wire::check_rows(pixels, {2}, "pixels");
  return in_pieces(*core_, pixels.shape()[0],
                   [&](v1::QueryRequest& request, std::size_t from, std::size_t to) {
                     v1::Pick* pick = request.mutable_pick();
                     wire::put_ref(camera, nullptr, "camera", pick->mutable_camera());
                     wire::put_inline(wire::as_f32(wire::rows_of(pixels, from, to), "pixels"),
                                      pick->mutable_pixels());
                   });
}

Columns Scene::visible(const Ref& camera, const std::vector<Ref>& entities) const {
  v1::QueryRequest request;
  v1::Visible* visible = request.mutable_visible();
  wire::put_ref(camera, nullptr, "camera", visible->mutable_camera());
  put_refs(entities, "entities", visible->mutable_entities());
  return ask(*core_, request);
}

Array Scene::overlaps(const std::vector<Ref>& a, const std::vector<Ref>& b) const {
  v1::QueryRequest request;
  put_refs(a, "a", request.mutable_overlaps()->mutable_a());
  put_refs(b, "b", request.mutable_overlaps()->mutable_b());
  return ask(*core_, request)["overlaps"];
}

Columns Scene::sample_surface(const std::vector<Ref>& entities, std::uint32_t count,
                              std::uint64_t seed) const {
  v1::QueryRequest request;
  v1::SampleSurface* sample = request.mutable_sample_surface();
  put_refs(entities, "entities", sample->mutable_entities());
  sample->set_count(count);
  sample->set_seed(seed);
  return ask(*core_, request);
}

Columns Scene::tracks(const Ref& camera, const SurfacePoints& points,
                      const std::vector<double>& times, bool through_transmission) const {
  const bool by_vertex = !points.vertices.empty();
  const Array& first = by_vertex ? points.vertices : points.primitive;
  const std::size_t count = first.shape()[0];
  const std::size_t across = kRows / std::min(kTracksTimes, std::max<std::size_t>(1, times.size()));
  v1::TracksRequest request;
  request.set_through_transmission(through_transmission);
  wire::put_ref(camera, nullptr, "camera", request.mutable_camera());
  put_refs(points.entities, "points.entities", request.mutable_entities());
  std::vector<Columns> rows;
  std::size_t from = 0;
  do {
    const std::size_t to = std::min(count, from + across);
    const auto put = [&](const Array& array, v1::Array* out) {
      wire::put_inline(wire::rows_of(array, from, to), out);
    };
    if (by_vertex) put(points.vertices, request.mutable_vertices());
    if (!points.entity.empty()) put(points.entity, request.mutable_entity());
    if (!by_vertex) {
      put(points.primitive, request.mutable_primitive());
      put(points.barycentric, request.mutable_barycentric());
    }
    std::vector<Columns> replies;
    for (std::size_t t = 0; t == 0 || t < times.size(); t += kTracksTimes) {
      const std::size_t end = std::min(times.size(), t + kTracksTimes);
      wire::put_inline(wire::rows_of(Array(times), t, end), request.mutable_times());
      replies.push_back(ask(*core_, &wire::Session::Stub::Tracks, request));
    }
    rows.push_back(join(replies, 1));
    from = to;
  } while (from < count);
  return join(rows, 0);
}

}  // namespace heliograph::client
