// OBJ with MTL, PLY and STL: what they hold, their axes and units, and what is refused.
#include <set>

#include <algorithm>
#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

Expected<Loaded> load_text(const std::string& name, std::string_view text,
                           const LoadOptions& options = {}) {
  return TestBundle().add(name, text).load(options);
}

constexpr const char* kQuad = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

std::string little(const std::vector<float>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * 4};
}

}  // namespace

TEST_CASE("obj: polygons, negative indices, shared vertices") {
  const auto loaded = load_text("a.obj", std::string(kQuad) + "f -4 -3 -2 -1\r\nf 1 2 \\\n3\n");
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->triangles.size() == 3);
  CHECK(mesh.topology->vertex_count == 4);
  CHECK(mesh.vertices->normals.empty());
  CHECK(loaded->asset.name == "a");
  CHECK(area(*loaded) == Approx(1.5));
}

TEST_CASE("obj: a concave polygon is cut into triangles that cover it once") {
  // An arrow whose fan from the first corner would leave the polygon.
  const auto loaded =
      load_text("a.obj", "v 0 0 0\nv 4 0 0\nv 4 4 0\nv 3 1 0\nv 0 1 0\nf 1 2 3 4 5\n");
  REQUIRE(loaded);
  CHECK(library_item<PutMesh>(*loaded).topology->triangles.size() == 3);
  CHECK(area(*loaded) == Approx(5.5));  // shoelace
}

TEST_CASE("obj: corners with different texture coordinates or normals are different vertices") {
  const auto loaded = load_text(
      "a.obj",
      std::string(kQuad) +
          "vt 0 0\nvt 1 0.25\nvn 0 0 2\nvn 1 0 0\nf 1/1/1 2/2/1 3/1/1\nf 1/2/2 3//1 4/1/1\n"
          "f 1 3 2\n");
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->vertex_count == 9);
  CHECK(mesh.vertices->normals[0] == vec3(0, 0, 1));
  CHECK(mesh.topology->uvs[1] == vec2(1, 0.25f));
  // The face without normals takes its own, which looks down.
  const uvec3 last = mesh.topology->triangles[2];
  CHECK(mesh.vertices->normals[last.x] == vec3(0, 0, -1));
}

TEST_CASE("obj: groups and materials are parts; MTL maps to parameters") {
  TestBundle bundle;
  bundle.add("dir/a.obj", std::string("mtllib sub/a.mtl\nvt 0 0\n") + kQuad +
                              "g left\nusemtl red\nf 1/1 2/1 3/1\ng right\nusemtl shiny\n"
                              "f 1/1 3/1 4/1\n");
  TestBundle without = bundle;
  bundle.add("dir/sub/a.mtl",
             "newmtl red\nKd 0.5 0.25 0\nNs 0\nKs 0.5 0.5 0.5\nd 0.5\n"
             "map_Kd -s 2 3 1 -o 0.5 0 0 ../orm.png\nnewmtl shiny\nPr 0.1\nPm 1\nKe 1 2 3\nNi 1.3\n"
             "newmtl unused\nmap_Kd nowhere.png\n");
  CHECK(without.load()->missing == std::vector<std::string>{"dir/sub/a.mtl"});
  CHECK(bundle.load()->missing == std::vector<std::string>{"dir/orm.png"});
  bundle.add("dir/orm.png", read_file(test_assets() / "picture/orm.png"));
  const auto loaded = bundle.load();
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->part_names == std::vector<std::string>{"left", "right"});
  const PutMaterial& red = library_item<PutMaterial>(*loaded, 0);
  const auto value = [](const PutMaterial& m, MaterialParameter p) {
    return *m.parameters[std::size_t(p)].value;
  };
  CHECK(value(red, base_color) == vec3(0.5f, 0.25f, 0));
  CHECK(value(red, roughness).x == Approx(1));
  CHECK(value(red, specular).x == Approx(1));
  CHECK(value(red, alpha).x == 0.5f);
  CHECK(red.alpha_mode == AlphaMode::kBlend);
  const auto& use = red.parameters[std::size_t(base_color)].texture->use;
  CHECK(use.uv_transform * vec3(1, 1, 1) == vec2(2.5f, 3));
  const PutMaterial& shiny = library_item<PutMaterial>(*loaded, 1);
  CHECK(value(shiny, roughness).x == 0.1f);
  CHECK(value(shiny, metallic).x == 1);
  CHECK(value(shiny, emission) == vec3(1, 2, 3));
  CHECK(value(shiny, ior).x == 1.3f);
}

