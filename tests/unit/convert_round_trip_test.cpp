// Every field of an edit survives proto -> domain -> proto. The examples fill every field of every
// message: one that a new field is missing in fails, and so does a field that convert ignores.
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>

#include <set>

#include "server/convert/transaction.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

template <class Message>
Message parse(const std::string& text) {
  Message message;
  REQUIRE(google::protobuf::TextFormat::ParseFromString(text, &message));
  return message;
}

/// Fields of `message` that are not set, but for those in `except`.
std::string unset(const google::protobuf::Message& message, const std::set<std::string>& except) {
  std::string names;
  const auto* descriptor = message.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const auto* field = descriptor->field(i);
    const bool set = field->is_repeated() ? message.GetReflection()->FieldSize(message, field) > 0
                                          : message.GetReflection()->HasField(message, field);
    if (!set && !except.contains(field->name())) names += field->name() + " ";
  }
  return names;
}

v1::TextureUse texture_use(bool scalar) {
  auto use = parse<v1::TextureUse>("texture { name: 't' } uv_set: 1 scale: 2 offset: -0.5");
  if (scalar) use.set_channel(2);
  *use.mutable_uv_transform() = f32({2, 3}, {1, 2, 3, 4, 5, 6});
  return use;
}

void check_round_trip(const v1::Transaction& message, InlineSource& source) {
  auto transaction = to_transaction(message, source);
  if (!transaction) INFO(transaction.error().where << ": " << transaction.error().message);
  REQUIRE(transaction);
  const v1::Transaction back = to_proto(*transaction, inline_sink);
  std::string difference;
  google::protobuf::util::MessageDifferencer differencer;
  differencer.ReportDifferencesToString(&difference);
  const bool equal = differencer.Compare(message, back);
  INFO(difference);
  CHECK(equal);
}

v1::Entity full_entity() {
  auto entity = parse<v1::Entity>(R"(
    parent { name: 'p' } mesh { id: 144115188075855873 }
    materials { parts { name: 'm' } parts { created_by_edit: 3 } }
    light { color { x: 1 y: 2 z: 3 } intensity: 4
            unit: UNIT_POWER exposure: -1 temperature: 6500 two_sided: true shape: SHAPE_DISC
            radius: 2 inner_cone_angle: 0.25 outer_cone_angle: 0.5 }
    camera { width: 640 height: 480 projection: PROJECTION_PERSPECTIVE
             fx: 500 fy: 501 cx: 319.5 cy: 239.5 aperture: 0.025 focus_distance: 2
             blades: 6 blade_rotation: 0.5 near: 0.1 far: 50
             rgb_sensor { exposure: 1 full_well: 8000 read_noise: 3 black_level: 0.05 bits: 12
                          vignetting: 0.5 pattern: PATTERN_GRBG }
             depth_sensor { kind: KIND_TIME_OF_FLIGHT range_noise: 0.01 window: 3 min_signal: 0.1
                            max_angle: 1.25 min_depth: 0.25 max_depth: 5 }
             shutter { open: -0.01 close: 0.02 rolling: 0.03 } }
    portal { width: 2 height: 3 } volume { id: 0 } skin { joints { name: 'a' } joints { name: 'b' } }
    label { value: 7 group: true category: 'bolt' part: 2 } visible: false
    visibility { camera: false diffuse: true glossy: false transmission: true shadow: false volume: false }
    static: true teleport: true shadow_catcher: true attributes { values { key: 'a' value: 'b' } } light_group: 'key')");
  *entity.mutable_pose()->mutable_matrices() = f32({2, 4, 4}, translations({1, 2}));
  *entity.mutable_pose()->mutable_times() = f64({2}, {0, 1});
  *entity.mutable_light()->mutable_texture() = texture_use(false);
  *entity.mutable_skin()->mutable_inverse_binds() = f32({2, 4, 4}, translations({3, 4}));
  *entity.mutable_morph_weights()->mutable_weights() = f32({2, 1}, {0, 1});
  *entity.mutable_morph_weights()->mutable_times() = f64({2}, {0, 1});
  return entity;
}

