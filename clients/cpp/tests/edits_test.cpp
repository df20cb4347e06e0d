// Transactions: atomic, pipelined, conditional; handles and ids.
#include "fixture.h"

using namespace heliograph::client;

TEST_CASE("what is put can be read back, by handle and by name") {
  Ball world;
  Transaction edit = world.scene.edit();
  edit.update(world.ball,
              Components().transform(Vec3{1, 2, 3}).attributes({{"sku", "42"}}).light_group("key"));
  const auto revision = edit.commit();
  CHECK(revision == world.scene.revision());
  CHECK(world.ball.transform()(1, 3) == 2);
  CHECK(world.scene.entity("ball").attributes().at("sku") == "42");
  CHECK(world.ball.light_group() == "key");
  CHECK(world.ball.mesh()->id() == world.mesh.id());
  CHECK(world.scene.material("paint").parameters().at("base_color").r == Approx(0.8));
}

TEST_CASE("a transaction without commit changes nothing, a refused one neither") {
  Ball world;
  const auto before = world.scene.revision();
  {
    Transaction dropped = world.scene.edit();
    dropped.entity("never", Components());
  }
  Transaction edit = world.scene.edit();
  edit.entity("new", Components());
  edit.update("missing", Components().visible(false));
  CHECK(error_of([&] { edit.commit(); }).code() == Code::kNotFound);
  CHECK(world.scene.revision() == before);
  CHECK_FALSE(world.scene.contains("new"));
  CHECK(error_of([&] { edit.commit(); }).code() == Code::kFailedPrecondition);
}

TEST_CASE("a handle denotes its object within its transaction, and outside after the commit") {
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  const Entity parent = edit.entity("", Components());  // without a name
  const Entity child = edit.entity("child", Components().parent(parent));
  CHECK(error_of([&] { (void)child.id(); }).code() == Code::kFailedPrecondition);
  Transaction other = scene.edit();
  CHECK(error_of([&] { other.entity("x", Components().parent(parent)); }).field() == "parent");
  edit.commit();
  CHECK(child.parent()->id() == parent.id());
  other.entity("x", Components().parent(parent));
  other.commit();
  CHECK(scene.entity("x").parent()->id() == parent.id());
}

TEST_CASE("instances and their poses travel packed") {
  Ball world;
  std::vector<Mat4f> poses(300, Mat4f::identity());
  Transaction edit = world.scene.edit();
  const Group group = edit.instances("bolt", poses, Components().mesh(world.mesh));
  edit.set_transforms({group[7]}, std::vector<Pose>{Vec3{0, 0, 7}});  // of this transaction
  edit.commit();
  CHECK(group.size() == 300);
  CHECK(group[7].transform()(2, 3) == 7);
  CHECK(world.scene.entity("bolt/299").id() == group[299].id());
  for (std::size_t i = 0; i < poses.size(); ++i) poses[i](0, 3) = float(i);
  Transaction move = world.scene.edit();
  move.set_transforms(group, poses);
  move.commit();
  CHECK(world.scene.transforms(group).view<Mat4f>()[123](0, 3) == 123);
  Transaction wrong = world.scene.edit();
  CHECK(error_of([&] { wrong.set_transforms(group, std::vector<Mat4f>(2)); }).field() ==
        "transforms");
  CHECK(error_of([&] { wrong.set_transforms(group, std::vector<float>(3)); }).field() ==
        "transforms");
}

TEST_CASE("pipelined transactions are applied in order, refusals are their own") {
  Ball world;
  const auto before = world.scene.revision();
  std::vector<Receipt> receipts;
  for (int i = 0; i < 600; ++i) {
    Transaction edit = world.scene.edit();
    if (i == 300)
      edit.update("missing", Components());
    else
      edit.update(world.ball, Components().transform(Vec3{double(i), 0, 0}));
    receipts.push_back(edit.commit_later());
  }
  for (int i = 0; i < 600; ++i) {
    if (i == 300) {
      CHECK(error_of([&] { receipts[300].wait(); }).code() == Code::kNotFound);
      continue;
    }
    REQUIRE(receipts[std::size_t(i)].wait() == before + std::uint64_t(i < 300 ? i + 1 : i));
  }
  CHECK(world.ball.transform()(0, 3) == 599);
}

