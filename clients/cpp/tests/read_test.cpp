// Look-ups, read-back, queries, branches, scene files, several clients.
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <limits>

#include "fixture.h"

using namespace heliograph::client;

TEST_CASE("a scene tells its objects, counts and memory") {
  Ball world;
  CHECK(world.scene.find("ba*").size() == 2);
  CHECK(world.scene.find("ball/*").front().kind() == Kind::kMesh);
  CHECK(world.scene.counts().at("entities") == 2);
  CHECK(world.scene.memory().at("arrays") > 1000);
  CHECK(world.scene.categories().at(1) == "ball");
  CHECK_FALSE(world.scene.contains("b*"));
}

TEST_CASE("meshes, boxes and cameras come back as they were put") {
  Ball world;
  const Geometry sphere = shapes::sphere(0.5, 16);
  CHECK(world.mesh.positions().shape() == sphere.positions.shape());
  const auto there = world.mesh.indices().view<std::uint32_t>();
  const auto here = sphere.indices.view<std::uint32_t>();
  CHECK(std::equal(here.begin(), here.end(), there.begin(), there.end()));
  const auto box = world.ball.aabb();
  REQUIRE(box);
  CHECK((*box)[1].z == Approx(0.5));
  CHECK_FALSE(world.camera.aabb());
  Camera camera = Camera::from_fov(degrees(50), 64, 48);
  camera.far = 10;
  camera.shutter = {0, 0.01};
  camera.rgb_sensor.emplace().bits = 12;
  camera.depth_sensor.emplace().baseline = 0.05;
  Transaction edit = world.scene.edit();
  edit.update(world.camera, Components().camera(camera));
  edit.commit();
  const Camera back = world.camera.camera();
  CHECK(back.fx == camera.fx);
  CHECK(back.K()(1, 2) == 23.5);
  CHECK(back.far == 10);
  CHECK(back.shutter[1] == 0.01);
  CHECK(back.rgb_sensor->bits == 12);
  CHECK(back.depth_sensor->baseline == 0.05);
  CHECK(error_of([&] { (void)world.ball.camera(); }).code() == Code::kNotFound);
}

TEST_CASE("lights keep their strength and unit") {
  Ball world;
  Transaction edit = world.scene.edit();
  Light lamp = Light::of(60, Light::Unit::kLumen);
  lamp.shape = Light::Shape::kDisc;
  lamp.radius = 0.2;
  lamp.color = {1, 0.5, 0.25};
  Image picture;
  picture.texels = Array(std::vector<std::uint8_t>{0, 255}, {1, 2});
  lamp.profile = edit.texture("profile", picture);
  edit.entity("window", Components().portal({2, 1.5}));
  const Entity entity = edit.entity("lamp", Components().light(lamp).transform(Vec3{0, 0, 2}));
  edit.commit();
  const auto back = entity.light();
  REQUIRE(back);
  CHECK(back->intensity == 60);
  CHECK(back->unit == Light::Unit::kLumen);
  CHECK(back->color.b == 0.25);
  CHECK(*back->radius == Approx(0.2));
  CHECK(back->profile->handle().id() == world.scene.texture("profile").id());
  CHECK_FALSE(back->texture);
  CHECK_FALSE(world.ball.light());
  CHECK(world.scene.entity("window").portal()->height == 1.5);
}

