// What other programs write and read, and formats do not say: each loads, as these programs have
// it, and a warning tells what was guessed.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "renderer/assets/load.h"
#include "renderer/assets/polygon.h"
#include "renderer/assets/poses.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

constexpr const char* kQuad = "v -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\n";

Expected<Loaded> load_text(const std::string& name, std::string_view text) {
  return TestBundle().add(name, text).load();
}

/// A quad of one material.
Expected<Loaded> with_mtl(const std::string& mtl, const std::string& line = "mtllib m.mtl\n",
                          const std::string& absent = "none.png") {
  return TestBundle()
      .add("m.obj", line + kQuad + "usemtl a\nf 1/1 2/1 3/1 4/1\n")
      .add("m.mtl", mtl)
      .add("t.png", read_file(test_assets() / "picture/orm.png"))
      .add(absent, "")
      .load();
}

vec3 value(const PutMaterial& m, MaterialParameter p) {
  return m.parameters[std::size_t(p)].value.value_or(vec3(-1));
}

std::string warnings(const Loaded& loaded) {
  return fmt::format("{}", fmt::join(loaded.warnings, "; "));
}

/// Signed areas of triangles, and of the polygon: equal where they cover it once, if none is < 0.
struct Cover {
  double least = 0, sum = 0, polygon = 0;
};
Cover cover_of(const std::vector<glm::dvec3>& ring) {
  std::vector<uvec3> triangles;
  assets::triangulate(ring, triangles);
  REQUIRE(triangles.size() == ring.size() - 2);
  Cover out{.polygon = assets::normal_of(ring).z};
  for (const uvec3& t : triangles) {
    const double twice = glm::cross(ring[t.y] - ring[t.x], ring[t.z] - ring[t.x]).z;
    out.least = std::min(out.least, twice);
    out.sum += twice;
  }
  return out;
}

/// Corners of a star-shaped outline about a place, with random radii.
std::vector<glm::dvec3> star(std::mt19937& random, glm::dvec3 at, double size, int corners) {
  std::uniform_real_distribution<double> radius(0.4 * size, size);
  std::vector<glm::dvec3> out;
  for (int i = 0; i < corners; ++i) {
    const double angle = 2 * std::numbers::pi * i / corners;
    out.push_back(at + radius(random) * glm::dvec3(std::cos(angle), std::sin(angle), 0));
  }
  return out;
}

}  // namespace

TEST_CASE("forgiving: lines of OBJ") {
  const auto as_square = [](const std::string& text) {
    const auto loaded = load_text("a.obj", text);
    INFO(text);
    INFO(refusal(loaded));
    REQUIRE(loaded);
    CHECK(area(*loaded) == Approx(4));
    CHECK(loaded->bounds_min == vec3(-1, -1, 0));
  };
  const std::string quad = kQuad;
  std::string returns = quad + "f 1 2 3 4\n";
  std::ranges::replace(returns, '\n', '\r');
  as_square("\xef\xbb\xbf" + quad + "f 1 2 3 4\n");
  as_square(returns);
  as_square("v -1 -1 0 # corner\nv 1 -1 0 #\nv 1 1 0\nv -1 1 0\nf 1 2 3 4 # quad\n");
  as_square(quad + "f 1/1/ 2/1/ 3/1/ 4/1/\n");
  as_square(quad + "vt nan nan\nvn -nan(ind) 1.#QNAN inf\nf 1 2 3 4\n");
  CHECK_THAT(refusal(load_text("a.obj", quad + "vt a b\nf 1 2 3\n")), Contains("line 6"));
}

TEST_CASE("forgiving: lines of MTL") {
  const auto color = [](const std::string& mtl, const std::string& line = "mtllib m.mtl\n") {
    const auto loaded = with_mtl(mtl, line);
    INFO(refusal(loaded));
    REQUIRE(loaded);
    return value(library_item<PutMaterial>(*loaded), base_color);
  };
  const vec3 red(1, 0, 0);
  CHECK(color("\xef\xbb\xbfnewmtl a\nKd 1 0 0\n") == red);
  CHECK(color("newmtl a\rKd 1 0 0\r") == red);
  CHECK(color("newmtl a\nkd 1 0 0 # red\n") == red);
  CHECK(color("newmtl a\nKd 1 0 0\nmap_Kd\n") == red);
  CHECK(color("newmtl a\nKd 1 0 0\n", "mtllib .\\m.mtl\n") == red);
  CHECK(color("newmtl a\nKd 1 0 0\n", "mtllib \"m.mtl\"\n") == red);
  CHECK(color("newmtl a\nKd 1 0 0\n", "mtllib /home/me/m.mtl\n") == red);
  CHECK(color("newmtl a\nmap_Kd t.png\n") == vec3(1));
  CHECK(color("newmtl a\n") == vec3(0.8f));
  for (const char* map :
       {"t.png", "\"t.png\"", "t.png -bm 1", "-s 1 1 1 t.png", "t.png # a picture", ".\\t.png",
        "C:\\Users\\me\\t.png", "/home/me/t.png", "file:///home/me/t.png"}) {
    INFO(map);
    const auto loaded = with_mtl(std::string("newmtl a\nmap_kd ") + map + "\n");
    INFO(refusal(loaded));
    REQUIRE(loaded);
    REQUIRE(loaded->missing.empty());
    CHECK(library_item<PutMaterial>(*loaded).parameters[std::size_t(base_color)].texture);
  }
}

