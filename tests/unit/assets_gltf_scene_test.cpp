// glTF nodes, cameras, lights, instances and skins against arithmetic.
#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

bool near(const mat4x3& a, const mat4x3& b) {
  for (int c = 0; c < 4; ++c) {
    if (glm::distance(a[c], b[c]) > 1e-5f) return false;
  }
  return true;
}

}  // namespace

TEST_CASE("gltf: the root is the user's, and z_up below it turns +Y to +Z") {
  const auto loaded = triangle().load(with_triangle(
      R"({"name":"a","children":[1],"translation":[0,10,0]},{"name":"b","mesh":0,"scale":[2,2,2]})"));
  REQUIRE(loaded);
  CHECK(std::holds_alternative<std::monostate>(loaded->asset.entities[0].target));
  CHECK_FALSE(std::get<PutEntity>(loaded->asset.entities[0].action).pose);
  const PutEntity& z_up = entity_named(*loaded, "z_up");
  CHECK(z_up.pose->matrices[0] * vec4(0, 1, 0, 1) == vec3(0, 0, 1));
  CHECK(z_up.pose->matrices[0] * vec4(0, 0, 1, 1) == vec3(0, -1, 0));
  CHECK(entity_of(*loaded, *entity_named(*loaded, "b").parent) == entity_index(*loaded, "a"));
  // (0..2, 10..14, 0) in glTF is (0..2, 0, 10..14) here.
  CHECK(glm::distance(loaded->bounds_min, vec3(0, 0, 10)) < 1e-5f);
  CHECK(glm::distance(loaded->bounds_max, vec3(2, 0, 14)) < 1e-5f);
}

TEST_CASE("gltf: a matrix and its TRS are the same pose") {
  // 90 degrees about +Z, then moved.
  const auto loaded = triangle().load(with_triangle(
      R"({"name":"m","mesh":0,"matrix":[0,2,0,0,-3,0,0,0,0,0,1,0,4,5,6,1]},)"
      R"({"name":"t","mesh":0,"translation":[4,5,6],"rotation":[0,0,0.70710678,0.70710678],)"
      R"("scale":[2,3,1]})"));
  REQUIRE(loaded);
  CHECK(near(entity_named(*loaded, "m").pose->matrices[0],
             entity_named(*loaded, "t").pose->matrices[0]));
}

TEST_CASE("gltf: node graphs that are no trees are refused") {
  const auto refused = [](const std::string& nodes, const std::string& more = "") {
    return refusal(triangle().load(with_triangle(nodes, more)));
  };
  CHECK_THAT(refused(R"({"children":[0]})"), Contains("cycle"));
  CHECK_THAT(refused(R"({"children":[1]},{"children":[0]})"), Contains("cycle"));
  CHECK_THAT(refused(R"({"children":[2]},{"children":[2]},{})"), Contains("two parents"));
  CHECK_THAT(refused(R"({"children":[5]})"), Contains("nodes[0].children[0]: is 5"));
  CHECK_THAT(refused(R"({"mesh":3})"), Contains("nodes[0].mesh: is 3"));
  CHECK_THAT(refused(R"({"children":[1]},{})", R"(,"scenes":[{"nodes":[1]}])"), Contains("parent"));
  CHECK_THAT(refused(R"({"translation":[0,0]})"), Contains("3 numbers"));
  CHECK_THAT(refused(R"({"translation":[0,0,1e39]})"), Contains("too large"));
  CHECK_THAT(refused(R"({"matrix":[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]})"), Contains("last row"));
}

TEST_CASE("gltf: a rotation of length 0 turns nothing") {
  const auto loaded =
      triangle().load(with_triangle(R"({"name":"still","mesh":0,"rotation":[0,0,0,0]})"));
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->bounds_max == vec3(1, 0, 2));
  CHECK(loaded->warnings ==
        std::vector<std::string>{"nodes[0].rotation: a rotation of length 0 turns nothing"});
}

