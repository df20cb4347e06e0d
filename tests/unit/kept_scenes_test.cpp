// What stays of scenes that take turns, and what is known to be missing of one.
#include "renderer/resident/scene.h"

#include "renderer/bvh/accelerator.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::resident;
using namespace heliograph::test;

namespace {

using SnapshotPtr = std::shared_ptr<const Snapshot>;

struct Store {
  explicit Store(u64 bytes, SceneStore::Copies copies = SceneStore::Copies::kNever)
      : cache(bytes), store(accelerator, cache, bytes, copies) {}
  std::shared_ptr<const ResidentScene> operator()(const SnapshotPtr& snapshot, Time time = 0) {
    auto scene = store.prepare(snapshot, {time, time}, Interrupt{});
    REQUIRE(scene);
    return *scene;
  }
  Preparation needs(const SnapshotPtr& snapshot) { return store.preparation({snapshot, {0, 0}}); }

  bvh::BvhAccelerator accelerator{4'000'000};
  DerivedCache cache;
  SceneStore store;
};

SnapshotPtr of_scene(const SnapshotPtr& snapshot, const std::shared_ptr<const SceneLife>& life) {
  auto own = std::make_shared<Snapshot>(*snapshot);
  own->scene = life;
  return own;
}

/// A Scene, as far as a store knows of it.
struct Life {
  explicit Life(const Edits& edits, bool is_pinned = false)
      : life(std::make_shared<const SceneLife>(is_pinned)),
        snapshot(of_scene(edits.apply(), life)) {}
  std::shared_ptr<const SceneLife> life;
  SnapshotPtr snapshot;
};

Edits balls(u32 detail) {
  Edits edits;
  edits.mesh("sphere", sphere(detail));
  for (int i = 0; i < 40; ++i) {
    edits.object(fmt::format("ball{}", i), "sphere", translation({float(i), 0, 0}));
    PutEntity still;
    still.is_static = true;
    edits.put(fmt::format("ball{}", i), still);
  }
  return edits;
}

/// What a scene is shown with: kept, if it is the same one.
const void* made(const ResidentScene& scene) { return &scene.placement(); }

}  // namespace

TEST_CASE("kept scenes: as many as there is room for, each with its times and its static group") {
  Store store(u64(1) << 30);
  std::vector<Life> scenes;
  for (int i = 0; i < 30; ++i) scenes.emplace_back(balls(4));
  std::vector<const void*> first;
  for (const Time time : {0.0, 0.1, -0.1})
    for (const Life& each : scenes) first.push_back(made(*store(each.snapshot, time)));
  std::vector<const void*> again;
  for (const Time time : {0.0, 0.1, -0.1})
    for (const Life& each : scenes) again.push_back(made(*store(each.snapshot, time)));
  CHECK(first == again);
  CHECK(store.store.made_again() == 0);
}

TEST_CASE("kept scenes: those used least lately go where there is no room, and are counted") {
  u64 one = 0;
  {
    Store store(u64(1) << 30);
    const Life life(balls(16));
    store(life.snapshot);
    one = store.store.bytes() + store.cache.bytes();
  }
  Store store(one * 7 / 2);  // three
  std::vector<Life> scenes;
  for (int i = 0; i < 4; ++i) scenes.emplace_back(balls(16));
  const Life pinned(balls(2), true);
  const void* of_pinned = made(*store(pinned.snapshot));
  for (const int i : {0, 1, 2}) store(scenes[i].snapshot);
  const void* of_first = made(*store(scenes[0].snapshot));
  CHECK(store.store.made_again() == 0);
  store(scenes[3].snapshot);
  CHECK(made(*store(scenes[0].snapshot)) == of_first);
  CHECK(store.store.made_again() == 0);
  store(scenes[1].snapshot);
  CHECK(store.store.made_again() == 1);
  CHECK(made(*store(pinned.snapshot)) == of_pinned);
  CHECK(store.store.bytes() + store.cache.bytes() <= one * 7 / 2);
}

TEST_CASE("kept scenes: what is in use stays, however much it is") {
  Store store(1);
  const Life a(balls(8)), b(balls(8));
  const auto used = store(a.snapshot);
  store(b.snapshot);
  CHECK(made(*store(a.snapshot)) == made(*used));
}

