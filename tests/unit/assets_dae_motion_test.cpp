// COLLADA that moves: skins, morph targets and animations, against arithmetic; and what is refused.
#include <algorithm>
#include <cmath>

#include "renderer/assets/builder.h"
#include "renderer/scene/motion.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::assets;
using Catch::Matchers::Contains;

namespace {

Expected<Loaded> load_text(std::string_view text) { return TestBundle().add("a.dae", text).load(); }

std::string numbers(const std::string& id, const std::string& list, u32 stride = 1) {
  std::string_view rest = list;
  u32 count = 0;
  while (!rest.empty()) {
    rest.remove_prefix(std::min(rest.find_first_not_of(' '), rest.size()));
    if (rest.empty()) break;
    rest.remove_prefix(std::min(rest.find(' '), rest.size()));
    ++count;
  }
  std::string params;
  for (u32 i = 0; i < stride; ++i) params += "<param/>";
  return fmt::format(
      "<source id='{0}'><float_array id='{0}-a'>{1}</float_array><technique_common><accessor "
      "source='#{0}-a' count='{2}' stride='{3}'>{4}</accessor></technique_common></source>",
      id, list, count / stride, stride, params);
}

std::string names(const std::string& id, const std::string& list) {
  return fmt::format("<source id='{}'><Name_array>{}</Name_array></source>", id, list);
}

std::string input(const std::string& semantic, const std::string& source, u32 offset = 0) {
  return fmt::format("<input semantic='{}' source='#{}' offset='{}'/>", semantic, source, offset);
}

/// A right triangle in the plane z = 0, whose corners are at `positions`.
std::string geometry(const std::string& id, const std::string& positions = "0 0 0 1 0 0 0 1 0") {
  return fmt::format("<geometry id='{0}'><mesh>", id) + numbers(id + "-p", positions, 3) +
         numbers(id + "-n", "0 0 1", 3) +
         fmt::format(
             "<vertices id='{0}-v'>{1}</vertices><triangles count='1'>{2}{3}"
             "<p>0 0 1 0 2 0</p></triangles></mesh></geometry>",
             id, input("POSITION", id + "-p"), input("VERTEX", id + "-v"),
             input("NORMAL", id + "-n", 1));
}

struct Parts {
  std::string nodes = "<node id='n'>" + moves() + "<instance_geometry url='#g'/></node>";
  std::string animations{}, controllers{}, clips{}, geometries = geometry("g");
  std::string asset = "<up_axis>Z_UP</up_axis>";

  static std::string moves() {
    return "<translate sid='t'>1 2 3</translate><rotate sid='r'>0 0 1 0</rotate>"
           "<scale sid='s'>1 1 1</scale>";
  }
};

std::string document(const Parts& parts) {
  return "<COLLADA><asset>" + parts.asset + "</asset><library_geometries>" + parts.geometries +
         "</library_geometries><library_controllers>" + parts.controllers +
         "</library_controllers><library_animations>" + parts.animations + "</library_animations>" +
         parts.clips + "<library_visual_scenes><visual_scene id='s'>" + parts.nodes +
         "</visual_scene></library_visual_scenes><scene><instance_visual_scene url='#s'/></scene>"
         "</COLLADA>";
}

struct Keyed {
  std::string target, times, values;
  u32 width = 1;
  std::string more{}, inputs{};  // further sources and inputs of the sampler
};

std::string animation(const std::string& id, const Keyed& keyed) {
  return fmt::format("<animation id='{0}'>", id) + numbers(id + "-t", keyed.times) +
         numbers(id + "-o", keyed.values, keyed.width) + keyed.more +
         fmt::format("<sampler id='{0}-s'>", id) + input("INPUT", id + "-t") +
         input("OUTPUT", id + "-o") + keyed.inputs +
         fmt::format("</sampler><channel source='#{0}-s' target='{1}'/></animation>", id,
                     keyed.target);
}

Loaded loaded(const Parts& parts) {
  auto out = load_text(document(parts));
  INFO(refusal(out));
  REQUIRE(out);
  return std::move(*out);
}

const PosePatch& keys(const Loaded& loaded, std::size_t channel = 0, std::size_t clip = 0) {
  return std::get<PosePatch>(loaded.asset.animations.at(clip).channels.at(channel).keys);
}

/// The pose that the keys give at a time.
mat4x3 pose_at(const PosePatch& keys, double time) {
  const auto after = std::ranges::upper_bound(keys.times, time);
  if (after == keys.times.begin()) return keys.matrices.front();
  if (after == keys.times.end()) return keys.matrices.back();
  const auto next = std::size_t(after - keys.times.begin());
  const double span = keys.times[next] - keys.times[next - 1];
  return interpolate(keys.matrices[next - 1], keys.matrices[next],
                     float((time - keys.times[next - 1]) / span));
}

Loaded moved(const Keyed& keyed) { return loaded({.animations = animation("a", keyed)}); }

void check_near(const vec3& a, const vec3& b, float off = 2e-5f) {
  INFO(fmt::format("{} {} {}, not {} {} {}", a.x, a.y, a.z, b.x, b.y, b.z));
  CHECK(glm::length(a - b) < off);
}

vec3 turned(double degrees) {
  return {float(std::cos(glm::radians(degrees))), float(std::sin(glm::radians(degrees))), 0};
}

}  // namespace