v1::Mesh full_mesh() {
  auto mesh = parse<v1::Mesh>(R"(
    part_names: 'x' part_names: 'y'
    keypoints { name: 'tip' position { x: 1 y: 2 z: 3 } }
    keypoints { name: 'base' position { x: 1 } }
    symmetries { axis { z: 1 } offset { x: 1 } })");
  const std::vector<float> nine{0, 0, 0, 1, 0, 0, 0, 1, 0}, six{0, 0, 1, 0, 0, 1};
  const std::vector<float> twelve{1, 0, 0, 0, 0, 1, 0, 0, 0.25, 0.25, 0.25, 0.25};
  std::vector<float> two_keys = nine;
  two_keys.insert(two_keys.end(), nine.begin(), nine.end());
  *mesh.mutable_positions() = f32({2, 3, 3}, two_keys);
  *mesh.mutable_normals() = f32({2, 3, 3}, two_keys);
  *mesh.mutable_times() = f64({2}, {-1, 1});
  *mesh.mutable_indices() = u32s({2, 3}, {0, 1, 2, 2, 1, 0});
  *mesh.mutable_uvs() = f32({3, 2}, six);
  *mesh.mutable_uvs1() = f32({3, 2}, six);
  *mesh.mutable_colors() = f32({3, 4}, twelve);
  *mesh.mutable_tangents() = f32({3, 4}, twelve);
  *mesh.mutable_parts() = u32s({2}, {1, 0});
  *mesh.mutable_joints() =
      array_of<u16>(v1::D_TYPE_U16, {3, 4}, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11});
  *mesh.mutable_weights() = f32({3, 4}, twelve);
  *mesh.mutable_morph_positions() = f32({1, 3, 3}, nine);
  *mesh.mutable_morph_normals() = f32({1, 3, 3}, nine);
  *mesh.mutable_skeleton() = u32s({1, 2}, {0, 1});
  *mesh.add_symmetries()->mutable_matrix() = f32({4, 4}, translations({2}));
  return mesh;
}

/// Curves have neither indices nor normals nor tangents of their own.
v1::Mesh full_strands() {
  v1::Mesh mesh = full_mesh();
  mesh.clear_indices();
  mesh.clear_normals();
  mesh.clear_tangents();
  mesh.clear_morph_normals();
  *mesh.mutable_curves() = u32s({1}, {3});
  *mesh.mutable_radii() = f32({3}, {0.25f, 0.5f, 0.125f});
  return mesh;
}

v1::Camera full_scanner() {
  auto camera = parse<v1::Camera>(
      "width: 2 height: 1 projection: PROJECTION_RAY_TABLE aperture: 0 focus_distance: 0 blades: 0 "
      "blade_rotation: 0 near: 0.5 far: 9 shutter { open: 0 close: 0.25 rolling: 0 }");
  v1::RayTable& table = *camera.mutable_rays();
  *table.mutable_rays() = f32({1, 2, 6}, {0, 0, 1, 0, 0, 1, 1, 2, 3, 0, 0, 0});
  *table.mutable_times() = f32({1, 2}, {0, 0.5f});
  table.set_interpolated(true);
  return camera;
}

v1::Material full_material() {
  auto material = parse<v1::Material>(R"(
    alpha_mode: ALPHA_MODE_BLEND alpha_cutoff: 0.25 two_sided_emission: true unlit: true
    thin_walled: true priority: -3)");
  const auto* descriptor = material.GetDescriptor();
  for (int i = 0; i < descriptor->field_count(); ++i) {
    const auto* field = descriptor->field(i);
    if (field->cpp_type() != google::protobuf::FieldDescriptor::CPPTYPE_MESSAGE) continue;
    auto* part = material.GetReflection()->MutableMessage(&material, field);
    if (auto* scalar = dynamic_cast<v1::ScalarParameter*>(part)) {
      scalar->set_value(1);
      *scalar->mutable_texture() = texture_use(true);
    } else if (auto* color = dynamic_cast<v1::ColorParameter*>(part)) {
      *color->mutable_value() = parse<v1::Vec3>("x: 0.25 y: 0.5 z: 1");
      *color->mutable_texture() = texture_use(false);
    }
  }
  material.mutable_medium_anisotropy()->set_value(0.5f);
  *material.mutable_normal_map() = texture_use(false);
  *material.mutable_clearcoat_normal_map() = texture_use(false);
  *material.mutable_bump_map() = texture_use(true);
  return material;
}

v1::Texture full_texture() {
  auto texture = parse<v1::Texture>(
      "encoding: ENCODING_SRGB wrap_u: WRAP_MIRROR wrap_v: WRAP_CLAMP filter: FILTER_NEAREST");
  *texture.mutable_texels() = f32({1, 2, 3}, {1, 2, 3, 4, 5, 6});
  return texture;
}

v1::Settings full_settings() {
  auto settings = parse<v1::Settings>(R"(
    time: 2.5
    dome { texture { name: 't' } color { x: 1 y: 1 z: 1 } intensity: 3 camera_visible: false
           light_group: 'sky' }
    categories: 'bolt' categories: 'nut')");
  *settings.mutable_dome()->mutable_rotation() = f32({3, 3}, {0, -1, 0, 1, 0, 0, 0, 0, 1});
  return settings;
}

