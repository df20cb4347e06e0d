// Watch: every change once, in order, whatever happens to the connection.
#include <chrono>
#include <thread>

#include "fixture.h"
#include "flaky_proxy.h"

using namespace heliograph::client;
using namespace std::chrono_literals;

namespace {

void put(const Scene& scene, const std::string& name) {
  Transaction edit = scene.edit();
  edit.entity(name, Components().visible(true));
  edit.commit();
}

}  // namespace

TEST_CASE("a watch tells each change from a revision on, what it did, and to what") {
  const Scene scene = client().create_scene("watched", Lifetime::kDaemon);
  put(scene, "before");
  Watch watch = scene.watch({1, {}});
  CHECK(watch.revision() == 0);
  Transaction edit = scene.edit();
  edit.entity("a", Components().visible(false));
  edit.advance(0.5);
  edit.commit();
  const auto first = watch.next();
  REQUIRE(first);
  CHECK(first->edits.front().name == "before");
  const auto second = watch.next();
  REQUIRE(second);
  CHECK(second->revision == 2);
  CHECK(watch.revision() == 2);
  REQUIRE(second->edits.size() == 2);
  CHECK(second->edits[0].action == "entity");
  CHECK(second->edits[0].ids == std::vector<std::uint64_t>{scene.entity("a").id()});
  CHECK(contains(second->edits[0].fields, "visible"));
  CHECK(second->edits[1].action == "advance");
  CHECK(second->edits[1].ids.empty());
  std::thread other([&] { put(scene, "late"); });
  CHECK(watch.next()->revision == 3);
  other.join();
  Scene(scene).remove();
  CHECK(error_of([&] { (void)watch.next(); }).code() == Code::kNotFound);
}

TEST_CASE("a watch begins now by default, gives bookmarks when asked, and ends by close()") {
  const Scene scene = client().create_scene();
  put(scene, "before");
  Watch watch = scene.watch({{}, 0.5});
  CHECK(watch.revision() == 1);
  const auto bookmark = watch.next();
  REQUIRE(bookmark);
  CHECK(bookmark->is_bookmark);
  CHECK(bookmark->revision == 1);
  std::thread other([&] {
    std::this_thread::sleep_for(50ms);
    watch.close();
  });
  CHECK_FALSE(watch.next());
  other.join();
  CHECK(error_of([&] { (void)scene.watch({0, {}}); }).field() == "from_revision");
  const ClientError late = error_of([&] { (void)scene.watch({1, {}}); });
  CHECK(late.code() == Code::kOutOfRange);  // a private scene keeps changes since its first watch
  CHECK(late.details().expected == 2);
  CHECK(error_of([&] { (void)scene.watch({9, {}}); }).details().expected == 2);
}

TEST_CASE("a watch whose connection breaks all the time loses and doubles nothing") {
  FlakyProxy proxy(client().address());
  Client flaky = connect(proxy.address());
  const Scene scene = flaky.create_scene("flaky", Lifetime::kDaemon);
  const Scene other = client().open_scene("flaky");
  constexpr int kEdits = 300;
  std::thread editor([&] {
    for (int i = 0; i < kEdits; ++i) {
      put(other, "thing");
      if (i % 60 == 59) proxy.cut();
      std::this_thread::sleep_for(2ms);
    }
  });
  Watch watch = scene.watch({1, {}});
  for (std::uint64_t revision = 1; revision <= kEdits; ++revision) {
    const auto change = watch.next();
    REQUIRE(change);
    REQUIRE(change->revision == revision);
  }
  editor.join();
  Scene(scene).remove();
}
