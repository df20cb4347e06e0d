// Label columns of rendered frames against arithmetic, and the invariants every frame keeps.
#include <cstring>

#include "renderer/scene/motion.h"
#include "renderer/schedule/engine.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

const Column& column(const Frame& frame, const std::string& name) {
  for (const Column& c : frame.labels)
    if (c.name == name) return c;
  FAIL("no column " << name);
  std::terminate();
}
template <class T>
std::span<const T> values(const Frame& frame, const std::string& name) {
  const Column& c = column(frame, name);
  return {reinterpret_cast<const T*>(c.data.data()), c.data.size() / sizeof(T)};
}
u64 row_of(const Frame& frame, const std::string& name) {
  const auto& names = column(frame, "name").strings;
  const auto found = std::ranges::find(names, name);
  REQUIRE(found != names.end());
  return u64(found - names.begin());
}
bool in_mask(const Frame& frame, u64 row, u64 pixel) {
  const u64 bytes = (u64(frame.width) * frame.height + 7) / 8;
  return values<u8>(frame, "amodal_masks")[row * bytes + pixel / 8] >> (7 - pixel % 8) & 1;
}

RenderJob label_job(std::shared_ptr<const Snapshot> scene) {
  auto job =
      job_of(std::move(scene), {Plane::INSTANCE, Plane::DEPTH, Plane::POSITION,
                                Plane::POSITION_CAMERA, Plane::OBJECT_COORDINATES, Plane::NORMAL});
  job.labels = {.boxes = true, .amodal = true, .amodal_masks = true, .keypoints = true};
  return job;
}

struct Extent {
  i32 x0 = 0, y0 = 0, x1 = 0, y1 = 0;
  u32 count = 0;
  void add(i32 x, i32 y) {
    if (count++ == 0)
      x0 = x, y0 = y, x1 = x + 1, y1 = y + 1;
    else
      x0 = std::min(x0, x), y0 = std::min(y0, y), x1 = std::max(x1, x + 1),
      y1 = std::max(y1, y + 1);
  }
};

}  // namespace

TEST_CASE("labels: masks, boxes and counts agree with the instance plane") {
  auto engine = make_engine(2);
  const auto frame = render(*engine, label_job(still_life().apply()));
  const auto labels = values<u32>(*frame, "label");
  REQUIRE(labels.size() == 4);
  const auto plane = pixels<u32>(*frame);
  for (u64 row = 0; row < labels.size(); ++row) {
    Extent seen, alone;
    for (u32 y = 0; y < frame->height; ++y)
      for (u32 x = 0; x < frame->width; ++x) {
        const u64 pixel = u64(y) * frame->width + x;
        const bool mine = plane[pixel] == labels[row];
        if (mine) seen.add(i32(x), i32(y));
        if (in_mask(*frame, row, pixel)) alone.add(i32(x), i32(y));
        if (mine) CHECK(in_mask(*frame, row, pixel));
      }
    CHECK(values<u32>(*frame, "visible")[row] == seen.count);
    CHECK(values<u32>(*frame, "inside")[row] == alone.count);
    CHECK(values<u32>(*frame, "canvas")[row] >= alone.count);
    const auto box = values<i32>(*frame, "bbox_visible").subspan(4 * row, 4);
    CHECK(std::vector(box.begin(), box.end()) ==
          std::vector<i32>{seen.x0, seen.y0, seen.x1, seen.y1});
    const auto amodal = values<i32>(*frame, "bbox_amodal").subspan(4 * row, 4);
    CHECK(std::vector(amodal.begin(), amodal.end()) ==
          std::vector<i32>{alone.x0, alone.y0, alone.x1, alone.y1});
    for (const char* name : {"visibility", "occlusion", "truncation"}) {
      CHECK(values<float>(*frame, name)[row] >= 0);
      CHECK(values<float>(*frame, name)[row] <= 1);
    }
  }
}

TEST_CASE("labels: a half hidden square, by hand") {
  auto engine = make_engine();
  // Seen from height 4 with f = 32: a square of side 2 covers 16 x 16 pixels about the centre. A
  // larger screen above it hides the half with x < 0.
  const auto scene = Edits()
                         .mesh("quad", quad())
                         .object("square", "quad", scaled(vec3(2), vec3(0)))
                         .object("screen", "quad", scaled(vec3(4, 8, 1), {-2, 0, 1}))
                         .camera("camera", look_at({0, 0, 4}, vec3(0)), 32, 32, 32)
                         .apply();
  const auto frame = render(*engine, label_job(scene));
  const u64 row = row_of(*frame, "square");
  CHECK(values<u32>(*frame, "visible")[row] == 8 * 16);
  CHECK(values<u32>(*frame, "inside")[row] == 16 * 16);
  CHECK(values<u32>(*frame, "canvas")[row] == 16 * 16);
  CHECK(values<float>(*frame, "visibility")[row] == 0.5f);
  CHECK(values<float>(*frame, "occlusion")[row] == 0.5f);
  CHECK(values<float>(*frame, "truncation")[row] == 0);
  const auto box = values<i32>(*frame, "bbox_visible").subspan(4 * row, 4);
  CHECK(std::vector(box.begin(), box.end()) == std::vector<i32>{16, 8, 24, 24});
  // The screen: 4 x 8 at distance 3, left of the axis, so 42.7 pixels wide of which 16 are inside.
  const u64 screen = row_of(*frame, "screen");
  CHECK(values<float>(*frame, "truncation")[screen] > 0.5f);
  CHECK(values<u32>(*frame, "inside")[screen] == 16 * 32);

  const auto half = values<float>(*frame, "box_half_extents").subspan(3 * row, 3);
  CHECK(std::vector(half.begin(), half.end()) == std::vector<float>{1, 1, 0});
  const auto corner = values<float>(*frame, "corners_image").subspan(16 * row, 2);
  CHECK(corner[0] == Approx(7.5));   // x = -1: raster 8
  CHECK(corner[1] == Approx(23.5));  // y = -1: raster 24
}