TEST_CASE("obj: a colour that is not finite is 0") {
  const auto loaded =
      load_text("a.obj", "v 0 0 0 nan 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nf 1 2 3\n");
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(library_item<PutMesh>(*loaded).topology->colors[0] == vec4(0, 1, 1, 1));
  CHECK(loaded->warnings.size() == 1);
}

TEST_CASE("obj: a face goes without the normals and texture coordinates that are not there") {
  const std::string quad = std::string(kQuad) + "vt 0.5 0.5\nvn 1 0 0\n";
  const auto loaded = load_text("a.obj", quad + "f 1/7/1 2/1/-2 3/1/0\n");
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->warnings ==
        std::vector<std::string>{"faces name vn or vt that are not there: they go without"});
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->uvs[0] == vec2(0));
  CHECK(mesh.topology->uvs[1] == vec2(0.5f));
  CHECK(mesh.vertices->normals.empty());  // flat
}

TEST_CASE("obj: a face may name vertices that come later") {
  const std::string vertices = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0.5 0.5\nvn 0 0 1\n";
  const std::string faces = "usemtl paint\nf 1/1/1 2/1/1 3/1/1\nusemtl rust\nf 1/1/1 3/1/1 4/1/1\n";
  const auto before = load_text("a.obj", vertices + faces);
  const auto after = load_text("a.obj", faces + vertices);
  INFO(refusal(after));
  REQUIRE(after);
  const PutMesh& expected = library_item<PutMesh>(*before);
  const PutMesh& mesh = library_item<PutMesh>(*after);
  CHECK(std::ranges::equal(mesh.topology->triangles, expected.topology->triangles));
  CHECK(std::ranges::equal(mesh.topology->parts, expected.topology->parts));
  CHECK(mesh.topology->part_names == expected.topology->part_names);
  CHECK(std::ranges::equal(mesh.topology->uvs, expected.topology->uvs));
  CHECK(std::ranges::equal(mesh.vertices->normals, expected.vertices->normals));
  CHECK(after->warnings == before->warnings);
  CHECK_THAT(refusal(load_text("a.obj", "f 1 2 3\nf 1 2 5\n" + vertices)),
             Contains("a.obj: line 2: vertex '5' is not one of the 4"));
}

TEST_CASE("obj: what is broken is refused with its line") {
  const auto refused = [](const std::string& text) { return refusal(load_text("a.obj", text)); };
  CHECK_THAT(refused(kQuad), Contains("no faces"));
  CHECK_THAT(refused(std::string(kQuad) + "f 1 2 5\n"), Contains("a.obj: line 5: vertex '5'"));
  CHECK_THAT(refused(std::string(kQuad) + "f 1 2 0\n"), Contains("line 5"));
  CHECK_THAT(refused(std::string(kQuad) + "f -5 2 1\n"), Contains("line 5"));
  CHECK_THAT(refused("v 0 0 nan\n"), Contains("line 1"));
  CHECK_THAT(refused("v 0 0 1e999\n"), Contains("line 1"));
  CHECK_THAT(refused("v 0 0\n"), Contains("missing"));
  CHECK_THAT(refused("cstype bezier\n"), Contains("12 ") && Contains("tessellate"));
}

