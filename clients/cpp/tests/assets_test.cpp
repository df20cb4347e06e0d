// Files: models, pictures, and their refusals.
#include <cmath>
#include <filesystem>
#include <fstream>

#include "fixture.h"

using namespace heliograph::client;

namespace {

const std::string kAssets = HELIOGRAPH_SOURCE_DIR "/tests/assets/";

}  // namespace

TEST_CASE("a model is decoded once and placed several times") {
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  Placement placement;
  placement.category = "fox";
  ImportOptions twice;
  twice.count = 2;
  const Asset fox = edit.import_file(kAssets + "gltf/Fox.glb", placement, twice);
  placement.transform = Vec3{3, 0, 0};
  placement.animation = fox.animations().front();
  const Entity third = edit.instance(fox, "third", placement);
  edit.commit();
  CHECK(fox.roots().size() == 3);
  CHECK(fox.root().name() == "Fox/0");
  CHECK(third.transform()(0, 3) == 3);
  CHECK(fox.entities().size() > 20);
  const Material fur = fox.material(fox.materials().front());
  CHECK(fur.parameters().count("roughness") == 1);
  CHECK(scene.categories().at(1) == "fox");
  REQUIRE(fox.bounds());
  CHECK((*fox.bounds())[1].z > (*fox.bounds())[0].z);
  CHECK(fox.entities().back().id() >> 56 == std::uint64_t(Kind::kEntity));
}

TEST_CASE("companions beneath the model's folder are uploaded, names in the file are known") {
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  const Asset cube = edit.import_file(kAssets + "gltf/01_morphed_cube/01_morphed_cube.gltf");
  const ClientError error = error_of([&] { (void)cube.material("Leather"); });
  CHECK(error.code() == Code::kNotFound);
  CHECK(error.details().nearest == cube.materials());
  Placement wrong;
  wrong.animation = "no such clip";
  CHECK(error_of([&] { edit.instance(cube, "x", wrong); }).field() == "animation");
  edit.commit();
  CHECK_FALSE(scene.contains("x"));
}

TEST_CASE("pictures become textures and domes") {
  Ball world;
  Transaction edit = world.scene.edit();
  Image picture;
  picture.path = kAssets + "picture/gradient16.png";
  picture.wrap_u = Image::Wrap::kMirror;
  const Texture texture = edit.texture("gradient", picture);
  edit.material("paint", Parameters().base_color(texture));
  Dome dome;
  dome.image.path = kAssets + "picture/gradient.hdr";
  dome.rotation = Mat3::identity();
  edit.dome(dome);
  CHECK(edit.warnings().empty());
  Image infinite;
  infinite.path = kAssets + "picture/AllHalfValues.exr";
  infinite.layer = "R";
  edit.texture("infinite", infinite);
  REQUIRE(edit.warnings().size() == 2);
  CHECK(edit.warnings().front() == infinite.path +
                                       ": 2 infinite texel values became the largest "
                                       "finite one");
  edit.commit();
  const auto texels = world.scene.read({texture}, "texture.texels");
  CHECK(texels.front().shape().size() >= 2);
  const Frame frame = world.scene.render(
      world.camera, RenderOptions().spp(1).planes({"base_color", "environment_light"}));
  CHECK(frame.plane<std::array<float, 3>>("base_color")(24, 32)[0] != Approx(0.8));
  Transaction wrong = world.scene.edit();
  CHECK(error_of([&] { wrong.import_file(kAssets + "picture/gradient.hdr"); }).field() == "path");
  Image model;
  model.path = kAssets + "gltf/Fox.glb";
  CHECK(error_of([&] { wrong.texture("fox", model); }).field() == "image");
}

