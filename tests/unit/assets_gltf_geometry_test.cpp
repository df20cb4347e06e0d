// glTF meshes: accessors of every kind, primitive modes, parts, and what is refused.
#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

const std::vector<float> kQuad = {0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0};

std::string mesh_json(const std::string& primitives) {
  return fmt::format(R"("meshes":[{{"name":"m","primitives":[{}]}}],"nodes":[{{"mesh":0}}])",
                     primitives);
}

std::vector<uvec3> triangles(const Loaded& loaded) {
  const auto& array = library_item<PutMesh>(loaded).topology->triangles;
  return {array.begin(), array.end()};
}

/// A one-triangle document whose positions are the given accessor.
Expected<Loaded> load_positions(const std::string& accessor, const std::vector<float>& data) {
  GltfFile file;
  file.view(std::as_bytes(std::span(data)));
  file.raw(accessor);
  return file.load(mesh_json(R"({"attributes":{"POSITION":0}})"));
}

}  // namespace

TEST_CASE("gltf: lists, strips and fans give the same quad") {
  const auto load = [](u32 mode, const std::vector<u16>& indices) {
    GltfFile file;
    file.floats("VEC3", kQuad);
    file.indices(indices);
    return *file.load(
        mesh_json(fmt::format(R"({{"attributes":{{"POSITION":0}},"indices":1,"mode":{}}})", mode)));
  };
  CHECK(triangles(load(4, {0, 1, 2, 0, 2, 3})) == std::vector{uvec3(0, 1, 2), uvec3(0, 2, 3)});
  // 2.0, 3.7.2.1: p_i = {v_i, v_(i+1+i%2), v_(i+2-i%2)}
  CHECK(triangles(load(5, {0, 1, 3, 2})) == std::vector{uvec3(0, 1, 3), uvec3(1, 2, 3)});
  CHECK(triangles(load(6, {0, 1, 2, 3})) == std::vector{uvec3(1, 2, 0), uvec3(2, 3, 0)});
  // Triangles that only join strips are left out.
  CHECK(triangles(load(5, {0, 1, 3, 3, 2})).size() == 1);
}

TEST_CASE("gltf: corners beyond the last whole triangle are left out with a warning") {
  for (const bool indexed : {false, true}) {
    GltfFile file;
    file.floats("VEC3", kQuad);
    file.indices({1, 2, 3, 0, 1});
    const auto loaded = file.load(mesh_json(std::string(R"({"attributes":{"POSITION":0})") +
                                            (indexed ? R"(,"indices":1})" : "}")));
    REQUIRE(loaded);
    CHECK(triangles(*loaded) == std::vector{indexed ? uvec3(1, 2, 3) : uvec3(0, 1, 2)});
    REQUIRE(loaded->warnings.size() == 1);
    CHECK_THAT(loaded->warnings[0], Contains(indexed ? "last 2 of 5" : "last 1 of 4"));
  }
}

TEST_CASE("gltf: a buffer without data is missed where something is read from it") {
  const auto load = [](const std::string& position) {
    return TestBundle()
        .add("test.gltf", R"({"asset":{"version":"2.0"},"buffers":[{"byteLength":36}],)"
                          R"("bufferViews":[{"buffer":0,"byteLength":36}],"accessors":[)"
                          R"({"componentType":5126,"count":3,"type":"VEC3"},)"
                          R"({"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}],)" +
                              mesh_json(R"({"attributes":{"POSITION":)" + position + "}}") + "}")
        .load();
  };
  CHECK(load("0"));
  CHECK_THAT(refusal(load("1")), Contains("buffers[0].uri: is missing"));
}

TEST_CASE("gltf: points and lines are left out with a warning") {
  GltfFile file;
  file.floats("VEC3", kQuad);
  const auto loaded = file.load(mesh_json(
      R"({"attributes":{"POSITION":0},"mode":0},{"attributes":{"POSITION":0},"mode":6})"));
  REQUIRE(loaded);
  CHECK(triangles(*loaded).size() == 2);
  REQUIRE(loaded->warnings.size() == 1);
  CHECK_THAT(loaded->warnings[0], Contains("points or lines"));
}