TEST_CASE("gltf: a scale of 0 across what is flat leaves it where it is") {
  for (const char* node : {R"("scale":[1,2,0])", R"("matrix":[1,0,0,0,0,2,0,0,0,0,0,0,0,0,0,1])"}) {
    CAPTURE(node);
    const auto loaded =
        triangle().load(with_triangle(R"({"name":"flat","mesh":0,)" + std::string(node) + "}"));
    REQUIRE(loaded);
    CHECK(loaded->warnings.empty());
    const PutEntity& flat = entity_named(*loaded, "flat");
    CHECK_FALSE(flat.visible);
    CHECK(flat.pose->matrices[0] * vec4(1, 2, 0, 1) == vec3(1, 4, 0));
    CHECK(flat.pose->matrices[0][2].z == Approx(2e-4f));
    CHECK(loaded->bounds_max == vec3(1, 0, 4));
  }
}

TEST_CASE("gltf: the last row of a matrix may be rounded") {
  const auto load = [](const std::string& last) {
    return triangle().load(with_triangle(
        R"({"name":"m","mesh":0,"matrix":[2,0,0,0,0,2,0,0,0,0,2,0,1,2,3,)" + last + "]}"));
  };
  REQUIRE(load("0.9999999"));
  CHECK(entity_named(*load("0.9999999"), "m").pose->matrices[0][3] == vec3(1, 2, 3));
  CHECK_THAT(refusal(load("0.999")), Contains("last row"));
}

TEST_CASE("gltf: what is hidden is not in the box") {
  const auto loaded = triangle().load(with_triangle(
      R"({"mesh":0},{"scale":[0,0,0],"children":[2]},{"mesh":0,"translation":[9,9,9]})"));
  REQUIRE(loaded);
  CHECK(glm::distance(loaded->bounds_max, vec3(1, 0, 2)) < 1e-5f);
}

TEST_CASE("gltf: a node scaled to nothing, or beyond f32, is hidden, not refused") {
  for (const char* scale : {"[0,0,0]", "[1e-11,1e-11,1e-11]", "[2e10,1e10,1e10]"}) {
    CAPTURE(scale);
    const auto loaded = triangle().load(
        with_triangle(R"({"name":"flat","mesh":0,"scale":)" + std::string(scale) + "}"));
    REQUIRE(loaded);
    CHECK(entity_named(*loaded, "flat").visible == false);
    CHECK_THAT(loaded->warnings.at(0), Contains("'flat'"));
  }
}

TEST_CASE("gltf: a model that f32 cannot hold is refused") {
  const auto loaded = triangle().load(with_triangle(
      R"({"children":[1],"translation":[3e38,0,0]},{"mesh":0,"translation":[1e38,0,0]})"));
  CHECK_THAT(refusal(loaded), Contains("f32"));
}

TEST_CASE("gltf: cameras keep their field of view") {
  const auto loaded = triangle().load(with_triangle(
      R"({"name":"p","camera":0},{"name":"o","camera":1})",
      R"(,"cameras":[{"type":"perspective","perspective":{"yfov":1.0}},)"
      R"({"type":"orthographic","orthographic":{"xmag":2,"ymag":1,"znear":0,"zfar":1}}])"));
  REQUIRE(loaded);
  const Camera p = **entity_named(*loaded, "p").camera;
  CHECK(p.width == 1920);
  CHECK(2 * std::atan(0.5 * p.height / p.fy) == Approx(1.0));
  CHECK(p.fx == Approx(p.fy));
  CHECK(p.cx == 959.5);
  const Camera o = **entity_named(*loaded, "o").camera;
  CHECK(o.projection == Projection::kOrthographic);
  CHECK(o.width / o.fx == Approx(4));
  CHECK(o.height / o.fy == Approx(2));
}