TEST_CASE("forgiving: names of MTL files have spaces, or are several") {
  const auto asked = [](const std::string& names) {
    return load_text("a.obj", "mtllib " + names + "\n" + kQuad + "f 1 2 3\n")->missing;
  };
  CHECK(asked("my model.mtl") == std::vector<std::string>{"my model.mtl"});
  CHECK(asked("a.mtl b c.MTL") == std::vector<std::string>{"a.mtl", "b c.MTL"});
  CHECK(asked("../m/bl\xe4u.mtl") == std::vector<std::string>{"../m/bl\xc3\xa4u.mtl"});
}

TEST_CASE("forgiving: Tr 1 is opaque, and d goes before it") {
  const auto mode = [](const std::string& lines) {
    const auto loaded = with_mtl("newmtl a\n" + lines);
    REQUIRE(loaded);
    return std::pair(value(library_item<PutMaterial>(*loaded), alpha).x, warnings(*loaded));
  };
  CHECK(mode("Tr 1\n").first == -1);  // not set: opaque
  CHECK_THAT(mode("Tr 1\n").second, Contains("opaque"));
  CHECK(mode("d 1\nTr 1\n") == std::pair(-1.0f, std::string()));
  CHECK(mode("Tr 1\nd 0.5\n").first == 0.5f);
  CHECK(mode("Tr 0.25\n").first == 0.75f);
  CHECK_THAT(mode("d 0\n").second, Contains("invisible"));
}

TEST_CASE("forgiving: a companion that nobody has is done without") {
  CHECK(with_mtl("newmtl a\nKd 0 0 1\nmap_Kd ../x.png\n")->missing ==
        std::vector<std::string>{"../x.png"});
  const auto loaded =
      with_mtl("newmtl a\nKd 0 0 1\nmap_Kd ../x.png\n", "mtllib m.mtl\n", "../x.png");
  REQUIRE(loaded);
  CHECK(loaded->missing.empty());
  CHECK(value(library_item<PutMaterial>(*loaded), base_color) == vec3(0, 0, 1));
  CHECK_THAT(warnings(*loaded), Contains("'../x.png'") && Contains("folders="));
  const auto bare = with_mtl("", "mtllib none.mtl\n", "none.mtl");
  REQUIRE(bare);
  CHECK_THAT(warnings(*bare), Contains("none.mtl") && !Contains("defined nowhere"));
}

TEST_CASE("forgiving: without usemtl, the only material of the MTL is meant") {
  const auto loaded = TestBundle()
                          .add("m.obj", std::string("mtllib m.mtl\n") + kQuad + "f 1 2 3 4\n")
                          .add("m.mtl", "newmtl only\nKd 1 0 0\n")
                          .load();
  REQUIRE(loaded);
  CHECK(value(library_item<PutMaterial>(*loaded), base_color) == vec3(1, 0, 0));
  CHECK_THAT(warnings(*loaded), Contains("'only'"));
}

TEST_CASE("forgiving: colours of vertices are not tinted, and in [0, 1]") {
  const auto colored = [](const char* rgb) {
    std::string text;
    for (const char* p : {"-1 -1 0", "1 -1 0", "1 1 0", "-1 1 0"})
      text += fmt::format("v {} {}\n", p, rgb);
    return load_text("a.obj", text + "f 1 2 3 4\n");
  };
  const auto unit = colored("1 0.5 0.25"), bytes = colored("255 127.5 63.75");
  const auto above = colored("1.5 0 0");
  REQUIRE((unit && bytes && above));
  CHECK(value(library_item<PutMaterial>(*unit), base_color) == vec3(1));
  const vec4 expected(1, 0.21404f, 0.05088f, 1);  // IEC 61966-2-1
  for (const Loaded* loaded : {&*unit, &*bytes})
    CHECK(glm::length(library_item<PutMesh>(*loaded).topology->colors[2] - expected) < 1e-4f);
  CHECK_THAT(warnings(*bytes), Contains("255"));
  CHECK(library_item<PutMesh>(*above).topology->colors[0] == vec4(1, 0, 0, 1));
  CHECK_THAT(warnings(*above), Contains("above 1"));
}

