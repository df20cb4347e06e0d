// Refusals arrive with their code, field and remedy.
#include <thread>

#include "fixture.h"

using namespace heliograph::client;

TEST_CASE("the daemon's refusals name the field and the remedy") {
  Ball world;
  Transaction edit = world.scene.edit();
  edit.material("ok", Parameters());
  edit.material("paint", Parameters().roughness(7));
  const ClientError error = error_of([&] { edit.commit(); });
  CHECK(error.code() == Code::kInvalidArgument);
  CHECK(error.field() == "edits[1].material.roughness.value");
  CHECK(contains(error.what(), "edits[1].material.roughness.value: "));
  CHECK_FALSE(error.remedy().empty());
}

TEST_CASE("an unknown name lists the nearest, a used object its users") {
  Ball world;
  const ClientError unknown = error_of([&] { (void)world.scene.entity("bal"); });
  CHECK(unknown.code() == Code::kNotFound);
  CHECK(contains(unknown.details().nearest, "ball"));
  Transaction edit = world.scene.edit();
  edit.remove("ball/mesh");
  const ClientError used = error_of([&] { edit.commit(); });
  CHECK(used.code() == Code::kFailedPrecondition);
  CHECK(used.details().users.size() == 1);
  CHECK(error_of([&] { (void)world.scene.mesh("ball"); }).code() == Code::kInvalidArgument);
}

TEST_CASE("render options are refused by name") {
  Ball world;
  const auto refused = [&](const RenderOptions& options) {
    return error_of([&] { (void)world.scene.render(world.camera, options); });
  };
  CHECK(refused(RenderOptions().planes({"detph"})).field() == "planes");
  CHECK(refused(RenderOptions().spp(0)).field() == "spp");
  CHECK(refused(RenderOptions().size(0, 8)).field() == "width");
  CHECK(refused(RenderOptions().revision(999)).code() == Code::kOutOfRange);
  CHECK(error_of([&] { (void)world.scene.render("nobody"); }).code() == Code::kNotFound);
  CHECK(error_of([&] { (void)world.scene.render("ball"); }).field() == "cameras[0]");
}

TEST_CASE("addresses that are none are refused at once, absent daemons named") {
  for (const char* address : {"", "unix:relative", "nowhere", ":80", "host:port"}) {
    INFO(address);
    CHECK(error_of([&] { connect(address); }).field() == "address");
  }
  const ClientError absent = error_of([] { connect("unix:///tmp/no-such-heliograph.sock"); });
  CHECK(absent.code() == Code::kUnavailable);
  CHECK(contains(absent.what(), "/tmp/no-such-heliograph.sock"));
}

TEST_CASE("a daemon that cannot start shows its last lines and its exit code") {
  LaunchOptions options;
  options.arguments = {"--no-such-flag"};
  const ClientError error = error_of([&] { launch(options); });
  CHECK(error.code() == Code::kUnavailable);
  REQUIRE(error.details().exit_code);
  CHECK(*error.details().exit_code != 0);
  CHECK(contains(error.what(), "no-such-flag"));
  options.program = "/no/such/program";
  CHECK(contains(error_of([&] { launch(options); }).what(), "/no/such/program"));
}

TEST_CASE("a closed client refuses, its private daemon is gone") {
  Client own = launch();
  Scene scene = own.create_scene("mine");
  own.close();
  own.close();
  CHECK(error_of([&] { (void)scene.revision(); }).code() == Code::kUnavailable);
  CHECK(error_of([&] { connect(own.address()); }).code() == Code::kUnavailable);
}

TEST_CASE("a transaction above the daemon's limit is refused alone") {
  Ball world;
  Transaction edit = world.scene.edit();
  const std::map<std::string, std::string> text{{"text", std::string(1 << 20, 'x')}};
  for (int i = 0; i < 17; ++i) edit.entity("", Components().attributes(text));
  const ClientError error = error_of([&] { edit.commit(); });
  CHECK(error.code() == Code::kResourceExhausted);
  CHECK(error.details().needed > error.details().allowed);
  Transaction next = world.scene.edit();
  next.time(1);
  next.commit();
}
