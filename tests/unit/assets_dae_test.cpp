// COLLADA: what it holds beside the same by OBJ, its axes, units, nodes and materials, and what is
// refused.
#include <algorithm>

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;
using enum MaterialParameter;

namespace {

Expected<Loaded> load_text(std::string_view text, const LoadOptions& options = {}) {
  return TestBundle().add("a.dae", text).load(options);
}

/// Rows of three numbers.
std::string source(const std::string& id, std::string_view numbers, std::size_t rows) {
  return fmt::format(
      R"(<source id="{0}"><float_array id="{0}-array">{1}</float_array><technique_common>
         <accessor source="#{0}-array" count="{2}" stride="3"><param/><param/><param/></accessor>
         </technique_common></source>)",
      id, numbers, rows);
}

constexpr const char* kCube = "0 0 0 1 0 0 1 1 0 0 1 0 0 0 1 1 0 1 1 1 1 0 1 1";
constexpr const char* kQuads = "0 3 2 1  4 5 6 7  0 1 5 4  1 2 6 5  2 3 7 6  3 0 4 7";

/// A document that shows one geometry: the corners of the unit cube, and `primitives`.
std::string document(const std::string& primitives,
                     const std::string& asset = "<up_axis>Z_UP</up_axis>",
                     const std::string& node = "", const std::string& libraries = "") {
  return "<COLLADA><asset>" + asset + "</asset>" + libraries +
         R"(<library_geometries><geometry id="g"><mesh>)" + source("xyz", kCube, 8) +
         R"(<vertices id="v"><input semantic="POSITION" source="#xyz"/></vertices>)" + primitives +
         R"(</mesh></geometry></library_geometries><library_visual_scenes><visual_scene id="s">
            <node id="n">)" +
         node + R"(<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
            <scene><instance_visual_scene url="#s"/></scene></COLLADA>)";
}

std::string primitive(const std::string& tag, const std::string& rest) {
  return fmt::format(R"(<{0}><input semantic="VERTEX" source="#v" offset="0"/>{1}</{0}>)", tag,
                     rest);
}

std::string cube() {
  return primitive("polylist", fmt::format("<vcount>4 4 4 4 4 4</vcount><p>{}</p>", kQuads));
}

const PutEntity& shown(const Loaded& loaded, std::size_t k = 1) {
  return std::get<PutEntity>(loaded.asset.entities[k].action);
}

mat4x3 pose_of(const Loaded& loaded, std::size_t k = 1) {
  const auto& pose = shown(loaded, k).pose;
  return pose ? pose->matrices[0] : mat4x3(1);
}

void check_near(const vec3& a, const vec3& b) {
  INFO(fmt::format("{} {} {}, not {} {} {}", a.x, a.y, a.z, b.x, b.y, b.z));
  CHECK(glm::length(a - b) < 1e-5f);
}

double area(const PutMesh& mesh) {
  double sum = 0;
  for (const uvec3& t : mesh.topology->triangles) {
    const auto& p = mesh.vertices->positions;
    sum += 0.5 * glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
  }
  return sum;
}

const PutMaterial& material(const Loaded& loaded, std::string_view name) {
  for (const Edit& edit : loaded.asset.library)
    if (std::get<std::string>(edit.target) == name) return std::get<PutMaterial>(edit.action);
  FAIL("there is no material " << name);
  std::abort();
}

float number(const PutMaterial& put, MaterialParameter parameter) {
  return put.parameters[std::size_t(parameter)].value->x;
}

}  // namespace

TEST_CASE("dae: a cube is the cube of an OBJ") {
  std::string obj = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n";
  obj += "f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
  const auto theirs = TestBundle().add("a.obj", obj).load();
  const auto ours = load_text(document(cube()));
  REQUIRE(theirs);
  REQUIRE(ours);
  const PutMesh& a = library_item<PutMesh>(*ours);
  const PutMesh& b = library_item<PutMesh>(*theirs);
  CHECK(std::ranges::equal(a.topology->triangles, b.topology->triangles));
  CHECK(std::ranges::equal(a.vertices->positions, b.vertices->positions));
  CHECK(a.vertices->normals.empty());
  CHECK(ours->bounds_max == theirs->bounds_max);
  CHECK(ours->asset.entities.size() == 2);
  CHECK_FALSE(shown(*ours, 0).pose);
  CHECK_FALSE(shown(*ours).pose);
}

