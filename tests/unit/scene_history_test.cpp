// What a store makes of a scene by difference from earlier ones is, byte for byte, what one makes
// that never saw another scene.
#include <cstring>

#include "renderer/backend/embree/top_level.h"
#include "renderer/bvh/accelerator.h"
#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::resident;
using namespace heliograph::test;

namespace {

template <class Range>
bool same_range(const Range& a, const Range& b) {
  using T = std::remove_cvref_t<decltype(a[0])>;
  static_assert(std::is_trivially_copyable_v<T>);
  if (a.size() != b.size()) return false;
  for (u32 i = 0; i < a.size(); ++i)
    if (std::memcmp(&a[i], &b[i], sizeof(T)) != 0) return false;
  return true;
}

bool same_frames(const ChunkedArray<ObjectFrame>& a, const ChunkedArray<ObjectFrame>& b) {
  if (a.size() != b.size()) return false;
  for (u32 i = 0; i < a.size(); ++i)
    if (!same_bytes(a[i].world_from_object, b[i].world_from_object) ||
        !same_bytes(a[i].scale, b[i].scale) || a[i].rigid != b[i].rigid)
      return false;
  return true;
}

void check_structure(const Structure& a, const Structure& b) {
  REQUIRE(a.slots.size() == b.slots.size());
  for (std::size_t i = 0; i < a.slots.size(); ++i) {
    const Slot &x = a.slots[i], &y = b.slots[i];
    REQUIRE(std::tie(x.entity, x.mesh, x.first_part, x.row, x.deforms) ==
            std::tie(y.entity, y.mesh, y.first_part, y.row, y.deforms));
    REQUIRE(x.scale == y.scale);
  }
  CHECK(a.slot_of_entity == b.slot_of_entity);
  CHECK(a.part_materials == b.part_materials);
  CHECK(std::tie(a.deforming, a.fixed, a.keyed, a.row_of_root) ==
        std::tie(b.deforming, b.fixed, b.keyed, b.row_of_root));
  CHECK(std::tie(a.groups, a.group_of_slot, a.suns, a.portals) ==
        std::tie(b.groups, b.group_of_slot, b.suns, b.portals));
  CHECK(std::tie(a.children.first, a.children.of) == std::tie(b.children.first, b.children.of));
}

void check_placement(const Placement& a, const Placement& b) {
  check_structure(*a.structure, *b.structure);
  CHECK(same_range(a.world, b.world));
  CHECK(same_range(a.slots, b.slots));
  CHECK(std::tie(a.deformed, a.moving) == std::tie(b.deformed, b.moving));
  CHECK(same_range(a.motion_keys, b.motion_keys));
  CHECK(same_bytes(a.bounds, b.bounds));
  REQUIRE(a.meshes.size() == b.meshes.size());
  for (std::size_t i = 0; i < a.meshes.size(); ++i) {
    CHECK(a.meshes[i]->segments == b.meshes[i]->segments);
    CHECK(same_range(a.meshes[i]->positions.span(), b.meshes[i]->positions.span()));
  }
}

void check_labels(const ResidentScene& a, const ResidentScene& b) {
  const auto x = a.labels({}), y = b.labels({});
  REQUIRE((x && y));
  CHECK(same_range((*x)->root_from_entity, (*y)->root_from_entity));
  CHECK(same_frames((*x)->frames, (*y)->frames));
  CHECK(same_range((*x)->boxes, (*y)->boxes));
  CHECK(same_range(a.rest_boxes({}).value(), b.rest_boxes({}).value()));
}

void check_lights(const Lights& a, const Lights& b) {
  REQUIRE(a.lights.size() == b.lights.size());
  for (std::size_t i = 0; i < a.lights.size(); ++i) {
    CHECK(std::tie(a.lights[i].instance, a.lights[i].part, a.lights[i].leaf) ==
          std::tie(b.lights[i].instance, b.lights[i].part, b.lights[i].leaf));
    CHECK(a.lights[i].radiance == b.lights[i].radiance);
  }
  CHECK(a.tree->bounds == b.tree->bounds);
  CHECK(*a.emitters == *b.emitters);
  CHECK(bool(a.part_lights) == bool(b.part_lights));
  if (a.part_lights && b.part_lights) CHECK(*a.part_lights == *b.part_lights);
  CHECK(a.groups == b.groups);
  CHECK(a.sky_power == b.sky_power);
  CHECK(a.dome_share == b.dome_share);
  CHECK(a.dome.probability == b.dome.probability);
  REQUIRE(a.suns.size() == b.suns.size());
  for (std::size_t i = 0; i < a.suns.size(); ++i) {
    CHECK(a.suns[i].direction == b.suns[i].direction);
    CHECK(a.suns[i].probability == b.suns[i].probability);
  }
}

void check_view(const kernels::SceneView& a, const kernels::SceneView& b) {
  const auto rows = [](const kernels::SceneView& v) {
    return std::span(v.instances, v.instance_count);
  };
  CHECK(same_range(rows(a), rows(b)));
  CHECK(std::tie(a.any_holes, a.any_media, a.any_passable, a.any_priority, a.any_rich, a.radius) ==
        std::tie(b.any_holes, b.any_media, b.any_passable, b.any_priority, b.any_rich, b.radius));
  CHECK(a.plain_rays == b.plain_rays);
  CHECK(std::tie(a.any_unlit, a.only_even) == std::tie(b.any_unlit, b.only_even));
  CHECK(a.center == b.center);
  const auto casters = [](const kernels::SceneView& v) {
    return std::span(v.casters, v.caster_count);
  };
  CHECK(same_range(casters(a), casters(b)));
  CHECK(a.cast_light_count == b.cast_light_count);
}

/// What is made late.
struct Asked {
  bool instances = true, labels = true;
};

void check_same(const ResidentScene& a, const ResidentScene& b, const Asked& asked) {
  check_placement(a.placement(), b.placement());
  check_lights(a.lights(), b.lights());
  if (asked.labels) check_labels(a, b);
  if (!asked.instances) return;
  CHECK(same_range(a.placement().instances(), b.placement().instances()));
  check_view(a.view(), b.view());
}

/// Scenes of a few chunks, edited at random, in branches.
class History {
 public:
  explicit History(u32 seed) : random_(seed) {
    Edits edits;
    edits.mesh("cube", cube()).mesh("ball", sphere(4)).put("flesh", morphing_sphere(random_, 0.3f));
    edits.material("red", vec3(0.8f, 0.1f, 0.1f)).put("paper", paper()).put("mirror", mirror());
    edits.put("glow", glow()).dome(vec3(0.2f));
    for (u32 i = 0; i < 520; ++i) add(edits, name(i));
    for (u32 i = 0; i < 520; i += 9) edits.put(name(i), under(name(i + 1)));
    heads_ = {edits.apply()};
    count_ = 520;
  }
  /// Some scenes are not asked for all that they have.
  Asked asked() { return {.instances = below(4) > 0, .labels = below(4) > 0}; }
  /// The scene after one to three more edits of one of its branches.
  std::shared_ptr<const Snapshot> step() {
    const std::size_t which = below(u32(heads_.size()));
    auto scene = heads_[which];
    for (u32 n = 1 + below(3); n > 0; --n) {
      Edits edits;
      edit(edits, *scene);
      Transaction transaction = edits.transaction();
      if (below(9) == 0) transaction.edits.push_back(Edit{.action = Advance{.dt = 0.1}});
      if (below(2) == 0) std::ranges::reverse(transaction.edits);
      auto made = heliograph::apply(*scene, transaction, {});
      if (made) scene = made->snapshot;  // what is refused changes nothing
    }
    if (below(6) == 0 && heads_.size() < 4)
      heads_.push_back(scene);
    else
      heads_[which] = scene;
    return scene;
  }
  TimeSpan span(const Snapshot& scene) {
    switch (below(5)) {
      case 0:
        return {scene.time - 0.05, scene.time};
      case 1:
        return {scene.time - 0.02, scene.time + 0.03};
      case 2:
        return {scene.time - 0.04, scene.time - 0.04};
      default:
        return {scene.time, scene.time};
    }
  }