TEST_CASE("labels: object coordinates and poses lead back to positions") {
  auto engine = make_engine();
  // A turned and stretched parent's frame, a child that hangs on it.
  mat4x3 pose = look_at({0.2f, 0.1f, 1}, {1, 0.5f, 1.3f});
  for (int i = 0; i < 3; ++i) pose[i] *= vec3(1, 2, 0.5f)[i];
  PutEntity child;
  child.parent = Ref(std::string("base"));
  child.mesh = Ref(std::string("cube"));
  child.pose = PosePatch{{}, {scaled(vec3(0.5f), {0.9f, 0, 0})}};
  const auto scene = Edits()
                         .mesh("cube", cube())
                         .object("base", "cube", pose)
                         .put("child", child)
                         .camera("camera", look_at({3, -4, 3}, {0, 0, 1}), 64, 48, 60)
                         .apply();
  const auto frame = render(*engine, label_job(scene));
  REQUIRE(column(*frame, "label").shape[0] == 1);  // the child belongs to the base
  CHECK(values<u8>(*frame, "rigid")[0] == 1);
  const auto scale = values<float>(*frame, "scale");
  CHECK(scale[0] == Approx(1));
  CHECK(scale[1] == Approx(2));
  CHECK(scale[2] == Approx(0.5));
  const auto center = values<float>(*frame, "box_center"),
             half = values<float>(*frame, "box_half_extents");
  CHECK(half[1] == Approx(1));
  CHECK(half[0] == Approx((0.5 + 1.15) / 2));
  const auto m = values<double>(*frame, "world_from_object");
  const auto plane = pixels<u32>(*frame);
  const auto positions = pixels<float>(*frame, 2), in_camera = pixels<float>(*frame, 3),
             coordinates = pixels<float>(*frame, 4), depth = pixels<float>(*frame, 1);
  u32 seen = 0;
  for (u64 i = 0; i < plane.size(); ++i) {
    if (plane[i] == 0) continue;
    ++seen;
    glm::dvec3 p;
    for (int a = 0; a < 3; ++a)
      p[a] = center[a] + half[a] * (2 * double(coordinates[3 * i + a]) - 1);
    for (int a = 0; a < 3; ++a) {
      const double world = m[4 * a] * p.x + m[4 * a + 1] * p.y + m[4 * a + 2] * p.z + m[4 * a + 3];
      CHECK(world == Approx(positions[3 * i + a]).margin(1e-5));
      CHECK(coordinates[3 * i + a] >= -1e-5f);
      CHECK(coordinates[3 * i + a] <= 1 + 1e-5f);
    }
    CHECK(depth[i] == in_camera[3 * i + 2]);
    const double x = frame->k[0][0] * in_camera[3 * i] / depth[i] + frame->k[2][0];
    const double y = frame->k[1][1] * in_camera[3 * i + 1] / depth[i] + frame->k[2][1];
    CHECK(x == Approx(i % frame->width).margin(0.01));
    CHECK(y == Approx(i / frame->width).margin(0.01));
  }
  CHECK(seen > 100);
}

TEST_CASE("labels: every labelled instance has a row, whatever hides it") {
  auto engine = make_engine();
  PutEntity hidden;
  hidden.visible = false;
  const auto scene = Edits()
                         .object("behind", "cube", translation({9, -9, 3}))
                         .put("ball", hidden)
                         .apply(*still_life().apply());
  const auto frame = render(*engine, label_job(scene));
  CHECK(column(*frame, "label").shape[0] == 5);
  for (const char* name : {"behind", "ball"}) {
    const u64 row = row_of(*frame, name);
    CHECK(values<u32>(*frame, "visible")[row] == 0);
    CHECK(values<u32>(*frame, "inside")[row] == 0);
    CHECK(values<float>(*frame, "visibility")[row] == 0);
    CHECK(values<i32>(*frame, "bbox_amodal")[4 * row + 2] == 0);
  }
}

TEST_CASE("labels: cut-outs have silhouettes with holes") {
  auto engine = make_engine();
  // The left half of the picture is a hole.
  auto image = std::make_shared<ImageData>();
  image->texels = ArrayOf(std::vector<u8>{0, 255}).buffer();
  image->width = 2;
  image->height = image->channels = 1;
  PutTexture texture{.image = image, .srgb = false, .nearest = true};
  PutMaterial cut;
  cut.alpha_mode = AlphaMode::kMask;
  cut.parameters[std::size_t(MaterialParameter::alpha)].texture =
      TextureUsePatch{Ref(std::string("half")), {}};
  const auto scene = Edits()
                         .mesh("quad", quad())
                         .put("half", texture)
                         .put("cut", cut)
                         .object("square", "quad", scaled(vec3(2), vec3(0)), "cut")
                         .object("screen", "quad", scaled(vec3(8), {0, 0, 1}))
                         .camera("camera", look_at({0, 0, 4}, vec3(0)), 32, 32, 32)
                         .apply();
  const auto frame = render(*engine, label_job(scene));
  const u64 row = row_of(*frame, "square");
  CHECK(values<u32>(*frame, "visible")[row] == 0);
  CHECK(values<u32>(*frame, "inside")[row] == 8 * 16);
  CHECK(values<i32>(*frame, "bbox_amodal")[4 * row] == 16);
}