TEST_CASE("dae: every kind of primitive covers the same face") {
  for (const auto& [tag, rest] : std::vector<std::pair<std::string, std::string>>{
           {"triangles", "<p>4 5 6 4 6 7</p>"},
           {"polylist", "<vcount>3 3</vcount><p>4 5 6 4 6 7</p>"},
           {"polygons", "<p>4 5 6 7</p>"},
           {"trifans", "<p>4 5 6 7</p>"},
           {"tristrips", "<p>4 5 7 6</p>"}}) {
    INFO(tag);
    const auto loaded = load_text(document(primitive(tag, rest)));
    REQUIRE(loaded);
    const PutMesh& mesh = library_item<PutMesh>(*loaded);
    CHECK(area(mesh) == Approx(1));
    CHECK(mesh.topology->triangles.size() == 2);
    CHECK(mesh.topology->vertex_count == 4);
    for (const uvec3& t : mesh.topology->triangles) {
      const auto& p = mesh.vertices->positions;
      CHECK(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]).z > 0);
    }
  }
}

TEST_CASE("dae: inputs share offsets or have their own, and are rows with a stride") {
  const std::string normals = source("normal", "0 0 1 0 0 -3", 2);
  const std::string own = R"(<input semantic="NORMAL" source="#normal" offset="2"/><p>
      4 9 1 5 9 1 6 9 0 4 9 1 6 9 0 7 9 0</p>)";
  const auto loaded = load_text(document(normals + primitive("triangles", own)));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->vertex_count == 4);
  CHECK(mesh.vertices->normals[0] == vec3(0, 0, -1));
  CHECK(mesh.vertices->normals[2] == vec3(0, 0, 1));
  const std::string both = R"(<input semantic="NORMAL" source="#xyz" offset="0"/><p>5 6 7</p>)";
  const auto same = load_text(document(primitive("triangles", both)));
  REQUIRE(same);
  check_near(library_item<PutMesh>(*same).vertices->normals[1], vec3(1, 1, 1) / std::sqrt(3.0f));
}

TEST_CASE("dae: colours of vertices are sRGB, and parts without normals take their faces'") {
  const std::string more = source("rgb", "1 0 0.5 0 1 0", 2) + source("normal", "0 1 0", 1) +
                           primitive("triangles",
                                     R"(<input semantic="COLOR" source="#rgb" offset="1"/>
                                        <p>4 0 5 0 6 1</p>)") +
                           primitive("triangles", R"(<input semantic="NORMAL" source="#normal"
                                        offset="1"/><p>0 0 2 0 1 0</p>)");
  const auto loaded = load_text(document(more));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  check_near(vec3(mesh.topology->colors[0]), vec3(1, 0, 0.21404f));
  CHECK(mesh.topology->colors[3] == vec4(1));
  CHECK(mesh.vertices->normals[0] == vec3(0, 0, 1));
  CHECK(mesh.vertices->normals[3] == vec3(0, 1, 0));
}

TEST_CASE("dae: axes and units are the file's, unless the caller names others") {
  const auto corner = [&](const std::string& asset, const LoadOptions& options = {}) {
    const auto loaded = load_text(document(cube(), asset, "<translate>1 2 3</translate>"), options);
    REQUIRE(loaded);
    return pose_of(*loaded) * vec4(0, 0, 0, 1);
  };
  const std::string inch = R"(<unit name="inch" meter="0.0254"/>)";
  check_near(corner("<up_axis>Z_UP</up_axis>"), vec3(1, 2, 3));
  check_near(corner(""), vec3(1, -3, 2));
  check_near(corner("<up_axis> Y_UP </up_axis>" + inch), 0.0254f * vec3(1, -3, 2));
  check_near(corner(R"(<up_axis>Z_UP</up_axis><unit meter="0,5"/>)"), 0.5f * vec3(1, 2, 3));
  const auto comma =
      load_text(document(cube(), "<up_axis>Z_UP</up_axis>", "<translate>0,5 -1,25 3</translate>"));
  REQUIRE(comma);
  check_near(pose_of(*comma) * vec4(0, 0, 0, 1), vec3(0.5f, -1.25f, 3));
  check_near(corner("<up_axis>X_UP</up_axis>"), vec3(-3, 2, 1) * vec3(1, 1, 1));
  check_near(corner("<up_axis>Y_UP</up_axis>" + inch, {.format = "", .up = "z", .units = 2}),
             2.0f * vec3(1, 2, 3));
  CHECK_THAT(refusal(load_text(document(cube(), "<up_axis>W</up_axis>"))), Contains("up_axis"));
  for (const char* unit : {"0", "x", "1e99", "-1"})
    CHECK_THAT(refusal(load_text(document(cube(), fmt::format("<unit meter=\"{}\"/>", unit)))),
               Contains("asset.unit.meter"));
}

