// Labels and questions over the kernels' BVH against those over Embree: the same columns, but for
// the few rays that pass an edge within rounding.
#include <bit>

#include "renderer/backend/embree/host_tracer.h"
#include "renderer/bvh/host_tracer.h"
#include "renderer/host/labels.h"
#include "renderer/host/queries.h"
#include "tests/unit/bvh_scene.h"

using namespace heliograph;
using namespace heliograph::test;
using host::SceneRays;

namespace {

/// Scenes and their rays by one of the two.
class Side {
 public:
  virtual ~Side() = default;
  [[nodiscard]] virtual SceneRays rays(std::shared_ptr<const resident::ResidentScene> scene) = 0;

  [[nodiscard]] SceneRays at(const std::shared_ptr<const Snapshot>& snapshot, TimeSpan span) {
    auto scene = store().prepare(snapshot, span, Interrupt{});
    REQUIRE(scene.has_value());
    return rays(*std::move(scene));
  }

 protected:
  [[nodiscard]] virtual resident::SceneStore& store() = 0;
  resident::DerivedCache cache_{1u << 30};
};
class EmbreeSide final : public Side {
 public:
  SceneRays rays(std::shared_ptr<const resident::ResidentScene> scene) override {
    auto tracer = std::make_unique<embree::EmbreeHostTracer>(embree::traced(*scene));
    return {std::move(scene), std::move(tracer)};
  }

 private:
  resident::SceneStore& store() override { return store_; }
  embree::DeviceHandle device_{rtcNewDevice(nullptr)};
  embree::EmbreeAccelerator accelerator_{device_.get(), 0};
  resident::SceneStore store_{accelerator_, cache_, 1u << 30};
};
class BvhSide final : public Side {
 public:
  SceneRays rays(std::shared_ptr<const resident::ResidentScene> scene) override {
    auto tracer = std::make_unique<bvh::BvhHostTracer>(*scene);
    return {std::move(scene), std::move(tracer)};
  }

