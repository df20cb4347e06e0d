// A scene that is edited step by step, and short ways to write edits. For the tests of apply().
#pragma once

#include "renderer/scene/grid.h"
#include "renderer/scene/scene.h"
#include "tests/unit/catch.h"

namespace heliograph::stage {

inline Edit named(std::string name, Action action, Mode mode = Mode::kUpsert) {
  return {.mode = mode, .target = std::move(name), .action = std::move(action)};
}
inline Edit on(Id id, Action action, Mode mode = Mode::kUpsert) {
  return {.mode = mode, .target = id, .action = std::move(action)};
}
inline Edit anonymous(Action action) { return {.target = {}, .action = std::move(action)}; }

inline PutMesh triangle(std::size_t vertices = 3) {
  MeshTopology topology{.vertex_count = u32(vertices)};
  topology.triangles = ArrayOf<uvec3>(std::vector<uvec3>{{0, 1, 2}});
  VertexKeys keys{.times = {0}, .positions = ArrayOf(std::vector<vec3>(vertices)), .normals = {}};
  return {.topology = std::make_shared<const MeshTopology>(std::move(topology)),
          .vertices = std::make_shared<const VertexKeys>(std::move(keys))};
}
inline PutTexture texture() {
  const auto texels = ArrayOf<u8>(std::vector<u8>(4, 128));
  return {.image = std::make_shared<const ImageData>(
              ImageData{.texels = texels.buffer(), .width = 1, .height = 1, .channels = 4})};
}
inline PutMaterial textured(Ref texture) {
  PutMaterial material;
  material.parameters[0].texture = TextureUsePatch{.texture = std::move(texture), .use = {}};
  return material;
}
inline PutVolume volume() {
  const std::vector<float> values(8, 1);
  return {.density = std::make_shared<const Grid>(dense_grid(values, ivec3(2), 1))};
}
inline PutEntity showing(Ref mesh) { return {.mesh = std::move(mesh)}; }
inline PutEntity beneath(Ref parent) { return {.parent = std::move(parent)}; }
inline mat4x3 at(float x) {
  mat4x3 pose(1);
  pose[3].x = x;
  return pose;
}
inline PutEntity placed(float x) { return {.pose = PosePatch{.times = {}, .matrices = {at(x)}}}; }
inline PutEntity labelled(u32 value, bool group = false) {
  return {.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = value, .group = group}};
}
inline PutEntity classed(std::string category) {
  return {.label = LabelPatch{.category = category}};
}

struct Stage {
  std::shared_ptr<const Snapshot> now = std::make_shared<const Snapshot>();
  SceneLimits limits{};

  /// Applies, and returns the ids.
  std::vector<Id> operator()(std::vector<Edit> edits) {
    auto prepared = apply(*now, {std::move(edits)}, limits);
    INFO((prepared ? "" : prepared.error().where + ": " + prepared.error().message));
    REQUIRE(prepared);
    now = prepared->snapshot;
    return prepared->ids;
  }
  [[nodiscard]] Error refuses(std::vector<Edit> edits) const {
    auto prepared = apply(*now, {std::move(edits)}, limits);
    REQUIRE_FALSE(prepared);
    return prepared.error();
  }
  [[nodiscard]] Id id(const char* name) const { return now->find(name).value(); }
  [[nodiscard]] const Entity& entity(const char* name) const {
    return *now->find(EntityId(id(name)));
  }
  [[nodiscard]] bool has(const char* name) const { return now->find(name).has_value(); }
  [[nodiscard]] const mat4x3& pose(const char* name) const { return now->poses[id(name).index()]; }
};

}  // namespace heliograph::stage