TEST_CASE("forgiving: a normal without a direction is that of its faces") {
  const std::string wall = "v -1 0 -1\nv 1 0 -1\nv 1 0 1\nv -1 0 1\n";
  for (const char* rest :
       {"vn 0 0 0\nf 1//1 2//1 3//1 4//1\n", "vn nan nan nan\nf 1//1 2//1 3//1\n",
        "vn\t0 -1 0\nf 1//1 2//1 3//1\nf 1 3 4\n"}) {
    INFO(rest);
    const auto loaded = load_text("a.obj", wall + rest);
    REQUIRE(loaded);
    for (const vec3& normal : library_item<PutMesh>(*loaded).vertices->normals)
      CHECK(normal == vec3(0, -1, 0));
  }
}

TEST_CASE("forgiving: PLY names its texture, and faces have colours and coordinates") {
  const std::string points = "-1 -1 0\n1 -1 0\n1 1 0\n-1 1 0\n";
  const std::string head =
      "ply\nformat ascii 1.0\ncomment TextureFile t.png\nelement vertex 4\nproperty float x\n"
      "property float y\nproperty float z\nelement face 2\nproperty list uchar int "
      "vertex_indices\n";
  const auto load = [&](const std::string& text) {
    auto loaded = TestBundle()
                      .add("a.ply", text)
                      .add("t.png", read_file(test_assets() / "picture/orm.png"))
                      .load();
    INFO(refusal(loaded));
    REQUIRE(loaded);
    return std::move(*loaded);
  };
  const Loaded textured = load(head + "property list uchar float texcoord\nend_header\n" + points +
                               "3 0 1 2 6 0 0 1 0 1 1\n3 0 2 3 6 0.5 0.5 1 1 0 1\n");
  const PutMesh& mesh = library_item<PutMesh>(textured);
  CHECK(library_item<PutMaterial>(textured).parameters[std::size_t(base_color)].texture);
  CHECK(mesh.topology->vertex_count == 5);  // the first corner has two coordinates
  const uvec3 second = mesh.topology->triangles[1];
  CHECK(mesh.topology->uvs[second.x] == vec2(0.5f));
  CHECK(mesh.vertices->positions[second.z] == vec3(-1, 1, 0));
  const Loaded colored =
      load(head + "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n" +
           points + "3 0 1 2 255 0 0\n3 0 2 3 0 0 255\n");
  const PutMesh& faces = library_item<PutMesh>(colored);
  CHECK(faces.topology->colors[faces.topology->triangles[0].y] == vec4(1, 0, 0, 1));
  CHECK(faces.topology->colors[faces.topology->triangles[1].x] == vec4(0, 0, 1, 1));
  CHECK_THAT(warnings(colored), Contains("without texture coordinates"));
}

TEST_CASE("forgiving: STL is told by what is in it") {
  const float square[] = {0, 0, 1, -1, -1, 0, 1, -1, 0, 1, 1, 0};
  const auto binary = [&](std::string head, u32 count, const std::string& tail) {
    head.resize(80);
    head.append(reinterpret_cast<const char*>(&count), 4);
    for (int i = 0; i < 2; ++i) {
      head.append(reinterpret_cast<const char*>(square), sizeof square);
      head.append(2, '\0');
    }
    return load_text("a.stl", head + tail);
  };
  for (const auto& loaded : {binary("solid part", 2, "\n"), binary("solid part", 0, ""),
                             binary("part", 0, ""), binary("solid part", 2, "")}) {
    INFO(refusal(loaded));
    REQUIRE(loaded);
    CHECK(library_item<PutMesh>(*loaded).topology->triangles.size() == 2);
  }
  CHECK_THAT(warnings(*binary("part", 0, "")), Contains("counts no facets"));
  CHECK_THAT(refusal(binary("solid part", 3, "")), Contains("truncated"));
  const auto upper = load_text("a.stl",
                               "SOLID A\nFACET NORMAL 0 0 1\nOUTER LOOP\nVERTEX 0 0 0\nVERTEX 1 0 "
                               "0\nVERTEX 0 1 0\nENDLOOP\nENDFACET\nENDSOLID A\n");
  REQUIRE(upper);
  CHECK(area(*upper) == Approx(0.5));
}