TEST_CASE("an expected revision that is over is aborted") {
  Ball world;
  const auto before = world.scene.revision();
  Transaction first = world.scene.edit(before);
  first.advance(0.1);
  first.commit();
  Transaction second = world.scene.edit(before);
  second.advance(0.1);
  const ClientError error = error_of([&] { second.commit(); });
  CHECK(error.code() == Code::kAborted);
  CHECK(error.details().expected == before + 1);
  Transaction third = world.scene.edit();  // the numbering goes on
  third.time(2);
  third.commit();
  CHECK(world.scene.time() == 2);
}

TEST_CASE("components go back to their defaults, objects are removed") {
  Ball world;
  Transaction edit = world.scene.edit();
  edit.update("ball", Components().visible(false).transform(Vec3{1, 0, 0}));
  edit.commit();
  CHECK_FALSE(world.ball.visible());
  Transaction back = world.scene.edit();
  back.update("ball", Components().reset("visible").reset("pose"));
  back.commit();
  CHECK(world.ball.visible());
  CHECK(world.ball.transform()(0, 3) == 0);
  Transaction removal = world.scene.edit();
  removal.remove(world.ball);
  removal.prune();
  removal.commit();
  CHECK_FALSE(world.scene.contains("ball"));
  CHECK_FALSE(world.scene.contains("ball/mesh"));
}

TEST_CASE("every parameter of a material is known to the daemon by its name") {
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  for (const auto& make :
       {materials::matte, materials::plaster, materials::plastic, materials::rubber,
        materials::wood, materials::steel, materials::aluminium, materials::gold, materials::copper,
        materials::chrome, materials::glass, materials::frosted_glass, materials::marble,
        materials::skin, materials::milk})
    edit.material("", make());
  const Material full = edit.material("full", Parameters()
                                                  .specular_color(0.5)
                                                  .specular_tint(0.1)
                                                  .transmission_roughness(0.1)
                                                  .thin_walled(false)
                                                  .attenuation_color(0.9)
                                                  .attenuation_distance(1)
                                                  .medium_density(0.1)
                                                  .medium_albedo(0.5)
                                                  .medium_anisotropy(0.2)
                                                  .priority(-3)
                                                  .emission(1)
                                                  .emission_strength(2)
                                                  .two_sided_emission(true)
                                                  .unlit(false)
                                                  .alpha(0.5)
                                                  .alpha_mode(AlphaMode::kMask)
                                                  .alpha_cutoff(0.25)
                                                  .anisotropic(0.5)
                                                  .anisotropic_rotation(0.25)
                                                  .sheen(0.5)
                                                  .sheen_color(0.5)
                                                  .sheen_roughness(0.5)
                                                  .sheen_tint(0.5)
                                                  .clearcoat(0.5)
                                                  .clearcoat_roughness(0.1)
                                                  .iridescence(0.5)
                                                  .iridescence_ior(1.4)
                                                  .iridescence_thickness(300));
  edit.commit();
  CHECK(full.parameters().at("iridescence_thickness").r == 300);
  Transaction reset = scene.edit();
  reset.material("full", Parameters().reset("iridescence_thickness"));
  CHECK(error_of([&] { reset.material("full", Parameters().reset("shine")); }).field() == "shine");
  reset.commit();
  CHECK(full.parameters().at("iridescence_thickness").r == 400);
}

TEST_CASE("edits that are refused for now leave no gap, and none takes another one's number") {
  LaunchOptions options;
  options.arguments = {"--limit", "tenant_edits_per_second=1000"};
  Client own = launch(options);
  Scene scene = own.create_scene();
  Transaction all = scene.edit();  // all that fits now; then there is room for one a ms
  for (int i = 0; i < 10'000; ++i) all.advance(1);
  std::uint64_t accepted = all.commit();
  std::vector<Receipt> receipts;
  for (int i = 0; i < 1'000; ++i) {
    Transaction edit = scene.edit();
    edit.advance(1);
    receipts.push_back(edit.commit_later());
  }
  std::size_t refused = 0;
  for (Receipt& receipt : receipts) {
    try {
      const std::uint64_t revision = receipt.wait();  // CHECK would catch what it throws
      CHECK(revision == ++accepted);
    } catch (const ClientError& error) {
      ++refused;
      if (error.code() == Code::kResourceExhausted) {
        CHECK(error.details().retry_seconds > 0);
      } else {  // it was on its way behind one of those
        CHECK(error.code() == Code::kAborted);
        CHECK(error.field() == "number");
      }
    }
  }
  CHECK(accepted > 1);
  CHECK(refused > 0);
  CHECK(scene.revision() == accepted);
  CHECK(scene.time() == double(9'999 + accepted));
}