TEST_CASE("dae: a material that is not there is the default, with a warning") {
  std::string text = document(cube());
  const std::string plain = R"(<instance_geometry url="#g"/>)";
  text.replace(text.find(plain), plain.size(),
               R"(<instance_geometry url="#g"><bind_material><technique_common>
                  <instance_material symbol="a" target="#gone"/>
                  </technique_common></bind_material></instance_geometry>)");
  const auto loaded = load_text(text);
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK_FALSE(shown(*loaded).materials.has_value());
  CHECK_THAT(loaded->warnings.at(0), Contains("no <material> '#gone'"));
}

TEST_CASE("dae: transforms of a node apply from the last to the first") {
  const auto loaded = load_text(
      document(cube(), "<up_axis>Z_UP</up_axis>",
               R"(<matrix>1 0 0 5 0 1 0 0 0 0 1 0 0 0 0 1</matrix><translate>0 1 0</translate>
                  <rotate>0 0 2 90</rotate><scale>2 3 4</scale>)"));
  REQUIRE(loaded);
  const mat4x3 pose = pose_of(*loaded);
  check_near(pose * vec4(0, 0, 0, 1), vec3(5, 1, 0));
  check_near(pose * vec4(1, 0, 0, 1), vec3(5, 3, 0));
  check_near(pose * vec4(0, 1, 1, 1), vec3(2, 1, 4));
}

TEST_CASE("dae: nodes, instances of nodes, materials by symbol, textures") {
  const TestBundle bundle = bundle_of(test_assets() / "dae/bracket.dae");
  const auto loaded = bundle.load();
  REQUIRE(loaded);
  REQUIRE(loaded->asset.entities.size() == 3);
  CHECK(loaded->warnings.size() == 1);
  CHECK_THAT(loaded->warnings[0], Contains("instance_light") && Contains("'lamp'"));
  // 1 2 3 cm with +Y up are 0.01 -0.03 0.02 m; the node's x, doubled and turned to y, is up here
  check_near(pose_of(*loaded) * vec4(0, 0, 0, 1), vec3(0.01f, -0.03f, 0.02f));
  check_near(pose_of(*loaded) * vec4(10, 0, 0, 1), vec3(0.01f, -0.03f, 0.22f));
  check_near(pose_of(*loaded, 2) * vec4(0, 0, 0, 1), vec3(0.2f, 0, 0.07f));
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  CHECK(mesh.topology->part_names == std::vector<std::string>{"front", "back"});
  CHECK(std::ranges::equal(mesh.topology->parts, std::vector<u32>{0, 0, 1, 1}));
  CHECK(mesh.topology->uvs[2] == vec2(1, 1));
  CHECK(mesh.vertices->normals[0] == vec3(0, 0, 1));
  CHECK(mesh.vertices->normals[4] == vec3(0, 0, -1));
  const auto& main = *shown(*loaded).materials;
  const auto& left = *shown(*loaded, 2).materials;
  REQUIRE(main.size() == 2);
  CHECK(std::holds_alternative<std::monostate>(main[1]));
  CHECK(std::get<CreatedByEdit>(main[0]).edit == std::get<CreatedByEdit>(left[1]).edit);

  const PutMaterial& painted = material(*loaded, "Painted");
  const auto& use = painted.parameters[std::size_t(base_color)].texture;
  REQUIRE(use);
  const auto& texture = library_item<PutTexture>(*loaded);
  CHECK(texture.srgb == true);
  CHECK(texture.wrap_u == Wrap::kClamp);
  CHECK(texture.wrap_v == Wrap::kRepeat);
  CHECK(number(painted, roughness) == Approx(std::pow(0.04, 0.25)));
  CHECK(number(painted, specular) == Approx(0.5));
  const PutMaterial& glass = material(*loaded, "Glass");
  check_near(*glass.parameters[std::size_t(base_color)].value, vec3(0.8f, 0.1f, 0.2f));
  check_near(*glass.parameters[std::size_t(emission)].value, vec3(0, 0.5f, 0));
  CHECK(glass.alpha_mode == AlphaMode::kBlend);
  CHECK(number(glass, alpha) == Approx(0.25));

  const auto lacking = TestBundle().add("b.dae", bundle.contents[0]).load();
  REQUIRE(lacking);
  CHECK(lacking->missing == std::vector<std::string>{"checker.png"});
}

namespace {

/// The cube as two joints move it. The second is under the first, and is where it was bound.
std::string skinned(const std::string& joints, const std::string& skin_source = "#g",
                    const std::string& more = "") {
  return "<COLLADA><asset><up_axis>Z_UP</up_axis></asset><library_geometries><geometry "
         "id='g'><mesh>" +
         source("xyz", kCube, 8) +
         "<vertices id='v'><input semantic='POSITION' source='#xyz'/></vertices>" + cube() +
         "</mesh></geometry></library_geometries><library_controllers>"
         "<controller id='c'><skin source='" +
         skin_source +
         "'><bind_shape_matrix>2 0 0 0 0 2 0 0 0 0 2 0 0 0 0 1</bind_shape_matrix>"
         "<source id='j'><Name_array>" +
         joints +
         "</Name_array></source><source id='i'><float_array>1 0 0 -1 0 1 0 0 0 0 1 0 0 0 0 1 "
         "1 0 0 -1 0 1 0 -1 0 0 1 0 0 0 0 1</float_array></source>"
         "<joints><input semantic='JOINT' source='#j'/><input semantic='INV_BIND_MATRIX' "
         "source='#i'/></joints></skin></controller>" +
         more +
         "</library_controllers><library_visual_scenes><visual_scene id='s'>"
         "<node><translate>0 0 7</translate><node id='h' sid='hip'><translate>1 0 0</translate>"
         "<node sid='knee'><translate>0 1 0</translate></node></node></node>"
         "<node><translate>9 9 9</translate><instance_controller url='#c'/></node>"
         "</visual_scene></library_visual_scenes><scene><instance_visual_scene url='#s'/></scene>"
         "</COLLADA>";
}

}  // namespace

TEST_CASE("dae: skins and morph targets are shown at rest, where their joints are") {
  const auto corner = [](const std::string& text) {
    const auto loaded = load_text(text);
    INFO(refusal(loaded));
    REQUIRE(loaded);
    CHECK(loaded->warnings ==
          std::vector<std::string>{"COLLADA skins and morph targets do not move: they are shown at "
                                   "rest"});
    return pose_of(*loaded) * vec4(1, 1, 1, 1);
  };
  check_near(corner(skinned("hip knee")), vec3(2, 2, 9));
  check_near(corner(skinned("h knee")), vec3(2, 2, 9));
  check_near(corner(skinned("nobody knee")), vec3(2, 2, 2));
  check_near(
      corner(skinned("hip knee", "#m", "<controller id='m'><morph source='#g'/></controller>")),
      vec3(2, 2, 9));
  CHECK_THAT(refusal(load_text(skinned("hip knee", "#c"))), Contains("within each other"));
  CHECK_THAT(refusal(load_text(skinned("hip knee", "#nothing"))),
             Contains("there is no <controller> 'nothing'"));
}

TEST_CASE("dae: transparency in its four senses") {
  const auto opacity = [](const std::string& inner) {
    const auto loaded = load_text(document(
        R"(<triangles material="m"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>)",
        "", "",
        "<library_materials><material id=\"m\"><instance_effect url=\"#e\"/></material>"
        "</library_materials><library_effects><effect id=\"e\"><profile_COMMON><technique><phong>" +
            inner + "</phong></technique></profile_COMMON></effect></library_effects>"));
    REQUIRE(loaded);
    const PutMaterial& put = material(*loaded, "m");
    return put.alpha_mode ? number(put, alpha) : 1.0f;
  };
  const auto says = [](const char* mode, const char* color, double factor) {
    return fmt::format(R"(<transparent opaque="{}"><color>{}</color></transparent>
                          <transparency><float>{}</float></transparency>)",
                       mode, color, factor);
  };
  CHECK(opacity(says("A_ONE", "0 0 0 0.8", 0.5)) == Approx(0.4));
  CHECK(opacity(says("A_ZERO", "0 0 0 0.8", 0.5)) == Approx(0.6));
  CHECK(opacity(says("RGB_ONE", "0.5 0.5 0.5 0", 0.5)) == Approx(0.25));
  CHECK(opacity(says("RGB_ZERO", "0.5 0.5 0.5 0", 0.5)) == Approx(0.75));
  CHECK(opacity("<transparency><float>0.3</float></transparency>") == Approx(0.3));
  CHECK(opacity("") == 1);
  CHECK(opacity(says("A_ONE", "1 1 1 1", 1)) == 1);
  CHECK(opacity(says("A_ONE", "1 1 1 1", 0)) == 1);  // nobody means that nothing is to be seen
}