v1::Grid full_grid(u64 channels, float value) {
  v1::Grid grid;
  std::vector<u64> shape{1, 8, 8, 8};
  if (channels > 1) shape.push_back(channels);
  *grid.mutable_values() = f32(shape, std::vector<float>(512 * channels, value));
  *grid.mutable_bricks() = array_of<i32>(v1::D_TYPE_I32, {1, 3}, {-1, 0, 0});
  *grid.mutable_box() = array_of<i32>(v1::D_TYPE_I32, {2, 3}, {-8, 0, 0, 0, 7, 8});
  *grid.mutable_transform() = f32({4, 4}, translations({1}));
  return grid;
}

v1::Volume full_volume() {
  auto volume = parse<v1::Volume>(
      "density_scale: 2 albedo { x: 0.5 y: 0.6 z: 0.7 } anisotropy: -0.5 temperature_scale: 1500 "
      "emission_scale: 3");
  *volume.mutable_density() = full_grid(1, 2);
  *volume.mutable_temperature() = full_grid(1, 3);
  *volume.mutable_color() = full_grid(3, 0.5f);
  return volume;
}

}  // namespace

TEST_CASE("convert: every field of every noun survives the round trip") {
  InlineSource source;
  v1::Transaction message;
  const auto add = [&](const char* name) {
    v1::Edit* edit = message.add_edits();
    edit->set_mode(v1::Edit::MODE_UPDATE);
    edit->mutable_target()->set_name(name);
    return edit;
  };
  *add("e")->mutable_entity() = full_entity();
  CHECK(unset(message.edits(0).entity(), {"clear"}).empty());
  CHECK(unset(message.edits(0).entity().light(), {"sun_angle", "width", "height", "profile"})
            .empty());
  const v1::Camera& camera = message.edits(0).entity().camera();
  CHECK(unset(camera, {"distortion", "rays"}).empty());
  CHECK(unset(camera.shutter(), {}).empty());
  CHECK(unset(camera.rgb_sensor(), {}).empty());
  CHECK(unset(camera.depth_sensor(),
              {"baseline", "disparity_noise", "disparity_step", "lateral_noise"})
            .empty());
  CHECK(unset(message.edits(0).entity().label(), {"auto"}).empty());
  CHECK(unset(message.edits(0).entity().visibility(), {}).empty());
  CHECK(unset(message.edits(0).entity().skin(), {}).empty());
  *add("m")->mutable_mesh() = full_mesh();
  CHECK(unset(message.edits(1).mesh(), {"clear", "curves", "radii"}).empty());
  *add("mat")->mutable_material() = full_material();
  CHECK(unset(message.edits(2).material(), {"clear"}).empty());
  CHECK(unset(message.edits(2).material().ior().texture(), {}).empty());
  *add("tex")->mutable_texture() = full_texture();
  CHECK(unset(message.edits(3).texture(), {"clear"}).empty());
  *add("vol")->mutable_volume() = full_volume();
  CHECK(unset(message.edits(4).volume(), {"clear"}).empty());
  CHECK(unset(message.edits(4).volume().color(), {}).empty());
  *message.add_edits()->mutable_settings() = full_settings();
  CHECK(unset(message.edits(5).settings(), {}).empty());
  CHECK(unset(message.edits(5).settings().dome(), {"clear"}).empty());
  *add("sun")->mutable_entity()->mutable_light() = parse<v1::Light>(
      "color { x: 1 y: 2 z: 3 } intensity: 4 unit: UNIT_ILLUMINANCE exposure: 1 temperature: 5800 "
      "two_sided: false sun_angle: 0.01");
  for (const char* lens :
       {"projection: PROJECTION_PERSPECTIVE distortion: [0.1, 0, 0, 0]",
        "projection: PROJECTION_PERSPECTIVE distortion: [1, 2, 3, 4, 5]",
        "projection: PROJECTION_PERSPECTIVE distortion: [1, 2, 3, 4, 5, 6, 7, 8]",
        "projection: PROJECTION_FISHEYE distortion: [0, 0, 3, 4]",
        "projection: PROJECTION_EQUIRECTANGULAR", "projection: PROJECTION_ORTHOGRAPHIC",
        "projection: PROJECTION_PERSPECTIVE depth_sensor { kind: KIND_ACTIVE_STEREO baseline: "
        "0.075 "
        "disparity_noise: 0.5 disparity_step: 0.125 lateral_noise: 0.5 window: 5 min_signal: 0 "
        "max_angle: 1 min_depth: 0 max_depth: 0 }"}) {
    *add(lens)->mutable_entity()->mutable_camera() = parse<v1::Camera>(
        "width: 64 height: 48 fx: 50 fy: 51 cx: 31 cy: 23 aperture: 0 "
        "focus_distance: 0 blades: 0 blade_rotation: 0 near: 0 far: 0 " +
        std::string(lens));
  }
  *add("scanner")->mutable_entity()->mutable_camera() = full_scanner();
  CHECK(unset(message.edits(message.edits_size() - 1).entity().camera().rays(), {}).empty());
  *add("strands")->mutable_mesh() = full_strands();
  CHECK(unset(message.edits(message.edits_size() - 1).mesh(),
              {"clear", "indices", "normals", "tangents", "morph_normals"})
            .empty());
  *add("window")->mutable_entity()->mutable_light() = parse<v1::Light>(
      "color { x: 1 y: 2 z: 3 } intensity: 4 unit: UNIT_CANDELA exposure: 1 temperature: 5800 "
      "two_sided: true shape: SHAPE_RECTANGLE width: 2 height: 3");
  *add("trough")->mutable_entity()->mutable_light() = parse<v1::Light>(
      "color { x: 1 y: 2 z: 3 } intensity: 4 unit: UNIT_PROFILE_SCALE exposure: 1 temperature: 0 "
      "two_sided: true shape: SHAPE_DISC radius: 2 profile { name: 'p' }");
  check_round_trip(message, source);
}

