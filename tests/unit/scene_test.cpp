// The chain of revisions, names, and describe().
#include "renderer/scene/scene.h"

#include <thread>

#include "renderer/scene/labels.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::stage;

TEST_CASE("scene: prepare and publish are two steps, in order") {
  Scene scene(std::make_shared<const Snapshot>(), {});
  auto first = scene.prepare({{named("a", PutEntity{})}}, 0);
  REQUIRE(first);
  CHECK(scene.head()->revision == 0);
  auto second = scene.prepare({{named("b", beneath("a"))}}, 1);
  REQUIRE(second);
  scene.publish(*first);
  CHECK(scene.head()->find("a"));
  CHECK_FALSE(scene.head()->find("b"));
  scene.publish(*second);
  CHECK(scene.head()->revision == 2);
  CHECK(scene.head()->find("b"));
}

TEST_CASE("scene: a revision that is not expected aborts and is named") {
  Scene scene(std::make_shared<const Snapshot>(), {});
  scene.publish(scene.prepare({{named("a", PutEntity{})}}, {}).value());
  const auto refused = scene.prepare({{named("b", PutEntity{})}}, 0);
  REQUIRE_FALSE(refused);
  CHECK(refused.error().code == Code::kAborted);
  CHECK(refused.error().expected == 1);
  CHECK(scene.prepare({{named("b", PutEntity{})}}, 1));
}

TEST_CASE("scene: dropping what is pending goes back to the head") {
  Scene scene(std::make_shared<const Snapshot>(), {});
  REQUIRE(scene.prepare({{named("a", PutEntity{})}}, {}));
  scene.drop_pending();
  auto again = scene.prepare({{named("a", PutEntity{}, Mode::kCreate)}}, 0);
  REQUIRE(again);
  scene.publish(*again);
  CHECK(scene.head()->revision == 1);
}

TEST_CASE("scene: recent revisions are kept, others are out of range") {
  Scene scene(std::make_shared<const Snapshot>(), {.revisions = 3});
  for (float x = 1; x <= 5; ++x)
    scene.publish(scene.prepare({{named("a", placed(x))}}, {}).value());
  CHECK(scene.at(5).value() == scene.head());
  CHECK(scene.at(3).value()->poses[0] == at(3));
  for (const Revision revision : {0, 2, 6}) {
    const auto gone = scene.at(revision);
    REQUIRE_FALSE(gone);
    CHECK(gone.error().code == Code::kOutOfRange);
  }
}

TEST_CASE("scene: many threads edit, none is lost") {
  Scene scene(std::make_shared<const Snapshot>(), {});
  std::mutex order;
  const auto work = [&](u32 thread) {
    for (u32 k = 0; k < 50; ++k) {
      const std::lock_guard lock(order);
      auto prepared = scene.prepare(
          {{named(std::to_string(thread) + "/" + std::to_string(k), PutEntity{})}}, {});
      if (prepared) scene.publish(*prepared);
    }
  };
  const auto read = [&] {
    for (u32 k = 0; k < 200; ++k) {
      const auto head = scene.head();
      if (head->names.size() != head->entities.count()) std::abort();
    }
  };
  {
    std::vector<std::jthread> threads;
    for (u32 t = 0; t < 3; ++t) threads.emplace_back(work, t);
    threads.emplace_back(read);
  }
  CHECK(scene.head()->entities.count() == 150);
  CHECK(scene.head()->revision == 150);
}

TEST_CASE("scene: concurrent preparations build on each other") {
  Scene scene(std::make_shared<const Snapshot>(), {});
  std::array<u32, 4> prepared{};
  {
    std::vector<std::jthread> threads;
    for (u32 t = 0; t < 4; ++t)
      threads.emplace_back([&, t] {
        for (u32 k = 0; k < 50; ++k)
          prepared[t] += scene.prepare({{anonymous(PutEntity{})}}, {}).has_value();
      });
  }
  CHECK(prepared == std::array<u32, 4>{50, 50, 50, 50});
  const auto last = scene.prepare({}, 200);
  REQUIRE(last);
  CHECK(last->snapshot->entities.count() == 200);
}

TEST_CASE("snapshot: nearest names are the nearest, in order") {
  Stage scene;
  for (const char* name : {"ball", "bell", "bill", "wall", "chandelier"})
    scene({named(name, PutEntity{})});
  CHECK(scene.now->find("bal").error().nearest == std::vector<std::string>{"ball", "bell", "bill"});
  CHECK(scene.now->find("chandelie").error().nearest == std::vector<std::string>{"chandelier"});
  CHECK(scene.now->find("xyz").error().nearest.empty());
  CHECK(scene.now->find("").error().code == Code::kNotFound);
  CHECK_FALSE(scene.now->alive(Id{}));
}