TEST_CASE("dae: a node that is animated is an entity with keys") {
  const Loaded model = moved({.target = "n/t.X", .times = "0 2", .values = "1 5"});
  REQUIRE(model.asset.animations.size() == 1);
  CHECK(model.asset.animations[0].name == "a");
  CHECK(model.asset.animations[0].channels[0].entity == entity_index(model, "n"));
  CHECK(entity_named(model, "n").mesh);
  CHECK(model.warnings.empty());
  CHECK(keys(model).times == std::vector<Time>{0, 2});
  check_near(pose_at(keys(model), 0.5)[3], vec3(2, 2, 3));
  check_near(entity_named(model, "n").pose->matrices[0][3], vec3(1, 2, 3));
}

TEST_CASE("dae: channels move all of a transformation or a part of it") {
  const auto at = [](const std::string& target, const std::string& values, u32 width) {
    return pose_at(keys(moved({target, "0 1", values, width})), 1);
  };
  check_near(at("n/t", "1 2 3 7 8 9", 3)[3], vec3(7, 8, 9));
  check_near(at("n/t.Z", "3 9", 1)[3], vec3(1, 2, 9));
  check_near(at("n/t(1)", "2 9", 1)[3], vec3(1, 9, 3));
  check_near(at("n/s.Y", "1 4", 1)[1], vec3(0, 4, 0));
  check_near(at("n/r.ANGLE", "0 30", 1)[0], turned(30));
  check_near(at("n/r", "0 0 1 0 0 0 1 90", 4)[0], turned(90));
}

TEST_CASE("dae: channels of one node move it together") {
  const Loaded model = loaded({.animations = animation("x", {"n/t.X", "0 1", "0 4"}) +
                                             animation("y", {"n/t.Y", "0 0.5 1", "0 3 3"}) +
                                             animation("r", {"n/r.ANGLE", "0 1", "0 40"})});
  REQUIRE(model.asset.animations.size() == 1);
  CHECK(model.asset.animations[0].name == "animation_0");
  REQUIRE(model.asset.animations[0].channels.size() == 1);
  for (const double t : {0.0, 0.25, 0.5, 0.8, 1.0}) {
    const mat4x3 pose = pose_at(keys(model), t);
    check_near(pose[3], vec3(4 * t, 3 * std::min(2 * t, 1.0), 3), 1e-4f);
    check_near(pose[0], turned(40 * t), 1e-4f);
  }
}

TEST_CASE("dae: a turn of more than half a circle goes all the way") {
  const PosePatch turn = keys(moved({.target = "n/r.ANGLE", .times = "0 1", .values = "0 720"}));
  for (const double t : {0.1, 0.3, 0.55, 0.9})
    check_near(pose_at(turn, t)[0], turned(720 * t), 1e-4f);
}

TEST_CASE("dae: matrices are animated whole or by their columns and rows") {
  const std::string nodes =
      "<node id='n'><matrix sid='m'>1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1</matrix>"
      "<instance_geometry url='#g'/></node>";
  const auto at = [&](const Keyed& keyed) {
    return pose_at(keys(loaded({.nodes = nodes, .animations = animation("a", keyed)})), 1);
  };
  const mat4x3 whole =
      at({"n/m", "0 1", "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1 0 -1 0 4 1 0 0 5 0 0 1 6 0 0 0 1", 16});
  check_near(whole[0], vec3(0, 1, 0));
  check_near(whole[3], vec3(4, 5, 6));
  check_near(at({"n/m(3)(1)", "0 1", "2 7"})[3], vec3(1, 7, 3));
}