TEST_CASE("kept scenes: nothing is kept of a scene that is gone, nor what a scene has no more") {
  Store store(u64(1) << 30);
  Life life(balls(4));
  std::weak_ptr<const Snapshot> first = life.snapshot;
  store(life.snapshot);
  life.snapshot = Edits().mesh("sphere", sphere(5)).apply(*life.snapshot);
  store(life.snapshot);
  const Life other(balls(2));
  store(other.snapshot);
  CHECK(first.expired());
  std::weak_ptr<const Snapshot> second = life.snapshot;
  life = other;
  const u64 before = store.store.bytes();
  store(other.snapshot);
  store(other.snapshot);
  CHECK(second.expired());
  CHECK(store.store.bytes() < before);
}

TEST_CASE("kept scenes: what a scene needs first is told by asset, and once it is there no more") {
  Store store(u64(1) << 30);
  Edits edits = balls(8);
  const ArrayOf texels(std::vector<u8>(64 * 32, 128));
  PutTexture sky;
  sky.image = std::make_shared<const ImageData>(
      ImageData{.texels = texels.buffer(), .width = 64, .height = 32, .channels = 1});
  edits.put("sky", sky);
  PutSettings settings;
  settings.dome = PutDome{.texture = Ref("sky")};
  edits.put(settings);
  Life life(edits);
  Preparation needed = store.needs(life.snapshot);
  REQUIRE(needed.pieces.size() == 2);  // the mesh and the dome
  CHECK(needed.pieces[0].key != needed.pieces[1].key);
  CHECK(needed.pieces[0].key == store.needs(life.snapshot).pieces[0].key);
  CHECK(needed.seconds > 1e-3);
  for (const Errand& piece : needed.pieces) piece.run({});
  CHECK(store.needs(life.snapshot).pieces.empty());
  const u64 derived = store.cache.bytes();
  store(life.snapshot);
  CHECK(store.cache.bytes() < derived + 4096);  // bounds; no second tree, no second table
  needed = store.needs(life.snapshot);
  CHECK(needed.pieces.empty());
  CHECK(needed.seconds == 0);

  const auto seconds_after = [&](Edits more) {
    return store.needs(more.apply(*life.snapshot)).seconds;
  };
  const double of_static = seconds_after(Edits().pose("ball3", translation({0, 0, 9})));
  CHECK(of_static > 0);
  CHECK(seconds_after(Edits().camera("camera", mat4x3(1), 8, 8, 8)) < of_static / 2);
}

TEST_CASE("kept scenes: a device's copy is no use of a scene, and goes with it") {
  Store store(1, SceneStore::Copies::kOfEach);
  const Life first(balls(4)), second(balls(5)), third(balls(6));
  const auto a = store(first.snapshot);
  CHECK(store.store.keeps(*a));
  CHECK(store.store.let_go().empty());
  const auto b = store(second.snapshot);
  const std::vector in_use(1, b);
  CHECK_FALSE(store.store.keeps(*a));
  REQUIRE(store.store.let_go() == std::vector{a});
  CHECK(store.store.let_go().empty());
  const auto c = store(third.snapshot);
  CHECK(store.store.keeps(*in_use.front()));
  CHECK(store.store.keeps(*c));
  CHECK(store.store.let_go().empty());
}

TEST_CASE("kept scenes: what a scene has no more is let go, though a device has a copy") {
  Store store(u64(1) << 30, SceneStore::Copies::kOfEach);
  Edits edits = balls(4);
  const Life life(edits);
  const auto with = store(life.snapshot);
  const auto without = store(of_scene(edits.mesh("sphere", sphere(5)).apply(), life.life));
  CHECK_FALSE(store.store.keeps(*with));
  CHECK(store.store.keeps(*without));
  CHECK(store.store.let_go() == std::vector{with});
}

TEST_CASE("kept scenes: the copies of a Scene that is gone are let go") {
  Store store(u64(1) << 30, SceneStore::Copies::kOfEach);
  std::optional<Life> life(balls(4));
  const auto first = store(life->snapshot);
  life.reset();
  const Life other(balls(5));
  (void)store(other.snapshot);
  CHECK(store.store.let_go() == std::vector{first});
}