TEST_CASE("up and units change the vertices, never a pose") {
  const std::string text = "v 0 0 0\nv 1 0 0\nv 0 2 0\nvn 0 0 1\nf 1//1 2//1 3//1\n";
  const auto as_is = load_text("a.obj", text);
  const auto turned = load_text("a.obj", text, {.format = "", .up = "y", .units = 0.01});
  const auto other = load_text("a.obj", text, {.format = "", .up = "x"});
  REQUIRE(as_is);
  REQUIRE(turned);
  REQUIRE(other);
  CHECK(library_item<PutMesh>(*as_is).vertices->positions[2] == vec3(0, 2, 0));
  CHECK(glm::distance(library_item<PutMesh>(*turned).vertices->positions[2], vec3(0, 0, 0.02f)) <
        1e-6f);
  CHECK(library_item<PutMesh>(*turned).vertices->normals[0] == vec3(0, -1, 0));
  CHECK(library_item<PutMesh>(*other).vertices->positions[1] == vec3(0, 0, 1));
  CHECK_FALSE(std::get<PutEntity>(turned->asset.entities[0].action).pose);
  CHECK_THAT(refusal(load_text("a.obj", text, {.format = "", .up = "w"})), Contains("up"));
  CHECK_THAT(refusal(load_text("a.obj", text, {.format = "", .up = "", .units = -1})),
             Contains("units"));
}

TEST_CASE("ply: the same mesh in ASCII and both byte orders") {
  const std::string properties =
      "element vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const auto ascii = load_text(
      "a.ply", "ply\nformat ascii 1.0\ncomment x\n" + properties +
                   "0 0 0 255 0 0\n1 0 0 0 255 0\n1 1 0 0 0 188\n0 1 0 0 0 0\n4 0 1 2 3\n");
  INFO(refusal(ascii));
  REQUIRE(ascii);
  const auto binary = [&](bool big) {
    std::string text = std::string("ply\nformat binary_") + (big ? "big" : "little") +
                       "_endian 1.0\n" + properties;
    const auto number = [&](const auto& value) {
      std::string bytes(reinterpret_cast<const char*>(&value), sizeof value);
      if (big) std::reverse(bytes.begin(), bytes.end());
      text += bytes;
    };
    const float xy[4][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 1}};
    const u8 colors[4][3] = {{255, 0, 0}, {0, 255, 0}, {0, 0, 188}, {0, 0, 0}};
    for (int i = 0; i < 4; ++i) {
      number(xy[i][0]), number(xy[i][1]), number(0.0f);
      for (u8 c : colors[i]) number(c);
    }
    number(u8(4));
    for (i32 i = 0; i < 4; ++i) number(i);
    return text;
  };
  for (const bool big : {false, true}) {
    const auto loaded = load_text("a.ply", binary(big));
    INFO(refusal(loaded));
    REQUIRE(loaded);
    const auto& a = library_item<PutMesh>(*ascii);
    const auto& b = library_item<PutMesh>(*loaded);
    CHECK(std::ranges::equal(a.vertices->positions, b.vertices->positions));
    CHECK(std::ranges::equal(a.topology->triangles, b.topology->triangles));
    CHECK(std::ranges::equal(a.topology->colors, b.topology->colors));
    CHECK(b.topology->colors[2].z == Approx(0.5029).epsilon(1e-3));  // sRGB 188
    CHECK(area(*loaded) == Approx(1));
    CHECK_THAT(refusal(load_text("a.ply", binary(big).substr(0, binary(big).size() - 1))),
               Contains("truncated"));
  }
}

TEST_CASE("ply: what the header has no words for is left out") {
  const auto loaded = load_text(
      "a.ply",
      "ply\nformat ascii 1.0\nCreated by hand\nelement vertex 3\nproperty float x\n"
      "property float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\n"
      "property uchar flags\nend_header\n0 0 0\r\n2 0 0\n0 3 0\n3 0 1 2 9 1 1 1\n3 2 1 0 0");
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(area(*loaded) == Approx(6));  // two faces of 2 x 3 / 2
  CHECK(loaded->warnings.size() == 2);
}

