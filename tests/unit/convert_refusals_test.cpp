// Bad input: each refusal names the field, says what is wrong and what to do instead.
#include <fmt/format.h>
#include <google/protobuf/text_format.h>

#include <cmath>
#include <optional>

#include "google/rpc/error_details.pb.h"
#include "heliograph/v1/errors.pb.h"
#include "server/convert/error.h"
#include "server/convert/transaction.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

/// The error of a transaction whose fourth edit is `edit`.
Error refusal(const v1::Edit& edit) {
  InlineSource source;
  v1::Transaction message;
  for (int i = 0; i < 3; ++i) message.add_edits()->mutable_prune();
  *message.add_edits() = edit;
  const auto transaction = to_transaction(message, source);
  REQUIRE(!transaction);
  return transaction.error();
}

Error refusal(const std::string& text) {
  v1::Edit edit;
  REQUIRE(google::protobuf::TextFormat::ParseFromString(text, &edit));
  return refusal(edit);
}

Error refusal(const v1::Mesh& mesh) {
  v1::Edit edit;
  *edit.mutable_mesh() = mesh;
  return refusal(edit);
}

Error pose_refusal(const v1::Array& matrices) {
  v1::Edit edit;
  *edit.mutable_entity()->mutable_pose()->mutable_matrices() = matrices;
  return refusal(edit);
}

void check(const Error& error, Code code, const std::string& where, const std::string& says) {
  INFO(error.where << ": " << error.message);
  CHECK(int(error.code) == int(code));
  CHECK(error.where == where);
  CHECK(error.message.find(says) != std::string::npos);
}

constexpr Code kInvalid = Code::kInvalidArgument;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

}  // namespace