TEST_CASE("gltf: interleaved, sparse and absent data of accessors") {
  GltfFile file;
  const std::vector<float> interleaved = {0, 0, 0, 9, 1, 0, 0, 9, 0, 1, 0};
  file.view(std::as_bytes(std::span(interleaved)), R"(,"byteStride":16)");
  const std::vector<u16> which = {2};
  const std::vector<float> moved = {5, 6, 7};
  file.view(std::as_bytes(std::span(which)));
  file.view(std::as_bytes(std::span(moved)));
  const std::string sparse =
      R"("sparse":{"count":1,"indices":{"bufferView":1,"componentType":5123},"values":{"bufferView":2}})";
  file.raw(R"({"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"})");
  file.raw(R"({"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",)" + sparse + "}");
  file.raw(R"({"componentType":5126,"count":3,"type":"VEC3",)" + sparse + "}");
  const auto positions = [&](u32 accessor) {
    const auto loaded =
        file.load(mesh_json(fmt::format(R"({{"attributes":{{"POSITION":{}}}}})", accessor)));
    REQUIRE(loaded);
    const auto& array = library_item<PutMesh>(*loaded).vertices->positions;
    return std::vector<vec3>(array.begin(), array.end());
  };
  CHECK(positions(0) == std::vector{vec3(0, 0, 0), vec3(1, 0, 0), vec3(0, 1, 0)});
  CHECK(positions(1) == std::vector{vec3(0, 0, 0), vec3(1, 0, 0), vec3(5, 6, 7)});
  CHECK(positions(2) == std::vector{vec3(0), vec3(0), vec3(5, 6, 7)});
}

TEST_CASE("gltf: normalised integers, colours, and v that runs up") {
  GltfFile file;
  file.floats("VEC3", {0, 0, 0, 1, 0, 0, 0, 1, 0});
  file.add<u16>("VEC2", 5123, {0, 65535, 65535, 0, 0, 0}, R"(,"normalized":true)");
  file.add<std::int8_t>("VEC3", 5120, {0, 0, 127, 0, 0, -128, 0, 127, 0}, R"(,"normalized":true)");
  file.add<u8>("VEC4", 5121, {255, 0, 51, 255, 0, 0, 0, 0, 255, 255, 255, 255},
               R"(,"normalized":true)");
  const auto loaded = file.load(mesh_json(
      R"({"attributes":{"POSITION":0,"TEXCOORD_0":1,"TEXCOORD_1":1,"NORMAL":2,"COLOR_0":3}})"));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->uvs[0] == vec2(0, 0));
  CHECK(mesh.topology->uvs[1] == vec2(1, 1));
  CHECK(mesh.topology->uvs1[2] == vec2(0, 1));
  CHECK(mesh.vertices->normals[0] == vec3(0, 0, 1));
  CHECK(mesh.vertices->normals[1] == vec3(0, 0, -1));  // -128 counts as -127
  CHECK(mesh.topology->colors[0].z == Approx(0.2f));
}

