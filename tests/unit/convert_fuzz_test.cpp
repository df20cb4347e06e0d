// Structured mutations of valid requests: whatever comes, an answer or a typed error with a path,
// and an accepted transaction survives the round trip. tests/fuzz/run does the same for longer.
#include <filesystem>
#include <fstream>
#include <iterator>

#include "server/convert/transaction.h"
#include "tests/fuzz/attempt.h"
#include "tests/fuzz/mutate.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;
using fuzz::mutate;
using fuzz::Random;

namespace {

v1::Transaction seed() {
  v1::Transaction message;
  v1::Mesh mesh = triangle();
  *mesh.mutable_uvs() = f32({3, 2}, {0, 0, 1, 0, 0, 1});
  *mesh.mutable_parts() = u32s({1}, {0});
  *mesh.mutable_weights() = f32({3, 4}, {1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0});
  *mesh.mutable_joints() = array_of<u16>(v1::D_TYPE_U16, {3, 4}, std::vector<u16>(12));
  *message.add_edits()->mutable_mesh() = mesh;
  v1::Entity* entity = message.add_edits()->mutable_entity();
  *entity->mutable_pose()->mutable_matrices() = f32({2, 4, 4}, translations({1, 2}));
  *entity->mutable_pose()->mutable_times() = f64({2}, {0, 1});
  v1::Camera* camera = entity->mutable_camera();
  camera->set_width(4), camera->set_height(4), camera->set_fx(4), camera->set_fy(4);
  camera->set_cx(1), camera->set_cy(1);
  *entity->mutable_morph_weights()->mutable_weights() = f32({2}, {0, 1});
  v1::Texture* texture = message.add_edits()->mutable_texture();
  *texture->mutable_texels() = f32({1, 2, 3}, {1, 2, 3, 4, 5, 6});
  v1::Material* material = message.add_edits()->mutable_material();
  material->mutable_roughness()->set_value(0.5);
  material->mutable_base_color()->mutable_texture()->mutable_texture()->set_name("t");
  v1::Poses* poses = message.add_edits()->mutable_poses();
  *poses->mutable_ids() = array_of<u64>(v1::D_TYPE_U64, {1}, {7});
  *poses->mutable_matrices() = f32({1, 4, 4}, translations({1}));
  message.add_edits()->mutable_settings()->mutable_dome()->set_intensity(1);
  message.add_edits()->mutable_advance()->set_dt(1);
  return message;
}

}  // namespace

TEST_CASE("fuzz: mutated transactions are taken whole or refused with a path") {
  Random random(1);
  const v1::Transaction valid = seed();
  int taken = 0, refused = 0;
  for (int i = 0; i < 15000; ++i) {
    v1::Transaction message = valid;
    for (u64 n = 1 + random() % 4; n > 0; --n) mutate(message, random);
    InlineSource source;
    const auto transaction = to_transaction(message, source);
    if (!transaction) {
      ++refused;
      const Error& error = transaction.error();
      INFO(message.ShortDebugString());
      REQUIRE(!error.message.empty());
      const bool typed = error.code == Code::kInvalidArgument || error.code == Code::kNotFound ||
                         error.code == Code::kUnimplemented;
      REQUIRE(typed);
      const bool placed = error.where.starts_with("edits[") || error.code == Code::kUnimplemented;
      REQUIRE(placed);
      continue;
    }
    ++taken;
    const v1::Transaction once = to_proto(*transaction, inline_sink);
    const auto again = to_transaction(once, source);
    INFO(message.ShortDebugString());
    if (!again) INFO(again.error().where << ": " << again.error().message);
    REQUIRE(again);
    const v1::Transaction twice = to_proto(*again, inline_sink);
    REQUIRE(once.SerializeAsString() == twice.SerializeAsString());
  }
  CHECK(taken > 500);
  CHECK(refused > 500);
}

TEST_CASE("fuzz: the corpus and its mutants are taken or refused with a path") {
  int inputs = 0;
  const std::filesystem::path corpus = HELIOGRAPH_SOURCE_DIR "/tests/fuzz/corpus";
  for (const auto& entry : std::filesystem::directory_iterator(corpus)) {
    std::ifstream file(entry.path(), std::ios::binary);
    const std::string data(std::istreambuf_iterator<char>(file), {});
    INFO(entry.path());
    const auto message = fuzz::parse(data);
    REQUIRE(message);
    CHECK(fuzz::attempt(*message) == "");
    Random random(++inputs);
    for (int i = 0; i < 30; ++i) {
      const std::unique_ptr<google::protobuf::Message> mutant(message->New());
      mutant->CopyFrom(*message);
      for (u64 n = 1 + random() % 4; n > 0; --n) mutate(*mutant, random);
      const std::string fault = fuzz::attempt(*mutant);
      INFO(mutant->ShortDebugString());
      REQUIRE(fault == "");
    }
  }
  CHECK(inputs > 20);
}
