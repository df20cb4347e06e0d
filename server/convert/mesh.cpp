// Meshes: vertices over time. The topology is in mesh_topology.cpp.
#include <fmt/format.h>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr u64 kLargestCount = 0xfffffffeu;  // vertices: 2^32 - 2

/// True if a message has what rays meet: triangles or curves.
bool has_primitives(const v1::Mesh& m) { return m.has_indices() || m.has_curves(); }

bool has_topology(const v1::Mesh& m) {
  return has_primitives(m) || m.has_radii() || m.has_uvs() || m.has_uvs1() || m.has_colors() ||
         m.has_tangents() || m.has_parts() || m.part_names_size() > 0 || m.has_joints() ||
         m.has_weights() || m.has_morph_positions() || m.has_morph_normals() ||
         m.keypoints_size() > 0 || m.has_skeleton() || m.symmetries_size() > 0;
}

/// Checks that a mesh of curves has what they need, and nothing that triangles alone have.
Status check_curves(const v1::Mesh& m) {
  if (!m.has_radii())
    return fail(Code::kInvalidArgument, "radii", "is missing; curves need a radius for each point");
  const std::pair<bool, const char*> of_triangles[] = {{m.has_indices(), "indices"},
                                                       {m.has_normals(), "normals"},
                                                       {m.has_tangents(), "tangents"},
                                                       {m.has_morph_normals(), "morph_normals"}};
  for (const auto& [has, field] : of_triangles)
    if (has)
      return fail(Code::kInvalidArgument, field,
                  "is of triangles, curves have their own; leave it out, or use two meshes");
  return {};
}

/// Checks that fields that belong together are sent together: topology with vertices, normals and
/// times with positions.
Status check_complete(const v1::Mesh& message) {
  if (message.clear_size() > 0)
    return fail(Code::kInvalidArgument, "clear[0]",
                "a mesh has no field that can be cleared; send its topology or its vertices again "
                "without it");
  if (has_topology(message) && !has_primitives(message))
    return fail(Code::kInvalidArgument, message.has_radii() ? "curves" : "indices",
                "is missing; a topology is replaced whole: send indices and positions with it, or "
                "curves, radii and positions");
  if (message.has_curves()) HELIO_TRY(check_curves(message));
  if (message.has_positions()) return {};
  if (has_primitives(message) || message.has_normals() || message.has_times())
    return fail(Code::kInvalidArgument, "positions",
                "is missing; indices, curves, normals and times are sent together with the "
                "positions");
  return {};
}

/// Returns the vertices per key, by the shape of the positions: (V, 3) or (K, V, 3).
Expected<u32> vertex_count(const v1::Array& positions) {
  const int rank = positions.shape_size();
  const u64 count = rank == 2 || rank == 3 ? positions.shape(rank - 2) : 0;
  if (count >= 1 && count <= kLargestCount) return u32(count);
  return fail(Code::kInvalidArgument, "positions.shape",
              fmt::format("is {}; send (V, 3), or (K, V, 3) with times, V from 1 to {}",
                          shape_text(positions), kLargestCount));
}

Expected<VertexKeys> to_vertices(const v1::Mesh& message, u32 count, ArraySource& source) {
  VertexKeys keys;
  Dims dims{{"V", count}, kThree};
  if (message.has_times()) {
    HELIO_TAKE(keys.times, read_times(message.times(), source), "times");
    dims.insert(dims.begin(), Dim{"K", keys.times.size()});
  } else if (message.positions().shape_size() == 3) {
    return fail(Code::kInvalidArgument, "times", "is missing; positions (K, V, 3) need K times");
  }
  HELIO_TAKE(keys.positions, read_floats<vec3>(message.positions(), source, dims), "positions");
  if (message.has_normals())
    HELIO_TAKE(keys.normals, read_floats<vec3>(message.normals(), source, dims), "normals");
  if (keys.times.size() < 2) keys.times = {0};
  return keys;
}

void add_vertices(const VertexKeys& keys, const ArraySink& sink, v1::Mesh& message) {
  const u64 count = keys.times.size();
  std::vector<u64> shape{keys.positions.size() / count, 3};
  if (count > 1) {
    shape.insert(shape.begin(), count);
    *message.mutable_times() = to_array(keys.times, std::span(&count, 1), sink);
  }
  *message.mutable_positions() = to_array(keys.positions.buffer(), v1::D_TYPE_F32, shape, sink);
  if (!keys.normals.empty())
    *message.mutable_normals() = to_array(keys.normals.buffer(), v1::D_TYPE_F32, shape, sink);
}

}  // namespace

Expected<PutMesh> to_mesh(const v1::Mesh& message, ArraySource& source) {
  HELIO_TRY(check_complete(message));
  PutMesh patch;
  if (!message.has_positions()) return patch;
  auto count = vertex_count(message.positions());
  if (!count) return std::unexpected(std::move(count).error());
  auto vertices = to_vertices(message, *count, source);
  if (!vertices) return std::unexpected(std::move(vertices).error());
  patch.vertices = std::make_shared<const VertexKeys>(std::move(*vertices));
  if (!has_primitives(message)) return patch;
  auto topology = to_topology(message, *count, source);
  if (!topology) return std::unexpected(std::move(topology).error());
  patch.topology = std::make_shared<const MeshTopology>(std::move(*topology));
  return patch;
}

v1::Mesh to_proto(const PutMesh& patch, const ArraySink& sink) {
  v1::Mesh message;
  if (patch.vertices) add_vertices(*patch.vertices, sink, message);
  if (patch.topology) add_topology(*patch.topology, sink, message);
  return message;
}

}  // namespace heliograph::server
