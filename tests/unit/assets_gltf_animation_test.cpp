// glTF animations against arithmetic.
#include <cmath>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

Expected<Loaded> animate(const std::string& interpolation, const std::string& path,
                         const std::string& type, const std::vector<float>& times,
                         const std::vector<float>& values) {
  GltfFile file = triangle();
  file.floats("SCALAR", times);
  file.floats(type, values);
  return file.load(with_triangle(
      R"({"name":"n","mesh":0,"scale":[2,2,2]})",
      fmt::format(R"(,"animations":[{{"name":"clip","channels":[{{"sampler":0,"target":)"
                  R"({{"node":0,"path":"{}"}}}}],"samplers":[{{"input":1,"output":2,)"
                  R"("interpolation":"{}"}}]}}])",
                  path, interpolation)));
}

const PosePatch& pose_of(const Loaded& loaded) {
  return std::get<PosePatch>(loaded.asset.animations.at(0).channels.at(0).keys);
}

}  // namespace

TEST_CASE("gltf: linear channels keep their keys and the node's other components") {
  const auto loaded = animate("LINEAR", "translation", "VEC3", {0.5f, 2}, {0, 0, 0, 4, 0, 0});
  REQUIRE(loaded);
  const PosePatch& pose = pose_of(*loaded);
  CHECK(loaded->asset.animations[0].channels[0].entity == entity_index(*loaded, "n"));
  CHECK(pose.times == std::vector<Time>{0.5, 2});
  CHECK(pose.matrices[1][3] == vec3(4, 0, 0));
  CHECK(pose.matrices[1][0] == vec3(2, 0, 0));
}

TEST_CASE("gltf: a step jumps, a spline follows its Hermite curve") {
  const auto step = animate("STEP", "translation", "VEC3", {0, 1}, {1, 0, 0, 4, 0, 0});
  REQUIRE(step);
  const PosePatch& jump = pose_of(*step);
  REQUIRE(jump.times.size() == 3);
  CHECK(jump.times[1] > 0.9999);
  CHECK(jump.matrices[1][3].x == 1);
  CHECK(jump.matrices[2][3].x == 4);
  // in-tangent, value, out-tangent at each key
  const auto spline = animate("CUBICSPLINE", "translation", "VEC3", {0, 2},
                              {0, 0, 0, 0, 0, 0, 3, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0});
  REQUIRE(spline);
  const PosePatch& curve = pose_of(*spline);
  CHECK(curve.times.size() > 10);
  for (std::size_t i = 0; i < curve.times.size(); ++i) {
    const double u = curve.times[i] / 2;
    const double expected = 2 * (u * u * u - 2 * u * u + u) * 3 + (3 * u * u - 2 * u * u * u) * 1 +
                            2 * (u * u * u - u * u) * -1;
    CHECK(curve.matrices[i][3].x == Approx(expected).margin(1e-5));
  }
}

TEST_CASE("gltf: rotations become unit, a scale of 0 stays invertible") {
  const float s = std::sqrt(0.5f);
  const auto turned =
      animate("LINEAR", "rotation", "VEC4", {0, 1}, {0, 0, 0, 2, 0, 0, 2 * s, 2 * s});
  REQUIRE(turned);
  CHECK(glm::distance(pose_of(*turned).matrices[1][0], vec3(0, 2, 0)) < 1e-5f);
  const auto scaled = animate("LINEAR", "scale", "VEC3", {0, 1}, {0, 0, 0, 1, 1, 1});
  REQUIRE(scaled);
  CHECK(pose_of(*scaled).matrices[0][0].x > 0);
  CHECK_FALSE(scaled->warnings.empty());
}

TEST_CASE("gltf: pointers to properties of nodes are animated, others are named") {
  GltfFile file = triangle();
  file.floats("SCALAR", {0.5f, 2});
  file.floats("VEC3", {0, 0, 0, 4, 0, 0});
  const auto load = [&](const std::string& pointer) {
    return file.load(with_triangle(
        R"({"name":"a"},{"name":"b","mesh":0,"scale":[2,2,2]})",
        R"(,"extensionsRequired":["KHR_animation_pointer"],"animations":[{"channels":[{"sampler":0,)"
        R"("target":{"path":"pointer","extensions":{"KHR_animation_pointer":{"pointer":")" +
            pointer + R"("}}}}],"samplers":[{"input":1,"output":2}]}])"));
  };
  const auto loaded = load("/nodes/1/translation");
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  CHECK(loaded->asset.animations[0].channels[0].entity == entity_index(*loaded, "b"));
  CHECK(pose_of(*loaded).matrices[1][3] == vec3(4, 0, 0));
  CHECK(pose_of(*loaded).matrices[1][0] == vec3(2, 0, 0));
  for (const char* other : {"/materials/0/emissiveFactor", "/nodes/1/extensions/X/translation/y",
                            "/", "/nodes/translation"}) {
    const auto left = load(other);
    REQUIRE(left);
    CHECK(left->asset.animations[0].channels.empty());
    CHECK_THAT(left->warnings.at(0), Contains(other));
  }
  CHECK_THAT(refusal(load("/nodes/2/translation")), Contains("none of the 2 nodes"));
  CHECK_THAT(refusal(load("/nodes/1x/scale")), Contains("none of the 2 nodes"));
  CHECK_THAT(refusal(load("/nodes/1/weights")), Contains("no morph targets"));
}

TEST_CASE("gltf: an animated scale above a light says what becomes of it") {
  GltfFile file = triangle();
  file.floats("SCALAR", {0, 2});
  file.floats("VEC3", {1, 1, 1, 4, 4, 4});
  const auto load = [&](const std::string& path) {
    return file.load(with_triangle(
        R"({"name":"a","children":[1]},{"extensions":{"KHR_lights_punctual":{"light":0}}})",
        R"(,"extensions":{"KHR_lights_punctual":{"lights":[{"type":"point"}]}},"animations":[{)"
        R"("channels":[{"sampler":0,"target":{"node":0,"path":")" +
            path + R"("}}],"samplers":[{"input":1,"output":2}]}])"));
  };
  CHECK_THAT(load("scale")->warnings.at(0), Contains("'a'") && Contains("lights"));
  CHECK(load("translation")->warnings.empty());
}

TEST_CASE("gltf: broken animations are refused") {
  const auto refused = [](const auto&... arguments) { return refusal(animate(arguments...)); };
  const std::vector<float> two = {0, 0, 0, 1, 1, 1};
  CHECK_THAT(refused("LINEAR", "translation", "VEC3", std::vector<float>{1, 1}, two),
             Contains("strictly increase"));
  CHECK_THAT(refused("LINEAR", "translation", "VEC3", std::vector<float>{0, 1, 2}, two),
             Contains("has 6 numbers, 3 keys need 9"));
  CHECK_THAT(refused("SMOOTH", "translation", "VEC3", std::vector<float>{0, 1}, two),
             Contains("interpolation"));
  CHECK_THAT(refused("LINEAR", "colour", "VEC3", std::vector<float>{0, 1}, two), Contains("path"));
  CHECK_THAT(refused("LINEAR", "weights", "SCALAR", std::vector<float>{0, 1}, two),
             Contains("no morph targets"));
}