TEST_CASE("gltf: one mesh with its primitives as parts; a part without normals is flat") {
  GltfFile file;
  file.floats("VEC3", kQuad);
  file.floats("VEC3", {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
  file.indices({0, 1, 2});
  file.indices({0, 3, 2});
  const auto loaded =
      file.load(mesh_json(R"({"attributes":{"POSITION":0,"NORMAL":1},"indices":2,"material":0},)"
                          R"({"attributes":{"POSITION":0},"indices":3,"material":1})") +
                R"(,"materials":[{"name":"red"},{"name":"blue"}])");
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->part_names == std::vector<std::string>{"red", "blue"});
  CHECK(std::vector<u32>(mesh.topology->parts.begin(), mesh.topology->parts.end()) ==
        std::vector<u32>{0, 1});
  const uvec3 flat = mesh.topology->triangles[1];
  CHECK(mesh.vertices->normals[flat.x] == vec3(0, 0, -1));  // clockwise seen from +Z
  CHECK(mesh.vertices->positions[flat.y] == vec3(0, 1, 0));
  const PutEntity& node = entity_named(*loaded, "node_0");
  CHECK(std::get<CreatedByEdit>(node.materials->at(1)).edit == 1);
}

TEST_CASE("gltf: a part without tangents beside one with them has its own") {
  GltfFile file;
  file.floats("VEC3", kQuad);
  file.floats("VEC3", {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
  file.floats("VEC2", {0, 1, 0, 0, 1, 0, 1, 1});  // u along y, up in the picture along x
  file.floats("VEC4", {1, 0, 0, -1, 1, 0, 0, -1, 1, 0, 0, -1, 1, 0, 0, -1});
  file.indices({0, 1, 2});
  file.indices({0, 2, 3});
  const std::string given = R"({"attributes":{"POSITION":0,"NORMAL":1,"TANGENT":3},"indices":4})";
  const auto load = [&](const std::string& attributes) {
    const auto loaded = file.load(
        mesh_json(given + R"(,{"attributes":{"POSITION":0)" + attributes + R"(},"indices":5})"));
    REQUIRE(loaded);
    CHECK(loaded->warnings.empty());
    return library_item<PutMesh>(*loaded);
  };
  const auto tangent = [](const PutMesh& mesh, std::size_t triangle) {
    return mesh.topology->tangents[mesh.topology->triangles[triangle].y];
  };
  const PutMesh mesh = load(R"(,"NORMAL":1,"TEXCOORD_0":2)");
  CHECK(mesh.topology->vertex_count == 8);
  CHECK(tangent(mesh, 0) == vec4(1, 0, 0, -1));
  const vec4 own = tangent(mesh, 1);
  CHECK(vec3(own) == vec3(0, 1, 0));
  CHECK(glm::cross(vec3(0, 0, 1), vec3(own)) * own.w == vec3(1, 0, 0));
  CHECK(tangent(load(R"(,"NORMAL":1)"), 1) == vec4(0, 0, 0, 1));
  CHECK(tangent(load(R"(,"TEXCOORD_0":2)"), 1) == own);
}

TEST_CASE("gltf: normals and tangents without a direction become those of the faces") {
  constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
  GltfFile file;
  // A quad in the plane y = 0 that faces +y, and a triangle without an area.
  file.floats("VEC3", {0, 0, 0, 0, 0, 1, 1, 0, 1, 1, 0, 0, 5, 0, 0, 5, 0, 0, 5, 0, 0});
  file.floats("VEC3", {0, 0, 0, 0, 0, 0, 0, kNaN, 0, 0, 1, 0, kNaN, 0, 0, 0, 1, 0, 0, 1, 0});
  file.floats("VEC4", {1, 0, 0,    1, 0, 0, 0, 0, kNaN, 0, 0, 1, 1, 0,
                       0, 1, kNaN, 0, 0, 1, 1, 0, 0,    1, 1, 0, 0, 1});
  file.floats("VEC2", {0, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0, 0, kNaN, 0});
  file.indices({0, 1, 2, 0, 2, 3, 4, 5, 6});
  const auto loaded = file.load(mesh_json(
      R"({"attributes":{"POSITION":0,"NORMAL":1,"TANGENT":2,"TEXCOORD_0":3},"indices":4})"));
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  for (std::size_t v = 0; v < 4; ++v) {
    CAPTURE(v);
    CHECK(mesh.vertices->normals[v] == vec3(0, 1, 0));
    CHECK(mesh.topology->tangents[v] == vec4(1, 0, 0, 1));
  }
  CHECK(glm::length(mesh.vertices->normals[4]) == 1);
  CHECK(mesh.topology->uvs[6] == vec2(0, 1));
  CHECK_THAT(loaded->warnings.at(0), Contains("meshes[0]: 4 normals"));
}

TEST_CASE("gltf: colours above 1 are clamped with a warning") {
  GltfFile file;
  file.floats("VEC3", {0, 0, 0, 1, 0, 0, 0, 1, 0});
  file.floats("VEC3", {255, 0, 0.5f, 1, 1, 1, -1, 0, 0});
  const auto loaded = file.load(mesh_json(R"({"attributes":{"POSITION":0,"COLOR_0":1}})"));
  REQUIRE(loaded);
  const auto& colors = library_item<PutMesh>(*loaded).topology->colors;
  CHECK(colors[0] == vec4(1, 0, 0.5f, 1));
  CHECK(colors[2] == vec4(0, 0, 0, 1));
  CHECK_THAT(loaded->warnings.at(0), Contains("COLOR_0") && Contains("clamped"));
}

TEST_CASE("gltf: primitives that share attributes share vertices") {
  GltfFile file;
  file.floats("VEC3", kQuad);
  file.indices({0, 1, 2});
  file.indices({0, 2, 3});
  const auto loaded = file.load(mesh_json(R"({"attributes":{"POSITION":0},"indices":1},)"
                                          R"({"attributes":{"POSITION":0},"indices":2})"));
  REQUIRE(loaded);
  CHECK(library_item<PutMesh>(*loaded).topology->vertex_count == 4);
}

TEST_CASE("gltf: broken accessors are refused by name") {
  const std::vector<float> nine = {0, 0, 0, 1, 0, 0, 0, 1, 0};
  const auto accessor = [](const std::string& members) {
    return R"({"componentType":5126,"type":"VEC3",)" + members + "}";
  };
  const auto refused = [&](const std::string& members) {
    return refusal(load_positions(accessor(members), nine));
  };
  CHECK(refused(R"("bufferView":0,"count":3)").empty());
  CHECK_THAT(refused(R"("bufferView":0,"count":4)"), Contains("needs bytes 0 to 48"));
  CHECK_THAT(refused(R"("bufferView":0,"count":3,"byteOffset":4)"), Contains("needs bytes"));
  CHECK_THAT(refused(R"("bufferView":1,"count":3)"),
             Contains("accessors[0].bufferView: is 1, but there are only 1"));
  CHECK_THAT(refused(R"("bufferView":-1,"count":3)"), Contains("whole number"));
  CHECK_THAT(refused(R"("bufferView":0.5,"count":3)"), Contains("whole number"));
  CHECK_THAT(refused(R"("bufferView":0,"count":"3")"), Contains("accessors[0].count"));
  CHECK_THAT(refused(R"("bufferView":0)"), Contains("accessors[0].count: is missing"));
  // Bombs are refused before anything is allocated.
  CHECK_THAT(refused(R"("count":1000000000)"), Contains("8 test.gltf") && Contains("vertices"));
  CHECK_THAT(refused(R"("count":9007199254740992)"), Contains("8 test.gltf"));
  CHECK_THAT(refused(R"("count":1e300)"), Contains("whole number"));
  std::vector<float> bad = nine;
  bad[4] = std::numeric_limits<float>::quiet_NaN();
  CHECK_THAT(refusal(load_positions(accessor(R"("bufferView":0,"count":3)"), bad)),
             Contains("accessors[0]: element 1 is not finite"));
}

TEST_CASE("gltf: indices out of range and mismatched counts are refused") {
  GltfFile file;
  file.floats("VEC3", {0, 0, 0, 1, 0, 0, 0, 1, 0});
  file.indices({0, 1, 3});
  file.indices({0, 1});
  file.floats("VEC2", {0, 0, 1, 1});
  const auto refused = [&](const std::string& primitive) {
    return refusal(file.load(mesh_json(primitive)));
  };
  CHECK_THAT(refused(R"({"attributes":{"POSITION":0},"indices":1})"),
             Contains("meshes[0].primitives[0].indices: element 2 is 3"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":0},"indices":2})"), Contains("triangles"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":0,"TEXCOORD_0":3}})"),
             Contains("TEXCOORD_0: has 2 elements, but POSITION has 3"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":9}})"), Contains("POSITION: is 9"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":3}})"), Contains("needs 3"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":0},"mode":7})"), Contains("mode"));
  CHECK_THAT(refused(R"({"attributes":{"POSITION":0},"material":0})"), Contains("material: is 0"));
}

TEST_CASE("gltf: containers that are broken or of another version are refused") {
  const auto load = [](std::string_view text, const std::string& name = "m.gltf") {
    return refusal(TestBundle().add(name, text).load());
  };
  CHECK_THAT(load("{"), Contains("not valid JSON"));
  CHECK_THAT(load("[]"), Contains("object"));
  CHECK_THAT(load("{}"), Contains("asset: is missing"));
  CHECK_THAT(load(R"({"asset":{"version":"1.0"}})"), Contains("12 m.gltf: asset.version"));
  CHECK_THAT(load(R"({"asset":{"version":"2.0","minVersion":"2.1"}})"),
             Contains("12 m.gltf: asset.minVersion: glTF 2.1"));
  CHECK_THAT(load(R"({"asset":{"version":"2.0"},"extensionsRequired":["KHR_foo"]})"),
             Contains("12 ") && Contains("KHR_foo"));
  CHECK_THAT(load(std::string(100000, '['), "m.gltf"), Contains("not valid JSON"));
  using namespace std::string_view_literals;
  CHECK_THAT(load("glTF\x02\0\0\0\xff\0\0\0"sv, "m.glb"), Contains("truncated"));
  CHECK_THAT(load("glTF\x01\0\0\0\x0c\0\0\0"sv, "m.glb"), Contains("version 1"));
  CHECK_THAT(load("glTF\x02\0\0\0\x14\0\0\0\xff\0\0\0JSON"sv, "m.glb"), Contains("chunk"));
}
