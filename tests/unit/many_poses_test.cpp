// Poses of many entities in one edit: checked, converted and applied by several threads as they
// would be one after the other.
#include <numeric>
#include <random>

#include "kernels/ingest/take.h"
#include "renderer/scene/invertible.h"
#include "server/convert/transaction.h"
#include "tests/unit/convert_fixture.h"
#include "tests/unit/stage.h"

using namespace heliograph;
using namespace heliograph::server;
using namespace heliograph::stage;

namespace {

constexpr u32 kMany = 20'000;
constexpr std::size_t kNumbers = 16;

/// Row by row; each somewhere else.
template <class T>
std::vector<T> matrices() {
  std::vector<T> numbers;
  for (u32 i = 0; i < kMany; ++i)
    for (const int n : {2, 0, 1, int(i), 0, 3, 0, 5, 0, 0, 4, 6, 0, 0, 0, 1})
      numbers.push_back(T(n));
  return numbers;
}

template <class T>
Expected<Transaction> converted(v1::DType type, const std::vector<T>& numbers) {
  std::vector<u64> ids(kMany);
  std::iota(ids.begin(), ids.end(), 1);
  v1::Transaction message;
  v1::Poses* poses = message.add_edits()->mutable_poses();
  *poses->mutable_ids() = array_of<u64>(v1::D_TYPE_U64, {kMany}, ids);
  *poses->mutable_matrices() = array_of<T>(type, {kMany, 4, 4}, numbers);
  InlineSource source;
  return to_transaction(message, source);
}

template <class T>
void check_converted(v1::DType type) {
  const auto transaction = converted(type, matrices<T>());
  REQUIRE(transaction);
  const auto& poses = std::get<Poses>(transaction->edits[0].action);
  REQUIRE(poses.matrices.size() == kMany);
  REQUIRE(poses.ids.size() == kMany);
  for (u32 i = 0; i < kMany; ++i) {
    const mat4x3 wanted(2, 0, 0, 0, 3, 0, 1, 0, 4, float(i), 5, 6);
    if (poses.matrices[i] != wanted || poses.ids[i].value != i + 1) FAIL("at " << i);
  }
}

/// What is wrong once a number of a matrix is another.
template <class T>
struct Wrong {
  std::size_t matrix, number;
  T value;
};
template <class T>
std::string refusal(v1::DType type, const std::vector<Wrong<T>>& wrong) {
  auto numbers = matrices<T>();
  for (const auto& each : wrong) numbers[kNumbers * each.matrix + each.number] = each.value;
  const auto transaction = converted(type, numbers);
  REQUIRE_FALSE(transaction);
  CHECK(transaction.error().code == Code::kInvalidArgument);
  return transaction.error().where + ": " + transaction.error().message;
}

/// A scene of many, which have been moved, and the poses they were given.
struct Crowd : Stage {
  Crowd() {
    Instances many{.prototype = {}, .matrices = std::vector(kMany, mat4x3(1))};
    (*this)({named("p", many)});
    for (u32 i = 0; i < kMany; ++i) ids.push_back(now->entity_id(i));
  }
  void move(std::vector<Id> which, std::vector<mat4x3> to, bool teleport = false) {
    (*this)({anonymous(Poses{ArrayOf(std::move(which)), ArrayOf(std::move(to)), teleport})});
  }
  std::vector<Id> ids;
};

std::vector<mat4x3> places(u32 count, float first) {
  std::vector<mat4x3> made;
  for (u32 i = 0; i < count; ++i) made.push_back(at(first + float(i)));
  return made;
}

}  // namespace

TEST_CASE("many poses: converted in their order") {
  check_converted<float>(v1::D_TYPE_F32);
  check_converted<double>(v1::D_TYPE_F64);
}