 private:
  u32 below(u32 n) { return std::min(u32(random_.next() * float(n)), n - 1); }
  static std::string name(u32 i) { return fmt::format("e{}", i); }
  std::string any() { return name(below(count_)); }
  static PutEntity under(const std::string& parent) {
    PutEntity put;
    put.parent = Ref(parent);
    return put;
  }
  static PutMaterial paper() {
    PutMaterial put;
    put.parameters[std::size_t(MaterialParameter::alpha)].value = vec3(0.4f);
    put.alpha_mode = AlphaMode::kBlend;
    return put;
  }
  static PutMaterial mirror() {
    PutMaterial put;
    put.parameters[std::size_t(MaterialParameter::metallic)].value = vec3(1);
    put.parameters[std::size_t(MaterialParameter::roughness)].value = vec3(0.1f);
    return put;
  }
  static PutMaterial glow() {
    PutMaterial put;
    put.parameters[std::size_t(MaterialParameter::emission)].value = vec3(1, 0.5f, 0.2f);
    put.parameters[std::size_t(MaterialParameter::emission_strength)].value = vec3(3);
    return put;
  }
  void add(Edits& edits, const std::string& target) {
    constexpr std::array kMeshes{"cube", "ball", "cube", "flesh"};
    constexpr std::array kMaterials{"red", "red", "", "paper", "mirror", "glow"};
    const u32 k = below(40);
    edits.object(target, kMeshes[k % 20 == 3 ? 3 : k % 3], random_pose(random_, 8, 0.5f),
                 kMaterials[k < 6 ? k : k % 2]);
  }
  Light lamp() {
    Light light;
    light.intensity = 1 + random_.next();
    light.shape = below(2) ? LightShape::kSphere : LightShape::kDisc;
    light.radius = 0.2f + random_.next();
    return light;
  }
  PutEntity labelled() {
    PutEntity put;
    put.label = LabelPatch{.kind = LabelPatch::Kind(below(3)), .value = 1 + below(900)};
    put.label->group = below(2) == 0;
    if (below(3) == 0) put.label->category = fmt::format("class{}", below(3));
    return put;
  }
  PutEntity flags() {
    PutEntity put;
    switch (below(5)) {
      case 0:
        put.visible = below(2) == 0;
        break;
      case 1:
        put.visibility = u8(below(64));
        break;
      case 2:
        put.shadow_catcher = below(2) == 0;
        break;
      case 3:
        put.is_static = below(2) == 0;
        break;
      default:
        put.light_group = below(2) ? "a" : "b";
    }
    return put;
  }
  PutEntity keyed() {
    PutEntity put;
    put.pose = PosePatch{{-1, 0.3, 2}, {}};
    for (int i = 0; i < 3; ++i) put.pose->matrices.push_back(random_pose(random_, 8, 0.5f));
    return put;
  }
  void edit(Edits& edits, const Snapshot& scene) {
    const std::string target = any();
    switch (below(17)) {
      case 0:
        add(edits, name(count_++));
        break;
      case 1:
        edits.put(target, Remove{.cascade = below(2) == 0});
        break;
      case 2:
        edits.put(target, under(any()));
        break;
      case 3:
        edits.put(target, flags());
        break;
      case 4:
        edits.put(target, labelled());
        break;
      case 5:
        edits.put(target, keyed());
        break;
      case 6:
        edits.put(target, PutEntity{.morph_weights = MorphWeights{{}, {random_.next()}}});
        break;
      case 7:
        edits.light(any(), lamp());
        break;
      case 8:
        edits.put(target, materials(below(2) ? "paper" : "glow"));
        break;
      case 9:
        edits.put(below(2) ? "red" : "paper", below(2) ? paper() : glow());
        break;
      case 10:
        edits.mesh("cube", below(2) ? cube() : sphere(3));
        break;
      case 11:
        edits.dome(vec3(random_.next()));
        break;
      case 12: {
        PutSettings settings;
        settings.time = scene.time + double(random_.next());
        edits.put(settings);
        break;
      }
      case 13: {
        PutEntity jump;
        jump.pose = PosePatch{{}, {random_pose(random_, 8, 0.5f)}};
        jump.teleport = true;
        edits.put(target, jump);
        break;
      }
      default:
        edits.pose(target, random_pose(random_, 8, 0.5f));
    }
  }
  static PutEntity materials(const std::string& material) {
    PutEntity put;
    put.materials = std::vector<Ref>{Ref(material)};
    return put;
  }

