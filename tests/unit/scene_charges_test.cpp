// What scenes are charged as they are edited, and when it goes back.
#include "server/scene/scene_charges.h"

#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u64 kMega = 1 << 20;

Limits limits_of(u64 bytes) {
  Limits limits;
  limits.tenant_bytes = bytes;
  return limits;
}

/// A scene that keeps few revisions, and its tenant's ledger.
class Stage {
 public:
  explicit Stage(u64 bytes = 1 << 30) : limits_(limits_of(bytes)) {}

  Status edit(Edit edit) {
    Transaction transaction;
    transaction.edits.push_back(std::move(edit));
    const auto before = scene_.pending();
    const auto prepared = scene_.prepare(transaction, std::nullopt);
    REQUIRE(prepared);
    if (auto room = charges_.add(*before, transaction, *prepared); !room) {
      scene_.drop_pending(prepared->snapshot->revision);
      return room;
    }
    const auto forgotten = scene_.publish(*prepared);
    if (!forgotten.empty()) charges_.forget(forgotten.back()->revision);
    return {};
  }
  Status put(const std::string& name, u64 bytes) {
    PutEntity entity;
    entity.attributes = Attributes{{"text", std::string(bytes, 'x')}};
    return edit({.target = name, .action = std::move(entity)});
  }
  Status move_on() { return edit({.target = "other", .action = PutEntity()}); }

  [[nodiscard]] u64 used() const { return tenant_.bytes->used(); }
  [[nodiscard]] const Ledger& tenant() const { return tenant_; }
  [[nodiscard]] const Ledger& all() const { return all_; }

 private:
  const Limits limits_;
  const Ledger all_ = Ledger::of_all(limits_);
  const Ledger tenant_ = Ledger::of_tenant(limits_, all_);
  Scene scene_{std::make_shared<const Snapshot>(), {.revisions = 3}};
  SceneCharges charges_ = SceneCharges::take(tenant_, *scene_.head()).value();
};

}  // namespace

TEST_CASE("scene charges: attributes count, and what older revisions keep of them") {
  Stage stage;
  REQUIRE(stage.put("a", 10 * kMega));
  CHECK(stage.used() > 10 * kMega);
  REQUIRE(stage.put("a", 1));
  CHECK(stage.used() > 10 * kMega);  // the revision before has them still
  for (int i = 0; i < 3; ++i) REQUIRE(stage.move_on());
  CHECK(stage.used() < kMega);
}

TEST_CASE("scene charges: names, and all edits of one entity in a transaction") {
  Stage stage;
  const u64 before = stage.used();
  REQUIRE(stage.edit({.target = std::string(1000, 'n'), .action = PutEntity()}));
  CHECK(stage.used() - before > 1000 + 500);
  REQUIRE(stage.put("a", kMega));
  REQUIRE(stage.put("a", kMega));
  CHECK(stage.used() < before + 2 * kMega + (64 << 10));
}

TEST_CASE("scene charges: what is too much changes nothing") {
  Stage stage(4 * kMega);
  REQUIRE(stage.put("a", kMega));
  const u64 used = stage.used();
  const Status refused = stage.put("b", 4 * kMega);
  REQUIRE(!refused);
  CHECK(refused.error().code == Code::kResourceExhausted);
  CHECK(refused.error().message.find("tenant_bytes") != std::string::npos);
  CHECK(stage.used() == used);
  CHECK(stage.tenant().entities->used() == 1);
  CHECK(stage.put("b", kMega));
}

TEST_CASE("scene charges: instances count, and so do removed ones while a revision has them") {
  Stage stage;
  const u64 before = stage.used();
  Instances many{.prototype = {}, .matrices = std::vector<mat4x3>(1000, mat4x3(1))};
  many.prototype.parent = Ref(std::string("root"));
  REQUIRE(stage.edit({.target = "root", .action = PutEntity()}));
  REQUIRE(stage.edit({.target = "many", .action = many}));
  CHECK(stage.tenant().entities->used() == 1001);
  CHECK(stage.used() - before > 1000 * 500);
  REQUIRE(stage.edit({.target = "root", .action = Remove{.cascade = true}}));
  CHECK(stage.tenant().entities->used() == 0);
  CHECK(stage.used() - before > 1000 * 500);
  for (int i = 0; i < 3; ++i) REQUIRE(stage.move_on());
  CHECK(stage.used() - before < 64 << 10);
}

TEST_CASE("scene charges: rows that revisions keep") {
  Stage stage;
  Instances many{.prototype = {}, .matrices = std::vector<mat4x3>(1000, mat4x3(1))};
  REQUIRE(stage.edit({.target = "many", .action = many}));
  const u64 before = stage.used();
  REQUIRE(stage.edit({.target = "many/7", .action = PutEntity{.visible = false}}));
  const u64 kept = stage.used() - before;
  CHECK(kept >= 256 * sizeof(Entity));
  CHECK(kept < 1000 * sizeof(Entity));
}

TEST_CASE("scene charges: a scene counts, and all goes back with it") {
  const Limits limits;
  const Ledger all = Ledger::of_all(limits), tenant = Ledger::of_tenant(limits, all);
  {
    const auto charges = SceneCharges::take(tenant, Snapshot());
    REQUIRE(charges);
    CHECK(all.scenes->used() == 1);
  }
  CHECK(all.scenes->used() == 0);
  CHECK(all.bytes->used() == 0);
}