TEST_CASE("gltf: punctual lights carry their intensity over") {
  const auto loaded = triangle().load(
      with_triangle(R"({"name":"n","extensions":{"KHR_lights_punctual":{"light":0}}},)"
                    R"({"extensions":{"KHR_lights_punctual":{"light":1}}},)"
                    R"({"extensions":{"KHR_lights_punctual":{"light":2}}})",
                    R"(,"extensions":{"KHR_lights_punctual":{"lights":[)"
                    R"({"name":"bulb","type":"point","intensity":7,"color":[1,0.5,0]},)"
                    R"({"name":"torch","type":"spot","intensity":8,"spot":{"outerConeAngle":0.5}},)"
                    R"({"name":"sun","type":"directional","intensity":1000}]}})"));
  REQUIRE(loaded);
  const PutEntity& bulb = entity_named(*loaded, "bulb");
  CHECK((*bulb.light)->light.unit == LightUnit::kCandela);
  CHECK((*bulb.light)->light.intensity == 7);
  CHECK((*bulb.light)->light.shape == LightShape::kSphere);
  CHECK((*bulb.light)->light.outer_cone_angle == 0);
  CHECK_FALSE(bulb.mesh);
  CHECK((*bulb.light)->light.color == vec3(1, 0.5f, 0));
  CHECK_FALSE(*bulb.visibility & kCameraRay);
  CHECK(bulb.label->kind == LabelPatch::Kind::kValue);
  const Light& torch = (*entity_named(*loaded, "torch").light)->light;
  CHECK(torch.intensity == 8);
  CHECK(torch.outer_cone_angle == 0.5f);
  CHECK(torch.inner_cone_angle == 0);
  const PutEntity& sun = entity_named(*loaded, "sun");
  CHECK((*sun.light)->light.unit == LightUnit::kIlluminance);
  CHECK((*sun.light)->light.intensity == 1000);
  CHECK((*sun.light)->light.sun_angle == Approx(0.0093f));
  CHECK_FALSE(sun.mesh);
  CHECK(loaded->bounds_max == vec3(0));
}

TEST_CASE("gltf: EXT_lights_ies makes luminaires, whose files are linked or in the buffer") {
  const std::string ies = "IESNA:LM-63-2002\nTILT=NONE\n1 -1 1 2 1 1 2 0 0 0\n1 1 0\n0 90 0 8 {}\n";
  const auto profile = [&](const char* last) { return fmt::format(fmt::runtime(ies), last); };
  const std::string nodes =
      R"({"extensions":{"EXT_lights_ies":{"light":1,"multiplier":0.5,"color":[1,0.5,0]}}},)"
      R"({"extensions":{"EXT_lights_ies":{"light":0}}})";
  const std::string lights = R"(,"extensions":{"EXT_lights_ies":{"lights":[)"
                             R"({"uri":"lamps/a%20b.ies","name":"trough"},)"
                             R"({"bufferView":1,"mimeType":"application/x-ies-lm-63"}]}})";
  const auto bundle = [&](const std::string& embedded) {
    GltfFile file = triangle();
    file.view(std::as_bytes(std::span(embedded)));
    return file.bundle(with_triangle(nodes, lights));
  };
  TestBundle files = bundle(profile("4"));
  CHECK(files.load()->missing == std::vector<std::string>{"lamps/a b.ies"});
  const auto loaded = files.add("lamps/a b.ies", profile("2")).load();
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const LightPatch& lamp = **entity_named(*loaded, "luminaire").light;
  CHECK(lamp.light.unit == LightUnit::kProfileScale);
  CHECK(lamp.light.intensity == 0.5f);
  CHECK(lamp.light.color == vec3(1, 0.5f, 0));
  CHECK(lamp.light.shape == LightShape::kSphere);
  const LightPatch& trough = **entity_named(*loaded, "luminaire_2").light;
  CHECK(trough.light.intensity == 1);
  const auto last_candela = [&](const LightPatch& light) {
    const u32 k = std::get<CreatedByEdit>(light.profile).edit;
    const auto& image = *std::get<PutTexture>(loaded->asset.library[k].action).image;
    float value;
    std::memcpy(&value, image.texels->bytes().data() + sizeof(float), sizeof(float));
    return value;
  };
  CHECK(last_candela(lamp) == 4);
  CHECK(last_candela(trough) == 2);
  CHECK_THAT(refusal(bundle(profile("-4")).add("lamps/a b.ies", profile("2")).load()),
             Contains("EXT_lights_ies.lights[1]: line 5") && Contains("-4, below 0"));
}

