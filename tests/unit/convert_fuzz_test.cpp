// Structured mutations of valid transactions: whatever comes, an answer or a typed error with a
// path, and an accepted transaction survives the round trip.
#include <google/protobuf/util/message_differencer.h>

#include <cmath>
#include <random>

#include "server/convert/transaction.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using Random = std::mt19937_64;

constexpr std::array<double, 12> kNumbers{0,
                                          -0.0,
                                          1,
                                          -1,
                                          0.5,
                                          2,
                                          1e-30,
                                          1e30,
                                          1e300,
                                          -1e300,
                                          std::numeric_limits<double>::infinity(),
                                          std::numeric_limits<double>::quiet_NaN()};
constexpr std::array<u64, 8> kIntegers{0, 1, 2, 3, 255, 65536, 0xffffffffu, ~0ull};

double number(Random& random) { return kNumbers[random() % kNumbers.size()]; }
u64 integer(Random& random) { return kIntegers[random() % kIntegers.size()]; }

std::string bytes(Random& random) {
  std::string out(random() % 65, '\0');
  for (char& c : out) c = char(random() % 4 ? 0 : random());
  return out;
}

void mutate(Message& message, Random& random);

/// Gives a field that is no message a new value, appended where it repeats.
void set_scalar(Message& message, const FieldDescriptor* field, Random& random) {
  const auto* r = message.GetReflection();
  const bool many = field->is_repeated();
  switch (field->cpp_type()) {
#define HELIO_SET(TYPE, Name, value)                                                    \
  case FieldDescriptor::CPPTYPE_##TYPE:                                                 \
    many ? r->Add##Name(&message, field, value) : r->Set##Name(&message, field, value); \
    return;
    HELIO_SET(INT32, Int32, i32(integer(random)))
    HELIO_SET(INT64, Int64, i64(integer(random)))
    HELIO_SET(UINT32, UInt32, u32(integer(random)))
    HELIO_SET(UINT64, UInt64, integer(random))
    HELIO_SET(DOUBLE, Double, number(random))
    HELIO_SET(FLOAT, Float, float(number(random)))
    HELIO_SET(BOOL, Bool, bool(random() % 2))
    HELIO_SET(ENUM, EnumValue, int(random() % 9))
    HELIO_SET(STRING, String,
              field->type() == FieldDescriptor::TYPE_BYTES ? bytes(random) : std::string("name"))
#undef HELIO_SET
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return;
  }
}

/// Changes, adds or takes away one field somewhere beneath `message`.
void mutate(Message& message, Random& random) {
  const auto* descriptor = message.GetDescriptor();
  const auto* r = message.GetReflection();
  if (descriptor->field_count() == 0) return;
  const auto* field = descriptor->field(int(random() % u64(descriptor->field_count())));
  std::vector<const FieldDescriptor*> set;
  r->ListFields(message, &set);
  if (!set.empty() && random() % 4) field = set[random() % set.size()];
  const u64 dice = random() % 16;
  if (dice == 0) return r->ClearField(&message, field);
  if (dice == 1) {
    r->MutableUnknownFields(&message)->AddVarint(int(1 + random() % 200), random());
    return;
  }
  if (field->is_map()) return;
  if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE)
    return set_scalar(message, field, random);
  if (!field->is_repeated()) return mutate(*r->MutableMessage(&message, field), random);
  const int count = r->FieldSize(message, field);
  Message* element = count == 0 || dice < 4
                         ? r->AddMessage(&message, field)
                         : r->MutableRepeatedMessage(&message, field, int(random() % u64(count)));
  mutate(*element, random);
}

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