TEST_CASE("a model that names files outside its folder is refused") {
  const auto folder = std::filesystem::temp_directory_path() /
                      ("heliograph-model-" + std::to_string(client().create_scene().id()));
  std::filesystem::create_directories(folder / "model");
  std::ofstream(folder / "secret.bin") << "secret";
  for (const char* uri : {"../secret.bin", "/etc/hostname", "missing.bin"}) {
    INFO(uri);
    std::ofstream(folder / "model/m.gltf")
        << R"({"asset": {"version": "2.0"}, "buffers": [{"byteLength": 6, "uri": ")" << uri
        << R"("}]})";
    Scene scene = client().create_scene();
    Transaction edit = scene.edit();
    const ClientError error =
        error_of([&] { edit.import_file((folder / "model/m.gltf").string()); });
    CHECK((error.code() == Code::kInvalidArgument || error.code() == Code::kNotFound));
  }
  std::filesystem::remove_all(folder);
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  CHECK(error_of([&] { edit.import_file("/no/such/model.glb"); }).code() == Code::kNotFound);
}

TEST_CASE("a model without its texture loads, and says so") {
  const auto folder = std::filesystem::temp_directory_path() /
                      ("heliograph-texture-" + std::to_string(client().create_scene().id()));
  std::filesystem::create_directories(folder / "model");
  std::filesystem::create_directories(folder / "textures");
  std::ofstream(folder / "model/m.obj") << "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\n"
                                           "vt 0 0\nusemtl a\nf 1/1 2/1 3/1\n";
  std::ofstream(folder / "model/m.mtl") << "newmtl a\nmap_Kd ../textures/wood.png\n";
  std::filesystem::copy(kAssets + "picture/gradient16.png", folder / "textures/wood.png");
  const std::string model = (folder / "model/m.obj").string();
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  const Asset without = edit.import_file(model);
  REQUIRE(without.warnings().size() == 1);
  CHECK(without.warnings().front().find("wood.png") != std::string::npos);
  ImportOptions options;
  options.name = "again";
  options.strict = true;
  CHECK(error_of([&] { edit.import_file(model, {}, options); }).code() == Code::kNotFound);
  options.folders = {folder.string()};
  CHECK(edit.import_file(model, {}, options).warnings().empty());
  std::filesystem::create_directories(folder / "model/Materials/textures");
  std::filesystem::rename(folder / "textures/wood.png",
                          folder / "model/Materials/textures/Wood.PNG");
  options.folders = {};
  CHECK(edit.import_file(model, {}, options).warnings().empty());
  std::filesystem::remove_all(folder);
}

TEST_CASE("names of files that are no UTF-8 read as Latin-1") {
  const auto folder = std::filesystem::temp_directory_path() /
                      ("heliograph-names-" + std::to_string(client().create_scene().id()));
  std::filesystem::create_directories(folder);
  const std::string model = (folder / "m\xfcll.obj").string();
  std::ofstream(model) << "mtllib m\xfcll.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
  std::ofstream(folder / "m\xfcll.mtl") << "newmtl a\nKd 1 0 0\n";
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  const Asset asset = edit.import_file(model);
  CHECK(asset.warnings().empty());
  CHECK(asset.materials() == std::vector<std::string>{"a"});
  CHECK(edit.commit() > 0);
  CHECK(scene.contains("m\u00fcll"));
  std::filesystem::remove_all(folder);
}

TEST_CASE("volumes fill the box of their density") {
  Scene scene = client().create_scene();
  Transaction edit = scene.edit();
  Medium smoke;
  smoke.density = Array(std::vector<float>(8 * 4 * 2, 1.0f), {8, 4, 2});
  smoke.temperature = Array(std::vector<float>(4 * 2 * 1, 1000.0f), {4, 2, 1});
  smoke.voxel_size = {0.5, 0.5, 0.5};
  smoke.origin = {-2, 0, 0};
  smoke.albedo = 0.5;
  const Volume volume = edit.volume("smoke", smoke);
  edit.entity("cloud", Components().volume(volume));
  Medium wrong;
  wrong.color = Array(std::vector<float>(3), {1, 1, 1, 3});
  CHECK(error_of([&] { edit.volume("wrong", wrong); }).field() == "density");
  edit.commit();
  CHECK(scene.volume("smoke").id() == volume.id());
  const auto uses = scene.read({volume}, "uses").front().view<std::uint32_t>();
  CHECK(uses[0] == 1);
}