TEST_CASE("convert: every action survives the round trip") {
  InlineSource source;
  const std::string hash(32, 'a');
  Asset asset{.hash = hash, .animations = {{"walk", {}}, {"run", {}}}};
  source.assets[hash] = std::make_shared<const Asset>(asset);
  auto message = parse<v1::Transaction>(R"(
    edits { target { name: 'x' } remove { cascade: true } }
    edits { target { name: 'y' } instantiate { parent { name: 'p' }
            label { auto: true group: false category: 'c' part: 0 }
            materials { key: 'Leather' value { name: 'steel' } } animation: 1 } }
    edits { target { name: 'z' } instances { prototype { mesh { name: 'm' } } } }
    edits { poses { teleport: true } }
    edits { advance { dt: 0.5 } }
    edits { prune {} })");
  message.mutable_edits(1)->mutable_instantiate()->set_asset(hash);
  *message.mutable_edits(1)->mutable_instantiate()->mutable_pose()->mutable_matrices() =
      f32({4, 4}, translations({1}));
  *message.mutable_edits(2)->mutable_instances()->mutable_matrices() =
      f32({3, 4, 4}, translations({1, 2, 3}));
  v1::Poses* poses = message.mutable_edits(3)->mutable_poses();
  *poses->mutable_ids() = array_of<u64>(v1::D_TYPE_U64, {2}, {5, 6});
  *poses->mutable_matrices() = f32({2, 4, 4}, translations({1, 2}));
  std::set<int> cases;
  for (const v1::Edit& edit : message.edits()) cases.insert(int(edit.action_case()));
  CHECK(cases.size() + 6 == std::size_t(v1::Edit::descriptor()->oneof_decl(0)->field_count()));
  check_round_trip(message, source);
}

TEST_CASE("convert: what is cleared holds its default and survives the round trip") {
  const auto names = [](const google::protobuf::Descriptor* descriptor) {
    std::vector<std::string> out;
    for (int i = 0; i < descriptor->field_count(); ++i)
      if (const std::string& name = descriptor->field(i)->name();
          name != "clear" && name != "teleport" && name != "texels")
        out.push_back(name);
    return out;
  };
  InlineSource source;
  v1::Transaction message;
  for (const auto& name : names(v1::Entity::descriptor()))
    message.add_edits()->mutable_entity()->add_clear(name);
  for (const auto& name : names(v1::Material::descriptor()))
    message.add_edits()->mutable_material()->add_clear(name);
  for (const auto& name : names(v1::Dome::descriptor()))
    message.add_edits()->mutable_settings()->mutable_dome()->add_clear(name);
  for (const auto& name : names(v1::Texture::descriptor())) {
    v1::Texture* texture = message.add_edits()->mutable_texture();
    *texture->mutable_texels() = array_of<u8>(v1::D_TYPE_U8, {1, 1}, {7});
    texture->add_clear(name);
  }
  for (const auto& name : names(v1::Volume::descriptor()))
    if (name != "density") message.add_edits()->mutable_volume()->add_clear(name);
  const auto transaction = to_transaction(message, source);
  REQUIRE(transaction);
  const v1::Transaction once = to_proto(*transaction, inline_sink);
  for (int i = 0; i < once.edits_size(); ++i) {
    INFO(message.edits(i).ShortDebugString());
    const v1::Edit& edit = once.edits(i);
    CHECK((edit.entity().ByteSizeLong() || edit.material().ByteSizeLong() ||
           edit.settings().dome().ByteSizeLong() || edit.texture().ByteSizeLong() ||
           edit.volume().ByteSizeLong()));
  }
  check_round_trip(once, source);
  const auto& ior =
      std::get<PutMaterial>(
          transaction->edits[std::size_t(names(v1::Entity::descriptor()).size()) + 5].action)
          .parameters[std::size_t(MaterialParameter::ior)];
  REQUIRE(ior.value);
  CHECK(ior.value->x == 1.5f);
}
