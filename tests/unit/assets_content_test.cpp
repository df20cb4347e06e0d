// Files are read by what is in them, as far as that is to be read: another format than the name's,
// UTF-16, statements that are none, companions that nobody has.
#include <cstring>

#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

constexpr const char* kObj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
constexpr const char* kPly =
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    "property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n"
    "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
constexpr const char* kStl =
    "solid a facet normal 0 0 1 outer loop vertex 0 0 0 vertex 1 0 0 vertex 0 1 0 endloop "
    "endfacet facet normal 0 0 1 outer loop vertex 0 0 0 vertex 0 1 0 vertex -1 0 0 endloop "
    "endfacet endsolid a";

std::string warnings(const Loaded& loaded) {
  return fmt::format("{}", fmt::join(loaded.warnings, "; "));
}

std::size_t triangles(const Expected<Loaded>& loaded) {
  INFO(refusal(loaded));
  REQUIRE(loaded);
  return library_item<PutMesh>(*loaded).topology->triangles.size();
}

/// `facets` triangles, of which the header counts `counted`.
std::string binary_stl(u32 facets, u32 counted, u16 attribute = 0) {
  const float corners[] = {0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0};
  std::string out(80, ' ');
  out.append(reinterpret_cast<const char*>(&counted), sizeof counted);
  for (u32 i = 0; i < facets; ++i) {
    out.append(reinterpret_cast<const char*>(corners), sizeof corners);
    out.append(reinterpret_cast<const char*>(&attribute), sizeof attribute);
  }
  return out;
}

std::string utf16(std::string_view ascii, bool is_big) {
  std::string out = is_big ? "\xFE\xFF" : "\xFF\xFE";
  for (const char c : ascii) out += is_big ? std::string{'\0', c} : std::string{c, '\0'};
  return out;
}

vec3 base(const Loaded& loaded) {
  return library_item<PutMaterial>(loaded).parameters[std::size_t(base_color)].value.value_or(
      vec3(-1));
}

}  // namespace

TEST_CASE("content: a model by its bytes, with a warning where its name says another format") {
  const std::string binary = binary_stl(2, 2);
  for (const auto& [name, content, format, count] :
       {std::tuple{"a.obj", std::string(kPly), "ply", 1u},
        {"a.stl", std::string(kObj), "obj", 1u},
        {"a.ply", std::string(kStl), "stl", 2u},
        {"a.obj", binary, "stl", 2u},
        {"a.stlb", binary, "stl", 2u},
        {"model", std::string(kObj), "obj", 1u}}) {
    INFO(name << " is " << format);
    const auto loaded = TestBundle().add(name, content).load();
    CHECK(triangles(loaded) == count);
    CHECK_THAT(warnings(*loaded), Contains(fmt::format("the file is {}", format)));
  }
  CHECK(warnings(*TestBundle().add("a.obj", kObj).load()) == "");
  CHECK_THAT(refusal(TestBundle().add("a.txt", "nothing of a model\n").load()),
             Contains("'txt' is not one of"));
}

TEST_CASE("content: text of UTF-16 is read, companions too") {
  for (const bool is_big : {false, true}) {
    const auto loaded =
        TestBundle()
            .add("a.obj", utf16("mtllib a.mtl\nusemtl red\n" + std::string(kObj), is_big))
            .add("a.mtl", utf16("newmtl red\nKd 1 0 0\n", is_big))
            .load();
    CHECK(triangles(loaded) == 1);
    CHECK(base(*loaded) == vec3(1, 0, 0));
    CHECK(triangles(TestBundle().add("a.ply", utf16(kPly, is_big)).load()) == 1);
    CHECK(triangles(TestBundle().add("a.stl", utf16(kStl, is_big)).load()) == 2);
  }
}

TEST_CASE("content: STL with statements on one line, and what its header does not count") {
  CHECK(triangles(TestBundle().add("a.stl", kStl).load()) == 2);
  const auto fewer = TestBundle().add("a.stl", binary_stl(3, 1)).load();
  CHECK(triangles(fewer) == 1);
  CHECK_THAT(warnings(*fewer), Contains("the 2 behind them are left out"));
  const auto colored = TestBundle().add("a.stl", binary_stl(2, 2, 0x801F)).load();
  CHECK_THAT(warnings(*colored), Contains("colours of facets"));
}