TEST_CASE("rays, picks, visibility, overlaps and samples") {
  Ball world;
  const std::size_t count = 70000;  // more than one message
  const std::vector<std::array<float, 3>> origins(count, {0, -3, 0});
  std::vector<std::array<float, 3>> ways(count, {0, 2, 0});
  ways.back() = {0, -1, 0};
  const Columns hits = world.scene.cast_rays(origins, ways);
  const auto t = hits.view<float>("t");
  CHECK(t.size() == count);
  CHECK(t[69998] == Approx(2.5).margin(0.02));
  CHECK(std::isinf(t[69999]));
  CHECK(hits.view<std::uint64_t>("entity")[0] == world.ball.id());

  const Columns picked =
      world.scene.pick(world.camera, std::vector<std::array<float, 2>>{{31.5f, 23.5f}, {0, 0}});
  CHECK(picked.view<std::uint64_t>("entity")[0] == world.ball.id());
  CHECK(picked.view<std::uint64_t>("entity")[1] == 0);
  CHECK(world.scene.visible(world.camera, {world.ball}).view<std::uint8_t>("visible")[0] == 1);
  CHECK(world.scene.overlaps({world.ball}, {"ball"}).shape() == Shape{1, 1});

  const Columns samples = world.scene.sample_surface({world.ball}, 1000, 3);
  for (const auto& [x, y, z] : samples.view<std::array<float, 3>>("position"))
    REQUIRE(std::hypot(x, y, z) == Approx(0.5).margin(0.02));
  SurfacePoints points;
  points.entities = {world.ball};
  points.primitive = samples["primitive"];
  points.barycentric = samples["barycentric"];
  const Columns tracks = world.scene.tracks(world.camera, points, std::vector<double>(70, 0.0));
  CHECK(tracks["image"].shape() == Shape{1000, 70, 2});
  CHECK(error_of([&] { (void)world.scene.cast_rays(origins, Array()); }).field() == "directions");
  CHECK(error_of([&] { (void)hits["tt"]; }).code() == Code::kNotFound);
}

TEST_CASE("a branch goes its own way; handles serve it by their ids") {
  Ball world;
  Scene branch = world.scene.branch();
  Transaction edit = branch.edit();
  edit.update(world.ball, Components().transform(Vec3{5, 0, 0}));
  edit.commit();
  CHECK(branch.entity("ball").transform()(0, 3) == 5);
  CHECK(world.ball.transform()(0, 3) == 0);
  CHECK(world.scene.branch("", 0).find().empty());  // before the first edit
}

TEST_CASE("a scene file gives the same bytes again") {
  Ball world;
  const auto folder = std::filesystem::temp_directory_path();
  const std::string path = (folder / ("heliograph-" + std::to_string(world.scene.id()))).string();
  world.scene.save(path);
  const Scene loaded = client().load_scene(path);
  const auto options = RenderOptions().spp(4);
  const auto a = world.scene.render("camera", options).plane<float>("beauty");
  const auto b = Scene(loaded).render("camera", options).plane<float>("beauty");
  CHECK(std::equal(a.begin(), a.end(), b.begin(), b.end()));
  std::filesystem::resize_file(path, 40);
  CHECK(error_of([&] { client().load_scene(path); }).field() == "path");
  std::filesystem::remove(path);
  CHECK(error_of([&] { client().load_scene(path); }).code() == Code::kNotFound);
  CHECK(error_of([&] { world.scene.save("/no/such/folder/x"); }).field() == "path");
}

TEST_CASE("two clients edit one shared scene, each under numbers of its own") {
  Client other = connect(client().address());
  Scene shared = client().create_scene("shared", Lifetime::kDaemon);
  Scene opened = other.open_scene("shared");
  Transaction edit = opened.edit();
  edit.entity("from the other", Components());
  edit.commit();
  CHECK(shared.contains("from the other"));
  Transaction own = shared.edit();  // each client numbers its own edits
  own.entity("from here", Components());
  own.commit();
  CHECK(opened.contains("from here"));
  CHECK(error_of([&] { other.open_scene("sharde"); }).code() == Code::kNotFound);
  shared.remove();
  CHECK(error_of([&] { (void)opened.revision(); }).code() == Code::kNotFound);
}

TEST_CASE("a private scene is deleted with its last handle") {
  const std::size_t before = client().scenes().size();
  Entity left;
  {
    Ball world;
    left = world.ball;
    CHECK(client().scenes().size() == before + 1);
  }
  CHECK(left.visible());
  left = Entity();
  CHECK(client().scenes().size() == before);
}

TEST_CASE("the daemon tells of itself") {
  const ServerInfo info = client().info();
  CHECK((info.min_api == 1 && info.max_api == 1));
  CHECK(info.limits.at("message_bytes") == 16 << 20);
  CHECK(info.threads > 0);
}
