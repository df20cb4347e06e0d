// What the CPU backend makes again when surfaces change shape: their own structures, nothing else.
#include <map>

#include "renderer/backend/embree/top_level.h"

#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::embree;
using namespace heliograph::test;

namespace {

using Blases = std::map<std::string, const MeshAccelerator*>;

/// The acceleration structure that each entity shows.
Blases blases(const ResidentScene& scene) {
  Blases out;
  const Placement& placement = scene.placement();
  for (std::size_t i = 0; i < placement.structure->slots.size(); ++i) {
    const EntityId id = scene.snapshot().entity_id(placement.structure->slots[i].entity);
    out[scene.snapshot().name_of(id)] = placement.mesh(i).accelerator.get();
  }
  return out;
}

/// Entities whose structures differ.
std::vector<std::string> changed(const Blases& a, const Blases& b) {
  std::vector<std::string> names;
  for (const auto& [name, blas] : a)
    if (b.at(name) != blas) names.push_back(name);
  return names;
}

PutMesh morphing() {
  const Shape shape = quad();
  auto topology = std::make_shared<MeshTopology>();
  topology->vertex_count = 4;
  topology->triangles = ArrayOf<uvec3>(std::vector<uvec3>(shape.triangles));
  topology->morph_count = 1;
  topology->morph_positions = ArrayOf<vec3>(std::vector<vec3>(4, {0, 0, 1}));
  auto vertices = std::make_shared<VertexKeys>();
  vertices->times = {0};
  vertices->positions = ArrayOf<vec3>(std::vector<vec3>(shape.positions));
  return {topology, vertices};
}
PutEntity weights(float w) { return {.morph_weights = MorphWeights{{}, {w}}}; }

struct Device {
  DeviceHandle device{rtcNewDevice(nullptr)};
  DerivedCache cache{1u << 30};
  EmbreeAccelerator accelerator{device.get(), BackendOptions{}.static_triangles};
  SceneStore store{accelerator, cache, BackendOptions{}.cache_bytes};

  std::shared_ptr<const ResidentScene> operator()(const std::shared_ptr<const Snapshot>& snapshot,
                                                  Time time) {
    auto scene = store.prepare(snapshot, {time, time}, Interrupt{});
    REQUIRE(scene);
    return *scene;
  }
};

}  // namespace

TEST_CASE("scene store: only what changes shape gets a new structure") {
  Device device;
  auto base = Edits()
                  .mesh("sphere", sphere(16))
                  .put("flag", morphing())
                  .object("still", "sphere", mat4x3(1))
                  .object("rest", "flag", mat4x3(1))
                  .object("waving", "flag", mat4x3(1))
                  .apply();
  const auto at_rest = device(base, 0);
  const Blases rest = blases(*at_rest);
  CHECK(rest.at("rest") == rest.at("waving"));  // weights of 0 need no vertices of their own

  const auto waved = Edits().put("waving", weights(0.5f)).apply(*base);
  const auto after = device(waved, 0);
  const Blases waving = blases(*after);
  CHECK(changed(rest, waving) == std::vector<std::string>{"waving"});
  const auto& meshes = after->placement().meshes;
  CHECK(meshes.back()->topology == meshes[1]->topology);

  // The same shape again, by another way, is the same structure.
  const auto again = Edits().put("rest", weights(0.5f)).apply(*waved);
  CHECK(blases(*device(again, 0)).at("rest") == waving.at("waving"));
  // Moving things makes no structure at all.
  const auto moved = Edits().pose("waving", translation({3, 0, 0})).apply(*again);
  CHECK(changed(blases(*device(moved, 0)), blases(*device(again, 0))).empty());
}