namespace {

/// The pose of an entity in the scene, +Z up.
mat4x3 world_pose(const Loaded& loaded, std::size_t index) {
  mat4 pose(1);
  for (bool more = true; more;) {
    const auto& put = std::get<PutEntity>(loaded.asset.entities[index].action);
    if (put.pose) pose = mat4(put.pose->matrices[0]) * pose;
    more = put.parent.has_value();
    if (more) index = entity_of(loaded, *put.parent);
  }
  return mat4x3(pose);
}

}  // namespace

TEST_CASE("gltf: lights take the place and turn of scaled nodes, not their scale") {
  const std::string light = R"("extensions":{"KHR_lights_punctual":{"light":0}}})";
  const std::string lights =
      R"(,"extensions":{"KHR_lights_punctual":{"lights":[{"type":"spot","name":"l","spot":{}}]}})";
  const auto load = [&](const std::string& nodes) {
    const auto loaded = triangle().load(with_triangle(nodes + light, lights));
    REQUIRE(loaded);
    return world_pose(*loaded, entity_index(*loaded, "l"));
  };
  const mat4x3 plain = load(R"({"translation":[0,0,2],)");
  CHECK(near(load(R"({"translation":[0,0,2],"scale":[1,3,0.3],)"), plain));
  CHECK(near(load(R"({"translation":[0,0,2],"scale":[100,100,100],)"), plain));
  CHECK(near(load(R"({"scale":[1,1,0],"children":[1]},{)"), load("{")));
  CHECK(near(load(R"({"scale":[1,1,4],"children":[1]},{"translation":[0,0,0.5],)"), plain));
  // Turned by 45 degrees about x below a scale of 3 along y: -z leads to (0, 3, -1).
  const mat4x3 sheared = load(R"({"scale":[1,3,1],"children":[1]},)"
                              R"({"rotation":[0.38268343,0,0,0.92387953],)");
  CHECK(glm::distance(-sheared[2], glm::normalize(vec3(0, 1, 3))) < 1e-5f);
  for (int i = 0; i < 3; ++i) {
    CHECK(glm::length(sheared[i]) == Approx(1));
    CHECK(glm::dot(sheared[i], sheared[(i + 1) % 3]) == Approx(0).margin(1e-6));
  }
}

TEST_CASE("gltf: EXT_mesh_gpu_instancing makes an entity each") {
  GltfFile file = triangle();
  file.floats("VEC3", {1, 0, 0, 2, 0, 0});
  file.floats("VEC3", {1, 1, 1, 3, 3, 3});
  const std::string node =
      R"({{"name":"n","mesh":0,"extensions":{{"EXT_mesh_gpu_instancing":{{"attributes":{}}}}}}})";
  const auto loaded =
      file.load(with_triangle(fmt::format(fmt::runtime(node), R"({"TRANSLATION":1,"SCALE":2})")));
  REQUIRE(loaded);
  CHECK_FALSE(entity_named(*loaded, "n").mesh);
  const PutEntity& second = entity_named(*loaded, "n.1");
  CHECK(second.pose->matrices[0] * vec4(1, 0, 0, 1) == vec3(5, 0, 0));
  CHECK(entity_of(*loaded, *second.parent) == entity_index(*loaded, "n"));
  CHECK_THAT(refusal(file.load(
                 with_triangle(fmt::format(fmt::runtime(node), R"({"TRANSLATION":1,"SCALE":0})")))),
             Contains("another count"));
}