  Random random_;
  std::vector<std::shared_ptr<const Snapshot>> heads_;
  u32 count_ = 0;
};

std::shared_ptr<const ResidentScene> made(SceneStore& store,
                                          const std::shared_ptr<const Snapshot>& snapshot,
                                          const TimeSpan& span) {
  auto scene = store.prepare(snapshot, span, Interrupt{});
  REQUIRE(scene);
  return *scene;
}

void check_history(const Accelerator& accelerator, u32 seed, u32 steps) {
  History history(seed);
  DerivedCache cache(1u << 30), other_cache(1u << 30);
  SceneStore store(accelerator, cache, 1u << 30);
  for (u32 i = 0; i < steps; ++i) {
    CAPTURE(seed, i);
    const auto snapshot = history.step();
    const TimeSpan span = history.span(*snapshot);
    SceneStore fresh(accelerator, other_cache, 1u << 30);
    check_same(*made(store, snapshot, span), *made(fresh, snapshot, span), history.asked());
  }
}

}  // namespace

TEST_CASE("scene history: a scene does not depend on those that were there before") {
  const bvh::BvhAccelerator accelerator(4'000'000);
  for (const u32 seed : {1u, 2u, 3u}) check_history(accelerator, seed, 120);
}

TEST_CASE("scene history: nor does it where Embree traces it") {
  const embree::DeviceHandle device(rtcNewDevice(nullptr));
  const embree::EmbreeAccelerator accelerator(device.get(), 4'000'000);
  check_history(accelerator, 4, 120);
}