TEST_CASE("dae: curves between keys are followed, and steps jump") {
  const auto interpolated = [](const std::string& kind, const std::string& in,
                               const std::string& out) {
    return moved({.target = "n/t.X",
                  .times = "0 1 2",
                  .values = "0 1 0",
                  .more = names("k", kind + " " + kind + " " + kind) + numbers("i", in, 2) +
                          numbers("u", out, 2),
                  .inputs = input("INTERPOLATION", "k") + input("IN_TANGENT", "i") +
                            input("OUT_TANGENT", "u")});
  };
  // Flat tangents a third of the way: 3 u^2 - 2 u^3.
  const Loaded smooth = interpolated("BEZIER", "-0.3333333 0 0.6666667 1 1.6666667 0",
                                     "0.3333333 0 1.3333333 1 2.3333333 0");
  for (const double t : {0.1, 0.35, 0.5, 0.81})
    check_near(pose_at(keys(smooth), t)[3], vec3(3 * t * t - 2 * t * t * t, 2, 3), 1e-3f);
  const Loaded straight = interpolated("BEZIER", "-1 -1 0.6 0.6 1.6 0.4", "0.2 0.2 1.5 0.5 3 0");
  CHECK(keys(straight).times == std::vector<Time>{0, 1, 2});
  const Loaded hermite = interpolated("HERMITE", "0 0 1 0 1 0", "1 0 1 0 1 0");
  check_near(pose_at(keys(hermite), 0.25)[3], vec3(0.15625f, 2, 3), 1e-3f);
  const Loaded steps = interpolated("STEP", "0 0 0 0 0 0", "0 0 0 0 0 0");
  check_near(pose_at(keys(steps), 0.999)[3], vec3(0, 2, 3));
  check_near(pose_at(keys(steps), 1.001)[3], vec3(1, 2, 3));
}

TEST_CASE("dae: clips are cut out of the animations, and keep their times") {
  const std::string clips =
      "<library_animation_clips><animation_clip name='walk' start='1' end='2'>"
      "<instance_animation url='#a'/></animation_clip><animation_clip id='still'>"
      "<instance_animation url='#b'/></animation_clip></library_animation_clips>";
  const Loaded model = loaded({.animations = animation("a", {"n/t.X", "0 4", "0 4"}) +
                                             animation("b", {"n/t.Y", "0 1", "2 3"}),
                               .clips = clips});
  REQUIRE(model.asset.animations.size() == 2);
  CHECK(model.asset.animations[0].name == "walk");
  CHECK(model.asset.animations[1].name == "still");
  CHECK(keys(model).times == std::vector<Time>{1, 2});
  check_near(keys(model).matrices[0][3], vec3(1, 2, 3));
  check_near(keys(model).matrices[1][3], vec3(2, 2, 3));
  check_near(keys(model, 0, 1).matrices[1][3], vec3(1, 3, 3));
}

TEST_CASE("dae: what an animation moves that is not shown leaves a file as it was") {
  const std::string nodes = "<node id='n'>" + Parts::moves() +
                            "<instance_geometry url='#g'/></node><node id='lamp'>" +
                            Parts::moves() + "</node>";
  for (const char* target : {"lamp/t.X", "nobody/t.X", "n/nothing.X", "n/t.ANGLE", "n", "n/t(9)"}) {
    INFO(target);
    const Loaded model =
        loaded({.nodes = nodes, .animations = animation("a", {target, "0 1", "0 1"})});
    CHECK(model.asset.animations.empty());
    CHECK(model.asset.entities.size() == 2);
    CHECK(model.warnings == std::vector<std::string>{"COLLADA animations are left out"});
  }
  const Loaded both = loaded({.nodes = nodes,
                              .animations = animation("a", {"lamp/t.X", "0 1", "0 1"}) +
                                            animation("b", {"n/t.X", "0 1", "0 1"})});
  CHECK(both.asset.animations.size() == 1);
  REQUIRE(both.warnings.size() == 1);
  CHECK_THAT(both.warnings[0], Contains("'lamp/t.X' is left out"));
}