 private:
  resident::SceneStore& store() override { return store_; }
  bvh::BvhAccelerator accelerator_{0};
  resident::SceneStore store_{accelerator_, cache_, 1u << 30};
};

/// Elements of two columns that are not the same; of floats, to rounding.
template <class T>
u64 differing(const Column& a, const Column& b) {
  const auto *x = reinterpret_cast<const T*>(a.data.data()),
             *y = reinterpret_cast<const T*>(b.data.data());
  u64 count = 0;
  for (u64 i = 0; i < a.data.size() / sizeof(T); ++i)
    if constexpr (std::floating_point<T>)
      count += !(x[i] == y[i] || (std::isnan(x[i]) && std::isnan(y[i])) ||
                 std::abs(x[i] - y[i]) <= T(1e-4) * (1 + std::abs(x[i])));
    else
      count += x[i] != y[i];
  return count;
}
u64 differing_bits(const Column& a, const Column& b) {
  u64 count = 0;
  for (u64 i = 0; i < a.data.size(); ++i) count += u64(std::popcount(u8(a.data[i] ^ b.data[i])));
  return count;
}
u64 set_bits(const Column& column) {
  u64 count = 0;
  for (const std::byte byte : column.data) count += u64(std::popcount(u8(byte)));
  return count;
}

u64 differing(const Column& a, const Column& b) {
  switch (a.dtype) {
    case DType::kF32:
      return differing<float>(a, b);
    case DType::kF64:
      return differing<double>(a, b);
    case DType::kU8:
      return differing<u8>(a, b);
    default:
      return size_of(a.dtype) == 8 ? differing<u64>(a, b) : differing<u32>(a, b);
  }
}

/// Checks that two answers are of the same columns, of which at most one element in `most` differs.
void check_same(const std::vector<Column>& a, const std::vector<Column>& b, u64 most) {
  REQUIRE(a.size() == b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    INFO(a[i].name);
    CHECK(a[i].name == b[i].name);
    CHECK(a[i].dtype == b[i].dtype);
    CHECK(a[i].shape == b[i].shape);
    CHECK(a[i].strings == b[i].strings);
    REQUIRE(a[i].data.size() == b[i].data.size());
    if (a[i].name == "amodal_masks") {
      CHECK(set_bits(a[i]) > 10'000);
      CHECK(differing_bits(a[i], b[i]) <= set_bits(a[i]) / most);
    } else {
      CHECK(differing(a[i], b[i]) <= a[i].data.size() / size_of(a[i].dtype) / most);
    }
  }
}

/// A random scene of everything, cubes with keypoints, and a camera that looks at it all and reads
/// its rows one after another.
std::shared_ptr<const Snapshot> scene_with_camera(double rolling) {
  Random random(3);
  auto topology = std::make_shared<MeshTopology>();
  auto vertices = std::make_shared<VertexKeys>();
  Shape shape = cube();
  topology->vertex_count = u32(shape.positions.size());
  topology->triangles = ArrayOf(std::move(shape.triangles));
  for (u32 i = 0; i < topology->vertex_count; ++i)
    topology->keypoints.push_back({fmt::format("corner {}", i), shape.positions[i]});
  vertices->times = {0};
  vertices->positions = ArrayOf(std::move(shape.positions));
  Edits edits;
  edits.put("dotted", PutMesh{topology, vertices});
  for (u32 i = 0; i < 20; ++i)
    edits.object(fmt::format("dotted {}", i), "dotted", random_pose(random, 6, 1));
  PutEntity camera;
  camera.pose = PosePatch{{}, {look_at({9, -14, 8}, vec3(0))}};
  camera.camera = Camera{.width = 320,
                         .height = 240,
                         .fx = 240,
                         .fy = 240,
                         .cx = 159.5,
                         .cy = 119.5,
                         .shutter = {.rolling = rolling}};
  edits.put("camera", camera);
  return edits.apply(*random_scene(random, {.count = 20, .curves = true}));
}

std::vector<Column> labels_of(Side& side, const RenderJob& job, const TimeSpan& span) {
  const SceneRays rays = side.at(job.snapshot, span);
  const auto film = host::HostFilm::create(
      {.job = std::make_shared<const RenderJob>(job), .open = rays.scene, .still = rays.scene});
  REQUIRE(film.has_value());
  auto columns = host::labels(**film, rays, {});
  REQUIRE(columns.has_value());
  return *std::move(columns);
}

QueryResult answer_of(Side& side, const QueryJob& job) {
  const SceneRays rays = side.at(job.snapshot, {job.time, job.time});
  const auto scene_at = [&](Time time) -> Expected<SceneRays> {
    return side.at(job.snapshot, {time, time});
  };
  auto result = host::answer(rays, job, scene_at, {});
  if (!result) FAIL(result.error().where << ": " << result.error().message);
  return *std::move(result);
}

/// Entities of a scene that show a mesh and are seen by the camera's rays.
std::vector<EntityId> some_entities(const Snapshot& snapshot, const char* kind, u32 count) {
  std::vector<EntityId> out;
  for (u32 i = 0; i < count; ++i) out.push_back(entity(snapshot, fmt::format("{} {}", kind, i)));
  return out;
}

constexpr u64 kMost = 2000;  // one element in so many may differ

}  // namespace

TEST_CASE("host answers: labels over the BVH are those over Embree") {
  EmbreeSide embree;
  BvhSide bvh;
  double rolling = 0;
  SECTION("at an instant") {}
  SECTION("of rows at different times") { rolling = 1; }
  RenderJob job = job_of(scene_with_camera(rolling), {Plane::INSTANCE});
  job.time = 0.25;
  job.labels = {.boxes = true, .amodal = true, .amodal_masks = true, .keypoints = true};
  const TimeSpan span{job.time, job.time + rolling};
  check_same(labels_of(embree, job, span), labels_of(bvh, job, span), kMost);
}

TEST_CASE("host answers: questions over the BVH are answered as over Embree") {
  EmbreeSide embree;
  BvhSide bvh;
  QueryJob job{.snapshot = scene_with_camera(0), .time = 0.25, .query = {}, .origin = {}};
  const EntityId camera = entity(*job.snapshot, "camera");
  Random random(4);
  const auto check = [&] { check_same(answer_of(embree, job), answer_of(bvh, job), kMost); };
  SECTION("rays") {
    CastRays cast;
    for (u32 i = 0; i < 20'000; ++i) {
      cast.origins.push_back(random_vec3(random, 12));
      cast.directions.push_back(random_direction(random));
    }
    job.query = cast;
    check();
    cast.any_hit = true;
    cast.t_max = 3;
    job.query = cast;
    check();
  }
  SECTION("picks") {
    Pick pick{.camera = camera};
    for (u32 i = 0; i < 10'000; ++i) pick.pixels.push_back(random.next2() * vec2(320, 240));
    job.query = pick;
    check();
  }
  SECTION("visible entities") {
    job.query = Visible{.camera = camera, .entities = some_entities(*job.snapshot, "dotted", 20)};
    check();
  }
  SECTION("overlaps") {
    job.query = Overlaps{.a = some_entities(*job.snapshot, "dotted", 20),
                         .b = some_entities(*job.snapshot, "still", 20)};
    check();
  }
  SECTION("tracks") {
    Tracks tracks{.camera = camera, .times = {0, 0.3, 0.9}};
    for (const EntityId moving : some_entities(*job.snapshot, "moving", 20))
      for (u32 i = 0; i < 100; ++i) tracks.points.push_back({moving, i % 2, random.next2() * 0.5f});
    // A place of a strand's segment lies on it as a triangle's does.
    for (const EntityId strands : some_entities(*job.snapshot, "strands", 20))
      for (u32 i = 0; i < 20; ++i)
        tracks.points.push_back({strands, i, vec2(3 * random.next() - 1, random.next())});
    job.query = tracks;
    check();
  }
}