TEST_CASE("gltf: a skin's joints come before the mesh that follows them") {
  GltfFile file = triangle();
  file.add<u8>("VEC4", 5121, {1, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0});
  file.floats("VEC4", {2, 0, 0, 0, 1, 0, 0, 0, 1, 1, 0, 0});
  file.floats("MAT4", {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0,  0, 1,  //
                       1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, -3, 0, 1});
  const auto load = [&](const std::string& skins) {
    return file.load(R"("meshes":[{"primitives":[{"attributes":)"
                     R"({"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}]}],"nodes":[)"
                     R"({"name":"body","mesh":0,"skin":0},{"name":"hip"},)"
                     R"({"name":"knee","translation":[0,5,0]}],"skins":[)" +
                     skins + "]");
  };
  const auto loaded = load(R"({"joints":[1,2],"inverseBindMatrices":3})");
  REQUIRE(loaded);
  const std::size_t body = entity_index(*loaded, "body.skin");
  const PutEntity& shown = entity_named(*loaded, "body.skin");
  const SkinPatch& skin = **shown.skin;
  CHECK_FALSE(entity_named(*loaded, "body").mesh);
  for (const Ref& joint : skin.joints) CHECK(entity_of(*loaded, joint) < body);
  const MeshTopology& mesh = *library_item<PutMesh>(*loaded).topology;
  CHECK(mesh.joints[0].x == 1);
  CHECK(mesh.weights[0] == vec4(1, 0, 0, 0));
  CHECK(mesh.weights[2] == vec4(0.5f, 0.5f, 0, 0));
  // Vertex 0 follows the knee: 0 - 3 + 5 = 2 up; vertex 2 half of it.
  CHECK(loaded->bounds_max.z == Approx(3));
  CHECK(loaded->bounds_min.z == Approx(2));
  // The mesh's coordinates lie where the first joint's bind pose puts them.
  CHECK(entity_of(*loaded, *shown.parent) == 1);
  CHECK(shown.pose->matrices[0] == mat4x3(1));
  const auto other = load(R"({"joints":[2,1],"inverseBindMatrices":3})");
  CHECK(entity_named(*other, "body.skin").pose->matrices[0][3] == vec3(0, 5, 0));
  CHECK_THAT(refusal(load(R"({"joints":[1],"inverseBindMatrices":3})")), Contains("uses joint 1"));
  CHECK_THAT(refusal(load(R"({"joints":[1,9]})")), Contains("skins[0].joints[1]: is 9"));
  CHECK_THAT(refusal(load(R"({"joints":[]})")), Contains("joints"));
}

TEST_CASE("gltf: morph targets and their weights") {
  GltfFile file = triangle();
  file.floats("VEC3", {0, 0, 1, 0, 0, 1, 0, 0, 1});
  const auto loaded =
      file.load(R"("meshes":[{"weights":[0.25,0.5],"primitives":[{"attributes":{"POSITION":0},)"
                R"("targets":[{"POSITION":1},{"POSITION":0}]}]}],)"
                R"("nodes":[{"name":"a","mesh":0},{"name":"b","mesh":0,"weights":[1,0]}])");
  REQUIRE(loaded);
  const MeshTopology& mesh = *library_item<PutMesh>(*loaded).topology;
  CHECK(mesh.morph_count == 2);
  CHECK(mesh.morph_positions[1] == vec3(0, 0, 1));
  CHECK(mesh.morph_positions[4] == vec3(1, 0, 0));
  CHECK((*entity_named(*loaded, "a").morph_weights)->weights == std::vector<float>{0.25f, 0.5f});
  CHECK((*entity_named(*loaded, "b").morph_weights)->weights == std::vector<float>{1, 0});
}

TEST_CASE("gltf: invisible nodes hide what is below them, skinned meshes too") {
  GltfFile file = triangle();
  file.add<u8>("VEC4", 5121, {0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0});
  file.floats("VEC4", {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0});
  const auto load = [&](const char* visible) {
    return file.load(
        R"("meshes":[{"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":1,"WEIGHTS_0":2}}]}],)"
        R"("skins":[{"joints":[2]}],"nodes":[{"name":"a","children":[1],"extensions":)"
        R"({"KHR_node_visibility":{"visible":)" +
        std::string(visible) + R"(}}},{"name":"b","mesh":0,"skin":0},{"name":"hip"}])");
  };
  const auto hidden = load("false");
  REQUIRE(hidden);
  CHECK(entity_named(*hidden, "a").visible == false);
  CHECK(entity_named(*hidden, "b.skin").visible == false);
  CHECK_FALSE(entity_named(*load("true"), "b.skin").visible);
}