TEST_CASE("many poses: the first that is not finite, then not affine, then not invertible") {
  constexpr auto kType = v1::D_TYPE_F32;
  using List = std::vector<Wrong<float>>;
  const Wrong<float> flat{300, 0, 0}, late_flat{19'000, 10, 0};
  const Wrong<float> tilted{9'000, 12, 1}, infinite{15'000, 3, INFINITY}, nan{15'000, 15, NAN};
  const std::string where = "edits[0].poses.matrices";
  CHECK(refusal(kType, List{late_flat, flat}).starts_with(where + "[300]: is not invertible"));
  CHECK(refusal(kType, List{late_flat}).starts_with(where + "[19000]: is not invertible"));
  CHECK(refusal(kType, List{flat, tilted}).starts_with(where + "[9000]: has the last row 1 0 0 1"));
  CHECK(refusal(kType, List{flat, tilted, infinite}).starts_with(where + "[15000]: is NaN"));
  CHECK(refusal(kType, List{nan}).starts_with(where + "[15000]: is NaN"));
  CHECK(refusal(v1::D_TYPE_F64, std::vector<Wrong<double>>{{7'000, 3, 1e300}, {4, 0, 0}})
            .starts_with(where + "[7000]: 1e+300 does not fit f32"));
}

TEST_CASE("many poses: what is plainly invertible is invertible") {
  std::mt19937 engine(7);
  std::uniform_real_distribution<float> uniform(-1, 1), exponent(-24, 24);
  u32 plain = 0, close = 0;
  for (int i = 0; i < 400'000; ++i) {
    mat4x3 m(1);
    const float span = i % 3 == 0 ? 1.0f : 0.2f;
    for (int axis = 0; axis < 3; ++axis)
      m[axis] = vec3(uniform(engine), uniform(engine), uniform(engine)) *
                std::exp2(span * exponent(engine));
    // Nearly in one plane.
    if (i % 2) m[2] = m[0] + m[1] * uniform(engine) + m[2] * std::exp2(0.5f * exponent(engine));
    if (kernels::plainly_invertible(m)) {
      ++plain;
      if (!invertible(m)) FAIL("not invertible");
      const glm::dvec3 x(m[0]), y(m[1]), z(m[2]);
      close += std::abs(glm::dot(x, glm::cross(y, z))) <
               1.1e-4 * glm::length(x) * glm::length(y) * glm::length(z);
    }
  }
  CHECK(plain > 50'000);
  CHECK(close > 0);
}

TEST_CASE("many poses: applied as if one after the other, in any order and more than once") {
  Crowd scene;
  const auto before = scene.now;
  scene.move(scene.ids, places(kMany, 1));
  for (u32 i = 0; i < kMany; ++i)
    if (scene.now->poses[i] != at(1 + float(i))) FAIL("at " << i);
  CHECK(before->poses[kMany - 1] == mat4x3(1));

  auto shuffled = scene.ids;
  std::shuffle(shuffled.begin(), shuffled.end(), std::mt19937(3));
  shuffled.insert(shuffled.end(), scene.ids.begin(), scene.ids.begin() + 700);
  std::vector<mat4x3> wanted(kMany);
  const auto to = places(u32(shuffled.size()), 50);
  for (std::size_t k = 0; k < shuffled.size(); ++k) wanted[shuffled[k].index()] = to[k];
  scene.move(shuffled, to);
  for (u32 i = 0; i < kMany; ++i)
    if (scene.now->poses[i] != wanted[i]) FAIL("at " << i);
}

TEST_CASE("many poses: as many ids as a chunk has rows, one of them twice, leave a row as it was") {
  Crowd scene;
  const std::vector<Id> some(scene.ids.begin(), scene.ids.begin() + 1024);
  auto twice = some;
  twice[301] = twice[300];
  scene.move(twice, places(1024, 1));
  CHECK(scene.now->poses[300] == at(302));
  CHECK(scene.now->poses[301] == mat4x3(1));
  CHECK(scene.now->poses[302] == at(303));
  std::swap(twice[301] = some[301], twice[302]);
  scene.move(twice, places(1024, 1));
  CHECK(scene.now->poses[301] == at(303));
  CHECK(scene.now->poses[302] == at(302));
}

TEST_CASE("many poses: only chunks in which something moves are cloned") {
  Crowd scene;
  scene.move(scene.ids, places(kMany, 1));
  const auto before = scene.now;
  auto to = places(kMany, 1);
  to[1000] = at(-1);
  scene.move(scene.ids, to);
  CHECK(scene.now->poses[1000] == at(-1));
  for (u32 c = 0; c < before->poses.chunk_count(); ++c)
    if (scene.now->poses.shares(c, before->poses) == (c == 1000 / 256)) FAIL("chunk " << c);
  scene.move(scene.ids, to);
  CHECK(scene.now->entities.same(before->entities));
}

TEST_CASE("many poses: the first id that is none is named, and nothing changes") {
  Crowd scene;
  scene({named("p/7000", Remove{}), named("p/19000", Remove{}), named("m", PutMaterial{})});
  const auto refused = [&](std::vector<Id> ids) {
    const u32 count = u32(ids.size());
    return scene.refuses({anonymous(Poses{ArrayOf(std::move(ids)), ArrayOf(places(count, 0))})});
  };
  CHECK(refused(scene.ids).where == "edits[0].poses.ids[7000]");
  CHECK(refused(scene.ids).code == Code::kNotFound);
  std::vector<Id> backwards(scene.ids.rbegin(), scene.ids.rend());
  CHECK(refused(backwards).where == "edits[0].poses.ids[999]");
  backwards[500] = scene.id("m");
  CHECK(refused(backwards).where == "edits[0].poses.ids[500]");
  CHECK(refused(backwards).code == Code::kInvalidArgument);
}

TEST_CASE("many poses: keys end, and what teleports jumps") {
  Crowd scene;
  const PutEntity keyed{.pose = PosePatch{.times = {0, 1}, .matrices = {at(0), at(1)}}};
  scene({named("p/12000", keyed), anonymous(Advance{.dt = 0.5})});
  REQUIRE(scene.now->keyed == 1);
  scene.move(scene.ids, places(kMany, 0));
  CHECK(scene.now->keyed == 0);
  CHECK(scene.entity("p/12000").teleported == 0);
  CHECK(scene.pose("p/12000") == at(12000));
  scene.move(scene.ids, places(kMany, 1), true);
  CHECK(scene.entity("p/12000").teleported == 1);
  CHECK(scene.entity("p/3").teleported == 1);
}

TEST_CASE(
    "many poses: those of a pool are the scene's without a copy, where they are whole chunks") {
  Crowd scene;
  for (const auto kind : {Buffer::Kind::kAny, Buffer::Kind::kPooled}) {
    const ArrayOf all(places(kMany, kind == Buffer::Kind::kAny ? 1 : 2));
    const ArrayOf<mat4x3> matrices(
        std::make_shared<const Buffer>(all.buffer(), all.buffer()->bytes(), kind));
    // The first entity stays: its chunk is written row by row.
    const ArrayOf<mat4x3> most(std::make_shared<const Buffer>(
        matrices.buffer(), matrices.buffer()->bytes().subspan(sizeof(mat4x3)), kind));
    scene({anonymous(
        Poses{ArrayOf(std::vector(scene.ids.begin() + 1, scene.ids.end())), most, false})});
    const bool is_shared = kind == Buffer::Kind::kPooled;
    CHECK(scene.now->poses.chunk(0).data() != matrices.data());
    CHECK((scene.now->poses.chunk(1).data() == &matrices[256]) == is_shared);
    CHECK((scene.now->poses.chunk(77).data() == &matrices[256 * 77]) == is_shared);
    for (u32 i = 1; i < kMany; ++i) REQUIRE(scene.now->poses[i] == matrices[i]);
    CHECK(scene.now->poses[0] == mat4x3(1));
  }
  const auto before = scene.now;
  scene.move({scene.ids[300]}, {at(9)});
  CHECK(scene.now->poses[300] == at(9));
  CHECK(before->poses[300] == at(302));
}
