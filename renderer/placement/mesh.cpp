#include "renderer/placement/mesh.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <vector>

#include "kernels/geometry/shape.h"
#include "renderer/base/parallel.h"
#include "renderer/scene/light_shapes.h"
#include "renderer/scene/strands.h"

namespace heliograph::resident {
namespace {

u64 hash_piece(std::span<const std::byte> bytes) {
  constexpr std::size_t kLanes = 4;  // that do not wait for each other
  constexpr u64 kPrime = 0x9e3779b97f4a7c15ull;
  std::array<u64, kLanes> lanes{1, 2, 3, 4};
  std::array<u64, kLanes> words{};
  const auto mix = [&] {
    for (std::size_t k = 0; k < kLanes; ++k)
      lanes[k] = std::rotl((lanes[k] ^ words[k]) * kPrime, 29);
  };
  std::size_t i = 0;
  for (; i + sizeof words <= bytes.size(); i += sizeof words) {
    std::memcpy(&words, bytes.data() + i, sizeof words);
    mix();
  }
  words = {};
  if (i < bytes.size()) std::memcpy(&words, bytes.data() + i, bytes.size() - i);
  mix();
  u64 hash = bytes.size();
  for (const u64 lane : lanes) hash = (std::rotl(hash, 31) ^ lane) * kPrime;
  return hash ^ hash >> 32;
}

/// Names deformed vertices, which have no serial of their own.
u64 hash_words(std::span<const std::byte> bytes) {
  constexpr std::size_t kPiece = 64 << 10;
  std::vector<u64> pieces((bytes.size() + kPiece - 1) / kPiece);
  parallel_for(pieces.size(), [&](std::size_t i) {
    pieces[i] = hash_piece(bytes.subspan(i * kPiece, std::min(kPiece, bytes.size() - i * kPiece)));
  });
  return hash_piece(std::as_bytes(std::span(pieces)));
}

/// Key of the structure over a mesh. Places on strands depend on where they were at rest.
DerivedKey accelerator_key(const MeshTopology& topology, const VertexKeys& rest,
                           const ArrayOf<vec3>& positions) {
  return {Derived::kAccelerator,
          {positions.serial(), topology.triangles.serial(), topology.vertex_count,
           topology.curves.empty() ? 0 : rest.positions.serial()}};
}

kernels::Shape shape_of(const MeshTopology& topology) {
  if (!topology.curves.empty()) return kernels::Shape::kCurves;
  return primitive_of(topology.shape);
}

/// Bounds of a shape under a linear map, as an ellipsoid or a flat one.
Box shape_bounds(kernels::Shape shape, mat3 map) {
  const vec3 reach = kernels::shape_reach(shape);
  for (int i = 0; i < 3; ++i) map[i] *= reach[i];
  const vec3 half = sphere_reach(map);
  return {-half, half};
}

/// Bounds of some triangles, or segments of strands, under a linear map.
Box bounds_under(const DeviceMesh& mesh, std::span<const uvec3> primitives, const mat3& map) {
  const vec3* rest = mesh.vertices->positions.data();
  const ArrayOf<float>& radii = mesh.topology->radii;
  const vec3 reach = sphere_reach(map);
  Box box;
  for (const uvec3 t : primitives)
    for (const u32 v : {t.x, t.y, t.z}) {
      const vec3 p = map * rest[v], half = radii.empty() ? vec3(0) : reach * radii[v];
      box.extend(p - half);
      box.extend(p + half);
    }
  return box;
}

}  // namespace

kernels::MeshView DeviceMesh::view() const {
  kernels::MeshView view{};
  view.triangles = topology->triangles.data();
  view.positions = positions.data();
  view.normals = normals.data();
  view.rest_positions = vertices->positions.data();
  view.uvs_around = strands && topology->uvs.empty();
  view.uvs = view.uvs_around ? strands->uvs.data() : topology->uvs.data();
  view.uvs1 = topology->uvs1.data();
  view.colors = topology->colors.data();
  // Tangents are those at rest: on a mesh that deforms each triangle's own follow it.
  const bool rests = positions.buffer() == vertices->positions.buffer();
  view.tangents = rests ? topology->tangents.data() : nullptr;
  view.parts = topology->parts.data();
  if (strands) view.strand_points = strands->points.data();
  view.triangle_count = u32(topology->triangles.size());
  view.vertex_count = topology->vertex_count;
  view.part_count = topology->part_count;
  view.segments = segments;
  view.shape = shape();
  return view;
}

kernels::Shape DeviceMesh::shape() const { return shape_of(*topology); }

Expected<std::shared_ptr<DeviceMesh>> MeshBuilder::finish(std::shared_ptr<DeviceMesh> mesh,
                                                          const Interrupt& interrupt) const {
  const ArrayOf<uvec3>& triangles = mesh->topology->triangles;
  const ArrayOf<vec3>& positions = mesh->positions;
  mesh->strands = strands_of(*mesh->topology, *mesh->vertices, cache_);
  const DerivedKey key = accelerator_key(*mesh->topology, *mesh->vertices, positions);
  auto made = cache_.try_get<MeshAccelerator>(key, {positions.buffer(), triangles.buffer()},
                                              [&] { return accelerator_.build(*mesh, interrupt); });
  if (!made) return std::unexpected(std::move(made).error());
  mesh->accelerator = *std::move(made);
  mesh->rest = rest_bounds(*mesh, mat3(1));
  return mesh;
}

Expected<std::shared_ptr<DeviceMesh>> MeshBuilder::build(const Mesh& mesh,
                                                         const Interrupt& interrupt) const {
  auto made = std::make_shared<DeviceMesh>();
  made->topology = mesh.topology;
  made->vertices = mesh.vertices;
  made->positions = mesh.vertices->positions;
  made->normals = mesh.vertices->normals;
  made->reshaped = mesh.reshaped;
  return finish(std::move(made), interrupt);
}

Expected<std::shared_ptr<DeviceMesh>> MeshBuilder::build(const Mesh& mesh,
                                                         DeformedKeys deformed) const {
  struct Vertices {
    ArrayOf<vec3> positions, normals;
    [[nodiscard]] u64 bytes() const { return (positions.size() + normals.size()) * sizeof(vec3); }
  };
  auto& [positions, normals] = deformed.vertices;
  const u64 hash = hash_words(std::as_bytes(std::span(positions)));
  const u64 normals_hash = hash_words(std::as_bytes(std::span(normals)));
  const DerivedKey key{Derived::kVertices, {hash, normals_hash, mesh.topology->triangles.serial()}};
  const auto kept = cache_.get<Vertices>(key, {}, [&] {
    auto vertices = std::make_shared<Vertices>();
    vertices->positions = ArrayOf(std::move(positions));
    vertices->normals = ArrayOf(std::move(normals));
    return vertices;
  });
  auto made = std::make_shared<DeviceMesh>();
  made->topology = mesh.topology;
  made->vertices = mesh.vertices;
  made->positions = kept->positions;
  made->normals = kept->normals;
  made->segments = deformed.segments;
  return finish(std::move(made), {});
}

DerivedKey MeshBuilder::key_of(const Mesh& mesh) {
  return accelerator_key(*mesh.topology, *mesh.vertices, mesh.vertices->positions);
}

bool MeshBuilder::ready(const Mesh& mesh) const { return cache_.contains(key_of(mesh)); }

Box MeshBuilder::rest_bounds(const DeviceMesh& mesh, const mat3& map) const {
  if (kernels::is_whole(mesh.shape())) return shape_bounds(mesh.shape(), map);
  const DerivedKey key{Derived::kBounds,
                       {mesh.vertices->positions.serial(), mesh.topology->triangles.serial(),
                        map == mat3(1) ? 0 : hash_words(std::as_bytes(std::span(&map, 1)))}};
  const Sources sources{mesh.vertices->positions.buffer(), mesh.topology->triangles.buffer()};
  return *cache_.get<Box>(key, sources, [&] {
    constexpr std::size_t kPiece = 1 << 15;  // triangles
    const auto triangles = mesh.topology->triangles.span();
    std::vector<Box> boxes((triangles.size() + kPiece - 1) / kPiece);
    parallel_for(boxes.size(), [&](std::size_t i) {
      const auto piece =
          triangles.subspan(i * kPiece, std::min(kPiece, triangles.size() - i * kPiece));
      boxes[i] = bounds_under(mesh, piece, map);
    });
    auto all = std::make_shared<Box>();
    for (const Box& box : boxes) all->extend(box);
    return all;
  });
}

}  // namespace heliograph::resident