namespace {

const std::string kMorph = "<controller id='m'><morph source='#g' method='{}'>" +
                           names("mt", "big far") + numbers("mw", "0 0.5") + "<targets>" +
                           input("MORPH_TARGET", "mt") + input("MORPH_WEIGHT", "mw") +
                           "</targets></morph></controller>";
const std::string kTargets =
    geometry("g") + geometry("big", "0 0 0 2 0 0 0 2 0") + geometry("far", "0 0 3 1 0 3 0 1 4");

Parts morphed(const std::string& method, const std::string& animations = "") {
  return {.nodes = "<node id='n'><instance_controller url='#m'/></node>",
          .animations = animations,
          .controllers = fmt::format(fmt::runtime(kMorph), method),
          .geometries = kTargets};
}

const MorphWeights& weights(const Loaded& model) {
  return std::get<MorphWeights>(model.asset.animations.at(0).channels.at(0).keys);
}

}  // namespace

TEST_CASE("dae: morph targets are differences, and have weights of their own") {
  const Loaded model = loaded(morphed("NORMALIZED"));
  const PutMesh& mesh = library_item<PutMesh>(model);
  REQUIRE(mesh.topology->morph_count == 2);
  check_near(mesh.topology->morph_positions[1], vec3(1, 0, 0));
  check_near(mesh.topology->morph_positions[3], vec3(0, 0, 3));
  check_near(mesh.topology->morph_positions[5], vec3(0, 0, 4));
  check_near(mesh.topology->morph_normals[0], vec3(0));
  check_near(mesh.topology->morph_normals[4], vec3(0, -std::sqrt(0.5f), std::sqrt(0.5f) - 1));
  CHECK((*entity_named(model, "n").morph_weights)->weights == std::vector<float>{0, 0.5f});
  CHECK(model.warnings.empty());
  const Loaded relative = loaded(morphed("RELATIVE"));
  check_near(library_item<PutMesh>(relative).topology->morph_positions[1], vec3(2, 0, 0));
}

TEST_CASE("dae: weights are animated by the controller's name or that of their source") {
  for (const char* target : {"m/weights(0)", "m/mw(0)", "mw(0)"}) {
    INFO(target);
    const Loaded model = loaded(morphed("", animation("a", {target, "0 2", "0 1"})));
    CHECK(weights(model).times == std::vector<Time>{0, 2});
    CHECK(weights(model).weights == std::vector<float>{0, 0.5f, 1, 0.5f});
  }
  const Loaded both = loaded(morphed("", animation("a", {"mw", "0 1", "0 1 1 0", 2})));
  CHECK(weights(both).weights == std::vector<float>{0, 1, 1, 0});
}

