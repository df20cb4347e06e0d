// glTF primitives without TANGENT: which get tangents, and that they are what other programs store.
#include <string>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;

namespace {

/// Materials 0 to 5: plain; a normal map; a coat's; a normal map of the second uvs; brushed;
/// brushed with strength 0.
const std::string kMaterials =
    R"("images":[{"uri":"data:image/png;base64,iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAQAAAC1HAwCAAAAC0lEQVR42mM44QAAAdMBCaFer5cAAAAASUVORK5CYII="}],)"
    R"("textures":[{"source":0}],"materials":[{},{"normalTexture":{"index":0}},)"
    R"({"extensions":{"KHR_materials_clearcoat":{"clearcoatNormalTexture":{"index":0}}}},)"
    R"({"normalTexture":{"index":0,"texCoord":1}},)"
    R"({"extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":0.5}}},)"
    R"({"extensions":{"KHR_materials_anisotropy":{"anisotropyStrength":0}}}])";

/// Accessors 0 to 4: a quad in two halves that meet at x = 0, bent there by their normals, mirrored
/// there by their texture; the indices of each half.
GltfFile halves() {
  GltfFile file;
  file.floats("VEC3", {-1, 0, 0, -1, 1, 0, 0, 0, 0, 0, 1, 0, 1, 0, 0, 1, 1, 0});
  file.floats("VEC3", {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1});
  file.floats("VEC2", {1, 1, 1, 0, 0, 1, 0, 0, 1, 1, 1, 0});  // v runs down
  file.indices({0, 2, 3, 0, 3, 1});
  file.indices({2, 4, 5, 2, 5, 3});
  file.floats("VEC4", {0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1});
  return file;
}

constexpr const char* kAll = R"("POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"TEXCOORD_1":2)";

std::string primitive(const std::string& attributes, int indices, const std::string& more) {
  return fmt::format(R"({{"attributes":{{{}}},"indices":{}{}}})", attributes, indices, more);
}

PutMesh mesh_of(const std::string& primitives, const std::string& more = "") {
  const auto loaded =
      halves().load(fmt::format(R"("meshes":[{{"primitives":[{}]}}],"nodes":[{{"mesh":0}}],{}{})",
                                primitives, kMaterials, more));
  INFO(refusal(loaded));
  REQUIRE(loaded);
  return library_item<PutMesh>(*loaded);
}

std::size_t tangents(const std::string& primitives, const std::string& more = "") {
  return mesh_of(primitives, more).topology->tangents.size();
}

vec4 tangent(const PutMesh& mesh, std::size_t triangle, int corner) {
  return mesh.topology->tangents[mesh.topology->triangles[triangle][corner]];
}

}  // namespace

TEST_CASE("gltf: tangents are made where a material of the primitive needs them") {
  const auto count = [](int material) {
    return tangents(primitive(kAll, 4, fmt::format(R"(,"material":{})", material)));
  };
  CHECK(count(0) == 0);
  CHECK(count(1) == 6);
  CHECK(count(2) == 6);
  CHECK(count(3) == 0);
  CHECK(count(4) == 6);
  CHECK(count(5) == 0);
  CHECK(tangents(primitive(kAll, 4, "")) == 0);
  const std::string variants =
      R"(,"extensions":{"KHR_materials_variants":{"variants":[{"name":"a"},{"name":"b"}]}})";
  const auto mapped = [](int material) {
    return fmt::format(R"(,"material":0,"extensions":{{"KHR_materials_variants":{{"mappings":)"
                       R"([{{"material":5,"variants":[1]}},{{"material":{},"variants":[0]}}]}}}})",
                       material);
  };
  CHECK(tangents(primitive(kAll, 4, mapped(3)), variants) == 0);
  CHECK(tangents(primitive(kAll, 4, mapped(1)), variants) == 6);
}

TEST_CASE(
    "gltf: tangents are made where normals and texture coordinates are, and nothing deforms") {
  const std::string mapped = R"(,"material":1)";
  CHECK(tangents(primitive(R"("POSITION":0,"TEXCOORD_0":2)", 4, mapped)) == 0);
  CHECK(tangents(primitive(R"("POSITION":0,"NORMAL":1)", 4, mapped)) == 0);
  CHECK(tangents(primitive(R"("POSITION":0,"NORMAL":1,"TEXCOORD_1":2)", 4, mapped)) == 0);
  CHECK(tangents(primitive(kAll, 4, mapped + R"(,"targets":[{"POSITION":0}])")) == 0);
}