TEST_CASE("ply: triangle strips turn one way, end at -1 and leave out what joins them") {
  const auto strips = [](const std::string& rows, u32 count) {
    return load_text(
        "a.ply",
        fmt::format("ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float "
                    "y\nproperty float z\nelement tristrips {}\nproperty list int int "
                    "vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n{}",
                    count, rows));
  };
  for (const auto& [rows, count] : {std::pair("5 0 1 2 3 -1\n", 1u),
                                    {"7 0 1 2 -1 2 1 3\n", 1u},
                                    {"3 0 1 2\n3 2 1 3\n", 2u},
                                    {"6 0 0 1 2 3 3\n", 1u}}) {
    INFO(rows);
    const auto loaded = strips(rows, count);
    REQUIRE(loaded);
    const PutMesh& mesh = library_item<PutMesh>(*loaded);
    CHECK(mesh.topology->triangles.size() == 2);
    CHECK(area(*loaded) == Approx(1));
  }
  const auto loaded = strips("5 0 1 2 3 -1\n", 1);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  for (const uvec3& t : mesh.topology->triangles) {
    const auto& p = mesh.vertices->positions;
    CHECK(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]).z > 0);
  }
  CHECK_THAT(refusal(strips("3 0 1 9\n", 1)), Contains("index 9 is of no vertex"));
  CHECK_THAT(refusal(strips("9 0 1 2\n", 1)), Contains("a.ply"));
}

TEST_CASE("ply: what is broken is refused") {
  const auto refused = [](const std::string& body) {
    return refusal(load_text("a.ply", "ply\nformat ascii 1.0\n" + body));
  };
  const std::string vertex = "property float x\nproperty float y\nproperty float z\n";
  const std::string face = "element face 1\nproperty list uchar int vertex_indices\nend_header\n";
  const std::string one = "element vertex 1\n" + vertex;
  CHECK_THAT(refused(one + face + "0 0 0\n3 0 0 1\n"), Contains("face 0: index 1"));
  CHECK_THAT(refused(one + face + "0 0 0\n3 0 0 -1\n"), Contains("whole number"));
  CHECK_THAT(refused(one + face + "0 0 nan\n3 0 0 0\n"), Contains("vertex 0"));
  CHECK_THAT(refused(one + face + "0 0 0\n3 0 0\n"), Contains("truncated"));
  CHECK_THAT(refused("element vertex 99999999999\n" + vertex + face), Contains("8 a.ply"));
  CHECK_THAT(refused("element vertex 60000000\n" + vertex + face), Contains("truncated"));
  CHECK_THAT(refused("element vertex 1\nproperty float x\nend_header\n0\n"), Contains("x, y, z"));
  CHECK_THAT(refused("element vertex 1\nproperty quux x\nend_header\n0\n"), Contains("quux"));
  CHECK_THAT(refused("element vertex 0\n"), Contains("end_header"));
}

TEST_CASE("stl: binary and ASCII weld to the same mesh") {
  const std::vector<float> facets[2] = {{0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0},
                                        {0, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1, 0}};
  std::string binary = "solid but binary";
  binary.resize(80, ' ');
  binary += std::string("\2\0\0\0", 4);
  std::string ascii = "solid a\n";
  for (const auto& f : facets) {
    binary += little(f) + std::string(2, '\0');
    ascii += "facet normal 0 0 1\nouter loop\n";
    for (std::size_t i = 3; i < 12; i += 3) {
      ascii += fmt::format("vertex {} {} {}\n", f[i], f[i + 1], f[i + 2]);
    }
    ascii += "endloop\nendfacet\n";
  }
  for (const std::string& text : {binary, ascii + "endsolid a\n"}) {
    const auto loaded = load_text("a.stl", text);
    INFO(refusal(loaded));
    REQUIRE(loaded);
    CHECK(library_item<PutMesh>(*loaded).topology->vertex_count == 4);
    CHECK(area(*loaded) == Approx(1));
  }
  CHECK_THAT(refusal(load_text("a.stl", binary.substr(0, 150))),
             Contains("truncated") || Contains("no triangles"));
  CHECK_THAT(refusal(load_text("a.stl", "solid a\nvertex 0 0 0\nendloop\n")), Contains("not 3"));
  std::string nan = binary;
  const float bad = std::numeric_limits<float>::infinity();
  std::memcpy(nan.data() + 84 + 12, &bad, 4);
  CHECK_THAT(refusal(load_text("a.stl", nan)), Contains("facet 0"));
}