namespace {

Parts skinned(const std::string& joints = "hip knee", const std::string& weights = "0 0 1 1 1 2",
              const std::string& source = "g") {
  return {.nodes =
              "<node id='h' name='Hip' sid='hip'><translate>0 0 5</translate>"
              "<node id='k' name='Knee' sid='knee'><translate>1 0 0</translate>"
              "<rotate sid='r'>0 0 1 0</rotate></node></node>"
              "<node id='n' name='Leg'><translate>9 9 9</translate><instance_controller url='#c'>"
              "<skeleton>#h</skeleton></instance_controller></node>"
              "<node id='h2' sid='hip'/>",
          .animations = animation("a", {"k/r.ANGLE", "0 1", "0 90"}),
          .controllers =
              "<controller id='c'><skin source='#" + source +
              "'><bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix>" +
              names("j", joints) +
              numbers("i", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 1 0 0 -1 0 1 0 0 0 0 1 0 0 0 0 1", 16) +
              numbers("w", "1 0.25 0.75") + "<joints>" + input("JOINT", "j") +
              input("INV_BIND_MATRIX", "i") + "</joints><vertex_weights count='3'>" +
              input("JOINT", "j") + input("WEIGHT", "w", 1) + "<vcount>1 1 2</vcount><v>0 0 1 0 " +
              weights + "</v></vertex_weights></skin></controller>"};
}

/// Where a vertex is when joints stand as their poses say.
vec3 skinned_at(const Loaded& model, std::size_t vertex, const std::vector<mat4x3>& joints) {
  const PutMesh& mesh = library_item<PutMesh>(model);
  const SkinPatch& skin = **entity_named(model, "Leg.skin").skin;
  const vec4 p(mesh.vertices->positions[vertex], 1);
  vec3 out(0);
  for (int i = 0; i < 4; ++i) {
    const std::size_t joint = mesh.topology->joints[vertex][i];
    const float weight = mesh.topology->weights[vertex][i];
    if (weight > 0) out += weight * vec3(joints[joint] * vec4(skin.inverse_binds[joint] * p, 1));
  }
  return out;
}

}  // namespace

TEST_CASE("dae: a skin follows its joints, and its clip turns them") {
  const Loaded model = loaded(skinned("hip knee", "0 1 1 2"));
  CHECK(model.warnings.empty());
  const SkinPatch& skin = **entity_named(model, "Leg.skin").skin;
  CHECK(entity_of(model, skin.joints[0]) == entity_index(model, "Hip"));
  CHECK(entity_of(model, skin.joints[1]) == entity_index(model, "Knee"));
  CHECK(model.asset.animations[0].channels[0].entity == entity_index(model, "Knee"));
  const mat4x3 hip = entity_named(model, "Hip").pose->matrices[0];
  const auto at = [&](double time) {
    return std::vector<mat4x3>{hip, affine_product(hip, pose_at(keys(model), time))};
  };
  check_near(skinned_at(model, 1, at(0)), vec3(2, 0, 5));
  check_near(skinned_at(model, 1, at(1)), vec3(1, 1, 5));
  const vec3 bent(1 - 2, -1, 5);  // of (0, 2): 2 to the left of the knee, turned a quarter
  check_near(skinned_at(model, 2, at(1)), 0.25f * vec3(0, 2, 5) + 0.75f * bent);
  check_near(model.bounds_min, vec3(0, 0, 5));
  check_near(model.bounds_max, vec3(2, 2, 5));
}

TEST_CASE("dae: a skin of a morph has both") {
  Parts parts = skinned("hip knee", "0 1 1 2", "m");
  parts.controllers += fmt::format(fmt::runtime(kMorph), "");
  parts.geometries = kTargets;
  const Loaded model = loaded(parts);
  CHECK(library_item<PutMesh>(model).topology->morph_count == 2);
  CHECK(library_item<PutMesh>(model).topology->joints.size() == 3);
  CHECK(entity_named(model, "Leg.skin").morph_weights);
}

TEST_CASE("dae: joints without a node stay, and a skin that lies is refused") {
  const Loaded model = loaded(skinned("hip nobody", "0 1 1 2"));
  REQUIRE(model.warnings.size() == 1);
  CHECK_THAT(model.warnings[0], Contains("joint 'nobody' has no node"));
  check_near(skinned_at(model, 1, {mat4x3(1), mat4x3(1)}), vec3(2, 0, 0));
  const auto refused = [](const std::string& joints, const std::string& weights) {
    return refusal(load_text(document(skinned(joints, weights))));
  };
  CHECK_THAT(refused("hip knee", "0 1 7 2"), Contains("names joint 7"));
  CHECK_THAT(refused("hip knee", "0 1 1 9"), Contains("weight 9"));
  CHECK_THAT(refused("hip knee", "0 1"), Contains("more than <v> has"));
  CHECK_THAT(refused("hip knee toe", "0 1 1 2"), Contains("3 joints"));
  CHECK(refused("hip knee", "-1 1 1 2").empty());
}

TEST_CASE("dae: animations that lie are refused by their sampler") {
  const auto refused = [](const Keyed& keyed) {
    return refusal(load_text(document({.animations = animation("a", keyed)})));
  };
  CHECK_THAT(refused({"n/t.X", "0 1", "0 1 2"}), Contains("2 times, but 3 numbers"));
  CHECK_THAT(refused({"n/t.X", "0 x", "0 1"}), Contains("not a finite number"));
  CHECK_THAT(refused({"n/s", "0 1", "1 1 1 1e38 1e38 1e38", 3}), Contains("a"));
  CHECK_THAT(refused({.target = "n/t.X",
                      .times = "0 1",
                      .values = "0 1",
                      .more = names("k", "LINEAR"),
                      .inputs = input("INTERPOLATION", "k")}),
             Contains("names of INTERPOLATION"));
}

TEST_CASE("dae: units and axes of what moves are those of what stands") {
  Parts parts = skinned("hip knee", "0 1 1 2");
  for (const auto& [asset, high] :
       {std::pair("<unit meter='0.01'/><up_axis>Z_UP</up_axis>", vec3(0.02f, 0.02f, 0.05f)),
        std::pair("<up_axis>Y_UP</up_axis>", vec3(2, -5, 2))}) {
    parts.asset = asset;
    check_near(loaded(parts).bounds_max, high);
  }
}