TEST_CASE("gltf: parts that share vertices share their tangents; mirrored ones are split") {
  const PutMesh mesh = mesh_of(primitive(kAll, 3, R"(,"material":0)") + "," +
                               primitive(kAll, 4, R"(,"material":1)"));
  REQUIRE(mesh.topology->triangles.size() == 4);
  CHECK(mesh.topology->vertex_count == 8);
  CHECK(mesh.vertices->normals.size() == 8);
  for (int i = 0; i < 3; ++i) {
    CHECK(tangent(mesh, 0, i) == vec4(-1, 0, 0, -1));
    CHECK(tangent(mesh, 1, i) == vec4(-1, 0, 0, -1));
    CHECK(tangent(mesh, 2, i) == vec4(1, 0, 0, 1));
    CHECK(tangent(mesh, 3, i) == vec4(1, 0, 0, 1));
  }
}

TEST_CASE("gltf: a part beside one with tangents has its own, its neighbour's stay") {
  const PutMesh mesh = mesh_of(primitive(std::string(kAll) + R"(,"TANGENT":5)", 3, "") + "," +
                               primitive(kAll, 4, ""));
  for (int i = 0; i < 3; ++i) {
    CHECK(tangent(mesh, 0, i) == vec4(0, 1, 0, 1));
    CHECK(tangent(mesh, 2, i) == vec4(1, 0, 0, 1));
  }
}

TEST_CASE("gltf: a texture transform does not turn tangents") {
  const PutMesh mesh = mesh_of(primitive(kAll, 4, R"(,"material":1)"));
  CHECK(tangent(mesh, 0, 0) == vec4(1, 0, 0, 1));
  const auto turned =
      bundle_of(test_assets() / "gltf/09_texture_transform/09_texture_transform.gltf").load();
  REQUIRE(turned);
  const PutMesh& plane = library_item<PutMesh>(*turned);
  const auto& [uvs, triangles] = std::tie(plane.topology->uvs, plane.topology->triangles);
  REQUIRE(plane.topology->tangents.size() == 4);
  for (const uvec3& t : triangles) {
    const auto& p = plane.vertices->positions;
    const vec2 ab = uvs[t.y] - uvs[t.x], ac = uvs[t.z] - uvs[t.x];
    const float area = ab.x * ac.y - ab.y * ac.x;
    const vec3 along = ((p[t.y] - p[t.x]) * ac.y - (p[t.z] - p[t.x]) * ab.y) / area;
    CHECK(glm::length(glm::normalize(along) - vec3(plane.topology->tangents[t.x])) < 1e-5f);
  }
}

TEST_CASE("gltf: tangents are those that a file stores which MikkTSpace made") {
  const auto path = test_assets() / "gltf/AnisotropyStrengthTest.glb";
  const auto stored = bundle_of(path).load();
  std::vector<std::byte> bytes = read_file(path);
  const std::string name = "\"TANGENT\"", hidden = "\"_ANGENT\"";
  const auto as_char = [](std::byte b) { return char(b); };
  for (auto at = bytes.begin();; ++at) {
    at = std::ranges::search(at, bytes.end(), name.begin(), name.end(), {}, as_char).begin();
    if (at == bytes.end()) break;
    std::ranges::transform(hidden, at, [](char c) { return std::byte(c); });
  }
  const auto made = TestBundle().add("a.glb", bytes).load();
  INFO(refusal(made));
  REQUIRE((stored && made));
  std::size_t compared = 0, without = 0;
  for (std::size_t k = 0; k < 49; ++k) {
    const PutMesh &theirs = library_item<PutMesh>(*stored, k),
                  &ours = library_item<PutMesh>(*made, k);
    REQUIRE(ours.topology->vertex_count == theirs.topology->vertex_count);
    without += ours.topology->tangents.empty();
    for (std::size_t v = 0; v < ours.topology->tangents.size(); ++v, ++compared) {
      const vec4 difference = ours.topology->tangents[v] - theirs.topology->tangents[v];
      if (glm::length(difference) > 1e-6f) FAIL_CHECK("mesh " << k << ", vertex " << v);
    }
  }
  CHECK(compared + without * 1087 == 49 * 1087);
  CHECK(compared > 40'000);
}