TEST_CASE("scene history: a move touches the chunks of what moved, and no others") {
  Edits edits;
  edits.mesh("cube", cube());
  for (u32 i = 0; i < 1000; ++i)
    edits.object(fmt::format("e{}", i), "cube", translation({float(i), 0, 0}));
  const auto base = edits.apply();
  const bvh::BvhAccelerator accelerator(0);
  DerivedCache cache(1u << 30);
  SceneStore store(accelerator, cache, 1u << 30);
  const auto before = made(store, base, {0, 0});
  const auto label = [](const ResidentScene& scene) { return *scene.labels({}).value(); };
  const auto& rows = before->placement().instances();
  const LabelFrames frames = label(*before);
  const auto moved = Edits().pose("e300", translation({0, 5, 0})).apply(*base);
  const auto after = made(store, moved, {0, 0});
  const Placement &a = before->placement(), &b = after->placement();
  const LabelFrames frames_after = label(*after);
  REQUIRE(rows.chunk_count() == 4);
  for (u32 c = 0; c < 4; ++c) {
    CAPTURE(c);
    CHECK(b.slots.shares(c, a.slots));
    CHECK(b.instances().shares(c, rows) == (c != 1));
    CHECK(b.world.shares(c, a.world) == (c != 1));
    CHECK(frames_after.frames.shares(c, frames.frames) == (c != 1));
    CHECK(frames_after.boxes.shares(c, frames.boxes));  // of what moved, the same
  }
  CHECK(after->structure().slots.data() == before->structure().slots.data());
}
