// Whole files: those of tests/assets, and with HELIOGRAPH_ASSETS=folder all that lie there. Each
// loads, or is refused by name for the right reason. And paths that try to leave the bundle.
#include <cstdlib>
#include <map>
#include <set>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

/// Files that cannot be shown, and the words that say why.
const std::map<std::string, std::string> kRefused = {
    {"points_emptyface.ply", "point clouds are not rendered"}};

void check_file(const std::filesystem::path& path) {
  INFO(path);
  const auto loaded = bundle_of(path).load();
  const auto refused = kRefused.find(path.filename());
  if (refused != kRefused.end()) {
    CHECK_THAT(refusal(loaded), Contains(refused->second));
    return;
  }
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->missing.empty());
  CHECK((loaded->image || !loaded->asset.entities.empty()));
  std::set<std::string> names;
  for (const auto* edits : {&loaded->asset.library, &loaded->asset.entities}) {
    for (const Edit& edit : *edits) {
      const auto* name = std::get_if<std::string>(&edit.target);
      if (name) CHECK(names.insert(*name).second);
    }
  }
}

u32 check_folder(const std::filesystem::path& folder) {
  const std::set<std::string> known = {".gltf", ".glb", ".obj", ".ply", ".stl", ".exr",
                                       ".hdr",  ".png", ".jpg", ".tif", ".vdb", ".nvdb"};
  u32 count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) {
    if (!known.contains(entry.path().extension())) continue;
    check_file(entry.path());
    ++count;
  }
  return count;
}

}  // namespace

TEST_CASE("files: every file of tests/assets loads or is refused for its reason") {
  CHECK(check_folder(test_assets()) >= 30);
  CHECK(check_folder(std::filesystem::path(HELIOGRAPH_SOURCE_DIR) / "examples/assets") >= 1);
}

TEST_CASE("files: every file of HELIOGRAPH_ASSETS loads or is refused for its reason") {
  const char* folder = std::getenv("HELIOGRAPH_ASSETS");
  if (!folder) return;
  CHECK(check_folder(folder) > 0);
}

TEST_CASE("files: volumes have their density") {
  const auto grid = [](const std::string& name) {
    const auto loaded = bundle_of(test_assets() / "volume" / name).load();
    INFO((loaded ? "" : loaded.error().message));
    REQUIRE(loaded);
    return library_item<PutVolume>(*loaded).density;
  };
  for (const char* name : {"sphere.vdb", "torus.nvdb"}) {
    const auto density = grid(name);
    INFO(name << " " << density->bricks.size() << " " << density->lower.x << " " << density->upper.x
              << " " << density->object_from_voxel[0][0]);
    CHECK(density->bricks.size() > 0);
    CHECK(std::ranges::max(density->values.span()) <= 1);
  }
  CHECK_THAT(refusal(TestBundle().add("a.vdb", "not a volume").load()), Contains("not a VDB file"));
  auto bytes = read_file(test_assets() / "volume/torus.nvdb");
  bytes.resize(bytes.size() / 2);
  CHECK_THAT(refusal(TestBundle().add("a.nvdb", bytes).load()), Contains("truncated"));
}

TEST_CASE("files: the fox has its bones, its clips and its size") {
  const auto loaded = bundle_of(test_assets() / "gltf/Fox.glb").load();
  REQUIRE(loaded);
  CHECK(loaded->asset.animations.size() == 3);
  CHECK(loaded->asset.animations[1].name == "Walk");
  const PutEntity& fox = entity_named(*loaded, "fox.skin");
  CHECK((*fox.skin)->joints.size() == 24);
  CHECK(loaded->bounds_max.z == Approx(78.9).epsilon(0.01));  // it stands up
}