TEST_CASE("scene store: shapes of the past are forgotten, those in use are kept") {
  Device device;
  auto scene = Edits().put("flag", morphing()).object("waving", "flag", mat4x3(1)).apply();
  device(scene, 0);
  u64 settled = 0;
  for (int i = 1; i <= 400; ++i) {
    scene = Edits().put("waving", weights(float(i))).apply(*scene);
    device(scene, 0);
    if (i == 200) settled = device.cache.bytes();
  }
  CHECK(device.cache.bytes() <= settled);
}

TEST_CASE("scene store: scenes that are left to it go when the next ones are made") {
  Device device;
  auto scene = Edits().mesh("sphere", sphere(8)).object("ball", "sphere", mat4x3(1)).apply();
  std::vector<std::weak_ptr<const ResidentScene>> all;
  for (int i = 0; i < 40; ++i) {
    scene = Edits().pose("ball", translation({float(i), 0, 0})).apply(*scene);
    const std::vector<SceneAt> wanted{{scene, {0, 0}}};
    auto made = device.store.prepare_all(wanted, Interrupt{});
    REQUIRE(made);
    auto resident = std::static_pointer_cast<const ResidentScene>(made->front());
    all.emplace_back(resident);
    made->clear();
    device.store.free_later(std::move(resident));
  }
  all.pop_back();  // it waits for the next one
  CHECK(std::ranges::all_of(all, [](const auto& each) { return each.expired(); }));
}

PutMaterial surface(float metallic, float roughness) {
  PutMaterial material;
  material.parameters[std::size_t(MaterialParameter::metallic)].value = vec3(metallic);
  material.parameters[std::size_t(MaterialParameter::roughness)].value = vec3(roughness);
  return material;
}

TEST_CASE("scene store: mirrors and lenses are casters") {
  Edits edits;
  edits.mesh("cube", cube()).put("mirror", surface(1, 0.1f)).put("brushed", surface(1, 0.6f));
  edits.object("a", "cube", scaled({1, 4, 2}, {5, 6, 7}), "mirror");
  edits.object("b", "cube", mat4x3(1), "brushed").object("c", "cube", mat4x3(1));
  Device device;
  const auto scene = device(edits.apply(), 0);
  REQUIRE(scene->view().caster_count == 1);
  CHECK(scene->view().casters[0].center == vec3(5, 6, 7));
  CHECK(scene->view().casters[0].radius == 2);
  CHECK(scene->view().caster_probability == 0.2f);
}

TEST_CASE("scene store: of many casters those stay that catch the most light, if they stand out") {
  Light lamp;
  lamp.shape = LightShape::kSphere;
  Edits edits;
  edits.mesh("cube", cube()).put("mirror", surface(1, 0.1f));
  edits.pose("lamp", scaled(vec3(1), {0, 0, 5})).light("lamp", lamp);
  const auto view_of = [&](u32 near, u32 far) {
    Edits all = edits;
    for (u32 i = 0; i < far; ++i)  // these come first
      all.object("far" + std::to_string(i), "cube", scaled(vec3(1), {100, float(i), 0}), "mirror");
    for (u32 i = 0; i < near; ++i) {
      const vec3 place(std::cos(float(i)), std::sin(float(i)), 0);
      all.object("near" + std::to_string(i), "cube", scaled(vec3(1), place), "mirror");
    }
    return Device()(all.apply(), 0);
  };
  const u32 most = kernels::kMostCasters;
  const auto probability = [&](u32 near, u32 far) {
    return view_of(near, far)->view().caster_probability;
  };
  const auto crowded = view_of(most, 20);
  REQUIRE(crowded->view().caster_count == most);
  for (u32 i = 0; i < most; ++i) CHECK(crowded->view().casters[i].center.x < 10);
  CHECK(probability(most, 0) == 0.2f);
  CHECK(probability(most, 1) > 0.19f);  // one that is far away changes little
  CHECK(probability(most + 1, 0) > 0.1f);
  CHECK(probability(most + 1, 0) < 0.2f);
  CHECK(probability(100 * most, 0) == 0);
  CHECK(view_of(100 * most, 0)->view().caster_count == 0);
}