TEST_CASE("content: MTL statements that are no numbers are left out by name") {
  for (const char* line : {"Kd xyz 1 0 0", "Kd spectral file.rfl 1", "Kd 1 0", "Kd nan 0 0",
                           "Kd 1,0,0", "Kd 1.0f 0 0", "Ns", "d none"}) {
    INFO(line);
    const auto loaded = TestBundle()
                            .add("a.obj", "mtllib a.mtl\nusemtl m\n" + std::string(kObj))
                            .add("a.mtl", fmt::format("newmtl m\n{}\nKe 0 1 0\n", line))
                            .load();
    CHECK(triangles(loaded) == 1);
    CHECK(base(*loaded) == vec3(0.8f));
    CHECK_THAT(warnings(*loaded), Contains("a.mtl line 2") && Contains("left out"));
  }
  const auto halo = TestBundle()
                        .add("a.obj", "mtllib a.mtl\nusemtl m\n" + std::string(kObj))
                        .add("a.mtl", "newmtl m\nd -halo 0.5\n")
                        .load();
  REQUIRE(halo);
  const auto& put = library_item<PutMaterial>(*halo);
  CHECK(put.parameters[std::size_t(alpha)].value == vec3(0.5f));
  CHECK_THAT(warnings(*halo), Contains("-halo"));
}

TEST_CASE("content: images of glTF that nobody has are done without, wherever they were") {
  const auto with_image = [](const std::string& uri) {
    return triangle().bundle(
        R"("images":[{"uri":")" + uri +
        R"("}],"textures":[{"source":0}],"materials":[{"pbrMetallicRoughness":)"
        R"({"baseColorFactor":[1,0,0,1],"baseColorTexture":{"index":0}}}],"meshes":[)"
        R"({"primitives":[{"attributes":{"POSITION":0},"material":0}]}],"nodes":[{"mesh":0}])");
  };
  for (const char* uri : {"t.png", R"(C:\\x\\t.png)", "/home/x/t.png", "file:///x/t.png",
                          "http://localhost/t.png", "t%2Epng"}) {
    INFO(uri);
    CHECK(with_image(uri).load()->missing == std::vector<std::string>{"t.png"});
    const auto without = with_image(uri).add("t.png", "").load();
    CHECK(triangles(without) == 1);
    CHECK(base(*without) == vec3(1, 0, 0));
    CHECK_THAT(warnings(*without), Contains("t.png"));
    const auto has = with_image(uri).add("t.png", read_file(test_assets() / "picture/orm.png"));
    CHECK(library_item<PutTexture>(*has.load()).image);
  }
  CHECK(triangles(with_image("").load()) == 1);
}

TEST_CASE("content: a light of glTF whose profile nobody has is left out") {
  const auto loaded =
      triangle()
          .bundle(with_triangle(R"({"mesh":0},{"extensions":{"EXT_lights_ies":{"light":0}}})",
                                R"(,"extensions":{"EXT_lights_ies":{"lights":[{"uri":"a.ies"}]}})"))
          .add("a.ies", "")
          .load();
  CHECK(triangles(loaded) == 1);
  CHECK_THAT(warnings(*loaded), Contains("a.ies"));
  for (const Edit& edit : loaded->asset.entities)
    if (const auto* put = std::get_if<PutEntity>(&edit.action)) CHECK_FALSE(put->light);
}

TEST_CASE("content: faces of PLY may come before vertices") {
  const std::string text =
      "ply\nformat ascii 1.0\nelement face 1\nproperty list uchar int vertex_indices\n"
      "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nend_header\n"
      "3 0 1 2\n0 0 0\n1 0 0\n0 1 0\n";
  CHECK(triangles(TestBundle().add("a.ply", text).load()) == 1);
}

TEST_CASE("content: OBJ colours with alpha, and comments that end with a backslash") {
  const auto loaded = TestBundle()
                          .add("a.obj",
                               "# made in C:\\\nv 0 0 0 1 0 0 0.5\nv 1 0 0 1 0 0 1\n"
                               "v 0 1 0 1 0 0 1\nf 1 2 3\n")
                          .load();
  CHECK(triangles(loaded) == 1);
  CHECK(library_item<PutMesh>(*loaded).topology->colors[0] == vec4(1, 0, 0, 1));
}

TEST_CASE("content: MTL statements that nothing reads are named") {
  const auto loaded = TestBundle()
                          .add("a.obj", "mtllib a.mtl\nusemtl m\n" + std::string(kObj))
                          .add("a.mtl", "newmtl m\nKd 1 0 0\nillum 2\nKa 1 1 1\ndecal t.png\n")
                          .load();
  CHECK(triangles(loaded) == 1);
  CHECK(warnings(*loaded) == "MTL decal is left out");
}