TEST_CASE("files: names repeat in a file, not in an asset") {
  const auto loaded =
      TestBundle()
          .add("a.gltf", R"({"asset":{"version":"2.0"},"nodes":[{"name":"x"},{"name":"x"},)"
                         R"({"name":"x/y"},{"name":"z_up"},{}]})")
          .load();
  REQUIRE(loaded);
  CHECK_NOTHROW(entity_named(*loaded, "x_2"));
  CHECK_NOTHROW(entity_named(*loaded, "x_y"));
  CHECK_NOTHROW(entity_named(*loaded, "z_up_2"));
  CHECK_NOTHROW(entity_named(*loaded, "node_4"));
}

TEST_CASE("paths: what leaves the bundle is refused in the same words, there or not") {
  const auto uri = [](const std::string& text) {
    return refusal(
        TestBundle()
            .add("dir/a.gltf", R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":1,)"
                               R"("uri":")" +
                                   text + R"("}]})")
            .load());
  };
  const std::string there = uri("../../etc/passwd");
  CHECK_THAT(there, Contains("inside the bundle"));
  for (const char* path :
       {"../../no/such/file", "/etc/passwd", "%2e%2e/%2e%2e/etc/passwd", "%2Fetc%2Fpasswd",
        "file:///etc/passwd", "FILE:/etc/passwd", "http://localhost/a", "C:\\\\boot.ini", "a%00b",
        "x/../../../y", "", ".."}) {
    INFO(path);
    CHECK(uri(path) == there);
  }
  CHECK_THAT(uri("a%zz"), Contains("hexadecimal"));
  CHECK_THAT(uri("data:nothing"), Contains("data URI"));
  CHECK_THAT(uri("data:;base64,A"), Contains("truncated"));
  CHECK_THAT(uri("data:;base64,AA=="), !Contains("base64"));
  // Inside the bundle, a way up is a way.
  const auto inside = TestBundle()
                          .add("dir/a.gltf", R"({"asset":{"version":"2.0"},"buffers":[)"
                                             R"({"byteLength":1,"uri":"../b%20c.bin"}]})")
                          .add("b c.bin", "x")
                          .load();
  CHECK(refusal(inside) == "");
}

TEST_CASE("paths: a bundle's own paths are clean") {
  using namespace std::string_literals;
  for (const std::string& path :
       {""s, "/a.ply"s, "../a.ply"s, "b/../a.ply"s, "./a.ply"s, "a//b.ply"s, "file:a.ply"s,
        "a\0b.ply"s, std::string(5000, 'a')}) {
    CHECK_THAT(refusal(TestBundle().add(path, "ply\n").load()), Contains("files[0].path"));
  }
  CHECK_THAT(refusal(TestBundle().add("a.ply", "x").add("a.ply", "y").load()), Contains("twice"));
  CHECK_THAT(refusal(load_asset({}, {})), Contains("empty"));
}

TEST_CASE("files: formats that are not on the list are refused by name") {
  for (const char* name : {"a.blend", "a.lwo", "a.usd", "a.abc", "noextension"}) {
    CHECK_THAT(refusal(TestBundle().add(name, "x").load()), Contains("12 "));
  }
}

TEST_CASE("files: of a model of an odd size it is told what was assumed") {
  const auto warnings = [](const std::string& name, std::string_view text) {
    const auto loaded = TestBundle().add(name, text).load();
    INFO(refusal(loaded));
    REQUIRE(loaded);
    return loaded->warnings;
  };
  const std::string large = "the model is 5e+03 m across: a unit was taken as 1 m, and ";
  const std::string remedy = " as up, unless given; units= and up= say others";
  CHECK(warnings("a.off", "OFF\n3 1 0\n0 0 0\n5000 0 0\n0 5000 0\n3 0 1 2\n") ==
        std::vector{large + "+Z" + remedy});
  CHECK(warnings("a.x",
                 "xof 0303txt 0032\n"
                 "Mesh m { 3; 0;0;0;, 5000;0;0;, 0;5000;0;; 1; 3;0,1,2;; }\n") ==
        std::vector{large + "+Y" + remedy});
}