TEST_CASE("dae: what breaks its rules is refused by name") {
  const auto expect = [](const std::string& text, const char* message) {
    INFO(message);
    CHECK_THAT(refusal(load_text(text)), Contains(message));
  };
  const auto triangles = [](const std::string& rest) {
    return document(primitive("triangles", rest));
  };
  expect("", "is no XML");
  expect("<COLLADA>", "is no XML");
  expect("<html/>", "must be COLLADA");
  expect("<COLLADA/>", "has no scene");
  expect(triangles("<p>0 1 8</p>"), "index 8 is not below 8");
  expect(triangles("<p>0 1 -1</p>"), "'-1' is no index");
  expect(triangles("<p>0 1</p>"), "no whole triangles");
  expect(triangles("<p>0 1 99999999999</p>"), "is no index");
  expect(triangles("<input semantic='NORMAL' source='#gone' offset='1'/>"), "no <source> 'gone'");
  expect(triangles("<input semantic='NORMAL' source='b.dae#n' offset='1'/>"), "same file");
  expect(triangles("<input semantic='NORMAL' source='#xyz' offset='99'/>"), "above 63");
  expect(document("<triangles><p>0 1 2</p></triangles>"), "no POSITION");
  expect(document(primitive("polylist", "<vcount>4</vcount><p>0 1 2</p>")), "more corners");
  expect(document(primitive("polylist", "<vcount>3</vcount><p>0 1 2 3</p>")), "fewer corners");
  expect(document(primitive("polygons", "<ph><p>0 1 2</p><h>3 4 5</h></ph>")), "holes");
  expect(document(""), "shows no geometry");
  expect(document(cube(), "", "<matrix>1 2 3</matrix>"), "3 numbers, not 16");
  expect(document(cube(), "", "<translate>1 nan 3</translate>"), "not a finite number");
  expect(document(cube(), "", "<lookat>0 0 0 1 1 1 0 0 1</lookat>"), "<lookat>");
  expect(document(cube(), "", "<scale>1e30 1e30 1e30</scale><scale>1e30 1 1</scale>"), "f32");
  expect(document(cube(), "", "<instance_node url='#n'/>"), "within itself");
  expect(document(cube(), "", "<instance_node url='#gone'/>"), "no <node> 'gone'");
  std::string broken = triangles("<p>0 1 2</p>");
  broken.replace(broken.find("count=\"8\""), 9, "count=\"9\"");
  expect(broken, "its accessor takes 9 rows of 3 of 24 numbers");
  const auto bytes = read_file(test_assets() / "dae/bracket.dae");
  std::string escaping(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  escaping.replace(escaping.find(">checker.png"), 12, ">../up.png");
  CHECK(load_text(escaping)->missing == std::vector<std::string>{"../up.png"});
}

TEST_CASE("dae: bombs are refused before they cost") {
  std::string nodes;  // 2^24 instances of one geometry
  for (int i = 0; i < 24; ++i)
    nodes += fmt::format(
        R"(<node id="k{0}"><instance_node url="#k{1}"/><instance_node url="#k{1}"/></node>)", i,
        i + 1);
  nodes += R"(<node id="k24"><instance_geometry url="#g"/></node>)";
  LoadOptions small;
  small.limits.entities = 10'000;
  const auto many = load_text(document(cube(), "", "<instance_node url='#k0'/>",
                                       "<library_nodes>" + nodes + "</library_nodes>"),
                              small);
  CHECK_THAT(refusal(many), Contains("10001 nodes"));
  std::string deep = "<COLLADA>";
  for (int i = 0; i < 100'000; ++i) deep += "<a>";
  for (int i = 0; i < 100'000; ++i) deep += "</a>";
  CHECK_THAT(refusal(load_text(deep + "</COLLADA>")), Contains("nested deeper"));
  std::string laughs = "<!DOCTYPE x [<!ENTITY a \"aaaaaaaa\"><!ENTITY b \"&a;&a;&a;&a;\">]>";
  CHECK_THAT(refusal(load_text(laughs + document(cube(), "<up_axis>&b;</up_axis>"))),
             Contains("up_axis"));  // the text as it stands
  small.limits.bytes = 1 << 20;
  std::string wide = "<COLLADA>";
  for (int i = 0; i < 50'000; ++i) wide += "<a/>";
  CHECK_THAT(refusal(load_text(wide + "</COLLADA>", small)), Contains("the limit is 1048576"));
}