TEST_CASE("forgiving: map coordinates keep their shape about the centre of the mesh") {
  std::string text;
  for (int i = 0; i < 24; ++i) {
    const double angle = 2 * std::numbers::pi * i / 24;
    text += fmt::format("v {:.6f} {:.6f} 250.789\n", 500000.123 + 0.5 * std::cos(angle),
                        4600000.456 + 0.5 * std::sin(angle));
  }
  text += "f";
  for (int i = 1; i <= 24; ++i) text += fmt::format(" {}", i);
  const auto loaded = load_text("a.obj", text + "\n");
  REQUIRE(loaded);
  CHECK(area(*loaded) == Approx(12 * 0.25 * std::sin(2 * std::numbers::pi / 24)).epsilon(1e-5));
  REQUIRE(loaded->asset.entities.size() == 2);
  const auto& put = std::get<PutEntity>(loaded->asset.entities[1].action);
  CHECK(glm::length(put.pose->matrices.front()[3] - vec3(500000.123, 4600000.456, 250.789)) < 0.3f);
  CHECK_THAT(warnings(*loaded), Contains("4600000.456"));
  CHECK(load_text("a.obj", std::string(kQuad) + "f 1 2 3 4\n")->asset.entities.size() == 1);
}

TEST_CASE("forgiving: a scale of 0 along one axis keeps a plane flat") {
  const mat4x3 turned(mat4(mat3(vec3(0, 1, 0), vec3(-1, 0, 0), vec3(0, 0, 1))));
  const mat3 flat(vec3(1, 0, 0), vec3(0, 0, 0), vec3(0, 0, 2));
  const mat3 linear = mat3(turned) * flat;
  const auto thick = assets::with_thickness(mat4x3(mat4(linear)));
  REQUIRE(thick);
  CHECK(glm::length(mat3(*thick) * vec3(1, 0, 3) - linear * vec3(1, 0, 3)) < 1e-6f);
  CHECK(glm::determinant(mat3(*thick)) > 0);
  CHECK(!assets::with_thickness(mat4x3(mat4(mat3(vec3(1, 0, 0), vec3(0), vec3(0))))));
}

TEST_CASE("forgiving: a hole that a bridge joins to the outline stays open") {
  std::vector<glm::dvec3> window;
  for (const auto& [x, y] : std::vector<std::pair<int, int>>{
           {0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}})
    window.emplace_back(x, y, 0);
  const Cover cover = cover_of(window);
  CHECK(cover.least == 0);
  CHECK(cover.sum == Approx(24));  // twice 16 - 4
  std::mt19937 random(1);
  for (int trial = 0; trial < 200; ++trial) {
    // Two holes, both joined to the same corner of the outline.
    std::vector<glm::dvec3> ring{{-9, -9, 0}, {9, -9, 0}, {9, 9, 0}, {-9, 9, 0}};
    for (const double x : {-4.0, 4.0}) {
      ring.emplace_back(-9, -9, 0);
      const glm::dvec3 centre(x, 4 + x / 2, 0);
      std::vector<glm::dvec3> hole = star(random, centre, 2, 5 + trial % 20);
      const auto nearest = std::ranges::min_element(
          hole, {}, [&](const glm::dvec3& p) { return glm::dot(p, centre - ring.front()); });
      std::ranges::rotate(hole, nearest);
      std::ranges::reverse(hole);
      hole.insert(hole.begin(), hole.back());
      ring.insert(ring.end(), hole.begin(), hole.end());
    }
    INFO(trial);
    const Cover random_cover = cover_of(ring);
    CHECK(random_cover.least >= 0);
    CHECK(random_cover.sum == Approx(random_cover.polygon));
  }
}

TEST_CASE("forgiving: a concave polygon of any size is covered once, in little time") {
  std::mt19937 random(2);
  const Cover jagged = cover_of(star(random, {0, 0, 0}, 1, 100'000));
  CHECK(jagged.least >= 0);
  CHECK(jagged.sum == Approx(jagged.polygon));
  std::vector<glm::dvec3> comb{{20'000, -1, 0}};
  for (int i = 20'000; i-- > 0;) comb.emplace_back(i + 0.5, 1, 0), comb.emplace_back(i, 0, 0);
  comb.emplace_back(0, -1, 0);
  const Cover teeth = cover_of(comb);
  CHECK(teeth.least >= 0);
  CHECK(teeth.sum == Approx(teeth.polygon));
}