TEST_CASE("refusals: NaN and infinity, at the element") {
  v1::Mesh mesh = triangle();
  *mesh.mutable_positions() = f32({3, 3}, {0, 0, 0, 1, 0, 0, 0, kNan, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions[2]", "finite");
  *mesh.mutable_positions() = f64({3, 3}, {0, 0, 0, 1, 1e300, 0, 0, 1, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions[1]", "1e+300 does not fit f32");
  mesh = triangle();
  *mesh.mutable_normals() = f32({3, 3}, {0, 0, 0, 1, 0, 0, 0, INFINITY, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.normals[2]", "finite");
  *mesh.mutable_positions() =
      f32({2, 3, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 0, kNan, 0, 0, 0, 0, 0});
  *mesh.mutable_times() = f64({2}, {0, 1});
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions[1][1]", "finite");
  check(refusal("entity { light { intensity: nan } }"), kInvalid, "edits[3].entity.light.intensity",
        "finite");
  check(refusal("material { emission { value { x: 0 y: inf z: 0 } } }"), kInvalid,
        "edits[3].material.emission.value.y", "finite");
  check(refusal("settings { time: nan }"), kInvalid, "edits[3].settings.time", "finite");
  check(refusal("advance { dt: -1 }"), kInvalid, "edits[3].advance.dt", "more than 0");
  v1::Edit texture;
  *texture.mutable_texture()->mutable_texels() =
      array_of<u16>(v1::D_TYPE_F16, {2, 2}, {0, 0, 0, 0x7c00});
  check(refusal(texture), kInvalid, "edits[3].texture.texels[1][1]", "finite");
}

TEST_CASE("refusals: matrices") {
  std::vector<float> m = translations({0});
  m[12] = 1;
  check(pose_refusal(f32({4, 4}, m)), kInvalid, "edits[3].entity.pose.matrices", "0 0 0 1");
  m = translations({0});
  m[0] = 0;
  check(pose_refusal(f32({4, 4}, m)), kInvalid, "edits[3].entity.pose.matrices", "not invertible");
  m = translations({0});
  m[3] = kNan;
  check(pose_refusal(f32({4, 4}, m)), kInvalid, "edits[3].entity.pose.matrices", "finite");
  m = translations({0});
  m[0] = m[1] = m[4] = m[5] = 1;
  check(pose_refusal(f32({4, 4}, m)), kInvalid, "edits[3].entity.pose.matrices", "independent");
  v1::Edit edit;
  *edit.mutable_poses()->mutable_ids() = array_of<u64>(v1::D_TYPE_U64, {2}, {1, 2});
  m = translations({0, 0});
  m[16 + 10] = 0;
  *edit.mutable_poses()->mutable_matrices() = f32({2, 4, 4}, m);
  check(refusal(edit), kInvalid, "edits[3].poses.matrices[1]", "not invertible");
  *edit.mutable_poses()->mutable_matrices() = f32({1, 4, 4}, translations({0}));
  check(refusal(edit), kInvalid, "edits[3].poses.matrices.shape", "(N = 2, 4, 4)");
  v1::Edit keyed;
  *keyed.mutable_entity()->mutable_pose()->mutable_matrices() =
      f32({2, 4, 4}, translations({0, 0}));
  *keyed.mutable_entity()->mutable_pose()->mutable_times() = f64({2}, {1, 1});
  check(refusal(keyed), kInvalid, "edits[3].entity.pose.times[1]", "increase strictly");
  v1::Edit dome;
  *dome.mutable_settings()->mutable_dome()->mutable_rotation() =
      f32({3, 3}, {2, 0, 0, 0, 1, 0, 0, 0, 1});
  check(refusal(dome), kInvalid, "edits[3].settings.dome.rotation", "orthonormal");
}

TEST_CASE("refusals: scaled, sheared and mirrored poses are fine") {
  InlineSource source;
  for (const float s : {1e-6f, 1e-3f, -1.f, 1e6f}) {
    std::vector<float> m = translations({5});
    m[0] = s;
    m[1] = 0.3f * s;
    v1::Pose pose;
    *pose.mutable_matrices() = f32({4, 4}, m);
    CHECK(to_pose(pose, source));
  }
}

TEST_CASE("refusals: meshes") {
  v1::Mesh mesh = triangle();
  *mesh.mutable_indices() = u32s({2, 3}, {0, 1, 2, 0, 3, 1});
  check(refusal(mesh), kInvalid, "edits[3].mesh.indices[1]", "holds 3, but there are only 3 vert");
  *mesh.mutable_indices() = array_of<i32>(v1::D_TYPE_I32, {1, 3}, {0, 1, 2});
  check(refusal(mesh), kInvalid, "edits[3].mesh.indices.dtype", "is i32; send u32");
  *mesh.mutable_indices() = u32s({0, 3}, {});
  check(refusal(mesh), kInvalid, "edits[3].mesh.indices.shape", "F from 1");
  mesh = triangle();
  *mesh.mutable_uvs() = f32({2, 2}, {0, 0, 1, 1});
  check(refusal(mesh), kInvalid, "edits[3].mesh.uvs.shape", "is (2, 2); send (V = 3, 2)");
  mesh = triangle();
  mesh.mutable_positions()->mutable_inline_()->resize(35);
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions", "needs 36 bytes, 35 came");
  mesh = triangle();
  mesh.mutable_indices()->set_shape(0, ~0ull / 2);
  check(refusal(mesh), kInvalid, "edits[3].mesh.indices.shape", "F from 1");
  mesh.mutable_positions()->set_shape(0, 1ull << 62);
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions.shape", "V from 1");
  mesh = triangle();
  mesh.clear_positions();
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions", "is missing");
  mesh = triangle();
  mesh.clear_indices();
  *mesh.mutable_uvs() = f32({3, 2}, {0, 0, 0, 0, 0, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.indices", "send indices and positions");
  mesh = triangle();
  *mesh.mutable_parts() = u32s({1}, {1});
  check(refusal(mesh), kInvalid, "edits[3].mesh.parts[0]", "holds 1, but there are only 1 part");
  mesh = triangle();
  mesh.mutable_positions()->clear_source();
  check(refusal(mesh), kInvalid, "edits[3].mesh.positions", "has no bytes");
  mesh = triangle();
  *mesh.mutable_skeleton() = u32s({1, 2}, {0, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.skeleton[0]", "only 0 keypoints");
  mesh = triangle();
  mesh.add_symmetries();
  check(refusal(mesh), kInvalid, "edits[3].mesh.symmetries[0]", "either matrix or axis");
}

TEST_CASE("refusals: skins and morph targets") {
  v1::Mesh mesh = triangle();
  *mesh.mutable_joints() = array_of<u16>(v1::D_TYPE_U16, {3, 4}, std::vector<u16>(12));
  check(refusal(mesh), kInvalid, "edits[3].mesh.weights", "is missing");
  *mesh.mutable_weights() = f32({3, 4}, {1, 0, 0, 0, 0.5, 0.4, 0, 0, 1, 0, 0, 0});
  check(refusal(mesh), kInvalid, "edits[3].mesh.weights[1]", "sum to 1");
  mesh = triangle();
  *mesh.mutable_morph_normals() = f32({1, 3, 3}, std::vector<float>(9));
  check(refusal(mesh), kInvalid, "edits[3].mesh.morph_positions", "is missing");
}

TEST_CASE("refusals: parameters, cameras, references and lists of fields") {
  check(refusal("material { roughness { value: 1.5 } }"), kInvalid,
        "edits[3].material.roughness.value", "is 1.5; give a number in [0, 1]");
  check(refusal("material { iridescence_ior { value: 0.75 } }"), kInvalid,
        "edits[3].material.iridescence_ior.value", "is 0.75; give a number in [1, 4]");
  check(refusal("material { iridescence_thickness { value: -1 } }"), kInvalid,
        "edits[3].material.iridescence_thickness.value", "in [0, 10000]");
  check(refusal("material { base_color { texture { texture { name: 't' } channel: 1 } } }"),
        kInvalid, "edits[3].material.base_color.texture.channel", "scalar parameters only");
  check(refusal("material { clear: 'colour' }"), kInvalid, "edits[3].material.clear[0]",
        "'colour' is no field that can be cleared; these are: base_color, metallic");
  check(refusal("texture { clear: 'encoding' }"), kInvalid, "edits[3].texture.clear.encoding",
        "ENCODING_SRGB");
  check(refusal("entity { camera { width: 100000 height: 1 fx: 1 fy: 1 cx: 0 cy: 0 } }"), kInvalid,
        "edits[3].entity.camera.width", "give a number in [1, 16384]");
  check(refusal("entity { camera { width: 10 height: 1 fx: 1 fy: 1 cx: 0 } }"), kInvalid,
        "edits[3].entity.camera.cy", "(height - 1) / 2");
  const auto shutter = [](const std::string& fields) {
    return "entity { camera { width: 9 height: 9 fx: 1 fy: 1 cx: 4 cy: 4 shutter { " + fields +
           " } } }";
  };
  check(refusal(shutter("open: 2 close: 1")), kInvalid, "edits[3].entity.camera.shutter.close",
        "before open");
  check(refusal(shutter("close: 2000")), kInvalid, "edits[3].entity.camera.shutter.close",
        "[-1000, 1000]");
  check(refusal(shutter("rolling: -1")), kInvalid, "edits[3].entity.camera.shutter.rolling",
        "[0, 1000]");
  check(refusal("entity { materials { parts { name: 'a' } parts { } } }"), kInvalid,
        "edits[3].entity.materials.parts[1]", "set id (0 for nothing), name");
  check(refusal("entity { light { temperature: 100 } }"), kInvalid,
        "edits[3].entity.light.temperature", "[1000, 40000]");
  check(refusal("entity { light { sun_angle: 4 } }"), kInvalid, "edits[3].entity.light.sun_angle",
        "[0.0001, 3.14]");
  check(refusal("entity { light { unit: UNIT_ILLUMINANCE } }"), kInvalid,
        "edits[3].entity.light.unit", "sun_angle");
  check(refusal("entity { light { unit: UNIT_POWER sun_angle: 0.01 } }"), kInvalid,
        "edits[3].entity.light.unit", "irradiance");
  check(refusal("entity { light { two_sided: true sun_angle: 0.01 } }"), kInvalid,
        "edits[3].entity.light.two_sided", "for meshes");
  check(refusal("target { id: 0 } entity { }"), kInvalid, "edits[3].target.id", "leave the target");
  check(refusal("remove { }"), kInvalid, "edits[3].target", "say what to remove");
  check(refusal("target { name: 'a' } advance { dt: 1 }"), kInvalid, "edits[3].target", "leave it");
  check(refusal("mode: MODE_CREATE"), kInvalid, "edits[3]", "set one of its actions");
  check(refusal("volume { density {} }"), kInvalid, "edits[3].volume.density.values.dtype",
        "send f32");
  check(refusal("instances { prototype { pose { } } }"), kInvalid,
        "edits[3].instances.prototype.pose", "matrices");
}

TEST_CASE("refusals: unknown fields and enum values, by path and number") {
  v1::Edit edit;
  *edit.mutable_mesh() = triangle();
  edit.mutable_mesh()->GetReflection()->MutableUnknownFields(edit.mutable_mesh())->AddVarint(99, 1);
  check(refusal(edit), Code::kUnimplemented, "edits[3].mesh", "field 99 of heliograph.v1.Mesh");
  edit = {};
  edit.mutable_material()->set_alpha_mode(v1::Material::AlphaMode(17));
  check(refusal(edit), Code::kUnimplemented, "edits[3].material.alpha_mode", "value 17 of");
  edit = {};
  v1::Ref ref;
  ref.GetReflection()->MutableUnknownFields(&ref)->AddVarint(9, 1);
  (*edit.mutable_instantiate()->mutable_materials())["a"] = ref;
  check(refusal(edit), Code::kUnimplemented, "edits[3].instantiate.materials[0].value", "field 9");
}

template <class Detail>
std::optional<Detail> detail_of(const google::rpc::Status& status) {
  Detail detail;
  for (const google::protobuf::Any& any : status.details())
    if (any.UnpackTo(&detail)) return detail;
  return std::nullopt;
}

TEST_CASE("errors: details are bounded and inner errors are not spelled out") {
  Error error{Code::kFailedPrecondition, "in use; remove the users first", "edits[0]"};
  for (int i = 0; i < 10000; ++i) error.users.push_back(fmt::format("user {}", i));
  const google::rpc::Status status = to_proto(error);
  CHECK(detail_of<google::rpc::BadRequest>(status)->field_violations(0).field() == "edits[0]");
  const auto failure = detail_of<google::rpc::PreconditionFailure>(status);
  CHECK(failure->violations(1).subject() == "user 1");
  CHECK(failure->violations(1).type() == "IN_USE");
  CHECK(status.ByteSizeLong() < 4096);
  CHECK(status.message() == "edits[0]: in use; remove the users first");
  CHECK(detail_of<google::rpc::ErrorInfo>(status)->reason() == "IN_USE");
  CHECK(to_proto({Code::kInternal, "/root/secret: oops", ""}).message().find("secret") ==
        std::string::npos);
  const std::string much(100'000, 'x');
  Error long_one{Code::kNotFound, much, much};
  long_one.nearest = {std::string(1000, 'y'), std::string(1000, 'z')};
  CHECK(to_proto(long_one).ByteSizeLong() < 4096);
}

TEST_CASE("errors: a limit is told with its name, and when to retry") {
  const Error error{.code = Code::kResourceExhausted,
                    .message = "too many",
                    .where = "",
                    .limit = "tenant_jobs",
                    .needed = 3,
                    .available = 2,
                    .allowed = 10,
                    .retry_seconds = 1.25};
  const google::rpc::Status status = to_proto(error);
  const auto info = detail_of<google::rpc::ErrorInfo>(status);
  CHECK(info->domain() == "heliograph");
  CHECK(info->reason() == "BUSY");
  CHECK(info->metadata().at("limit") == "tenant_jobs");
  CHECK(info->metadata().at("needed") == "3");
  CHECK(info->metadata().at("used") == "8");
  CHECK(info->metadata().at("allowed") == "10");
  const auto quota = detail_of<google::rpc::QuotaFailure>(status);
  CHECK(quota->violations(0).quota_metric() == "tenant_jobs");
  CHECK(quota->violations(0).quota_value() == 10);
  const auto retry = detail_of<google::rpc::RetryInfo>(status)->retry_delay();
  CHECK(retry.seconds() == 1);
  CHECK(retry.nanos() == 250'000'000);
  CHECK_FALSE(detail_of<google::rpc::BadRequest>(status));
}

TEST_CASE("errors: every code has a reason of the contract") {
  for (int code = 1; code <= 16; ++code) {
    v1::ErrorReason reason;
    CHECK(v1::ErrorReason_Parse(
        "ERROR_REASON_" + reason_of({.code = Code(code), .message = "", .where = ""}), &reason));
  }
  CHECK(reason_of({.code = Code::kNotFound, .message = "", .where = "", .nearest = {"a"}}) ==
        "UNKNOWN_NAME");
  CHECK(reason_of({.code = Code::kResourceExhausted, .message = "", .where = "", .needed = 1}) ==
        "LIMIT_EXCEEDED");
}

TEST_CASE("the ends of a range are accepted as f32") {
  InlineSource source;
  for (const float angle : {1e-4f, 3.14f}) {
    CAPTURE(angle);
    v1::Transaction message;
    message.add_edits()->mutable_entity()->mutable_light()->set_sun_angle(angle);
    CHECK(to_transaction(message, source).has_value());
  }
}
