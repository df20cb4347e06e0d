// RenderRequest to RenderJob, and frames back: every refusal of the issue's list, its path and
// remedy; every plane of the contract.
#include "server/convert/render.h"

#include <fmt/format.h>
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/json_util.h>

#include <array>
#include <cmath>
#include <cstring>
#include <set>

#include "renderer/frame/frame_header.h"
#include "renderer/scene/scene.h"
#include "server/convert/frame_headers.h"
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

/// Two cameras, "left" and "right", and "rock" without one; at 2 s, 0.5 s after an advance.
std::shared_ptr<const Snapshot> snapshot() {
  InlineSource source;
  const auto message = parse<v1::Transaction>(R"(
    edits { target { name: 'left' }
            entity { camera { width: 64 height: 48 fx: 50 fy: 50 cx: 31.5 cy: 23.5 } } }
    edits { target { name: 'right' }
            entity { camera { width: 64 height: 48 fx: 50 fy: 50 cx: 31.5 cy: 23.5 } } }
    edits { target { name: 'rock' } entity { } }
    edits { target { name: 'paint' } material { } }
    edits { settings { time: 1.5 } }
    edits { advance { dt: 0.5 } })");
  auto transaction = to_transaction(message, source);
  REQUIRE(transaction);
  auto prepared = apply(Snapshot{}, *transaction, {});
  REQUIRE(prepared);
  return prepared->snapshot;
}

const std::string kShot = "scene: 5 cameras { name: 'left' } planes { plane: PLANE_BEAUTY } ";
const std::string kGood = kShot + "spp: 4 ";

Expected<RenderJob> job(const std::string& text) {
  return to_job(parse<v1::RenderRequest>(text), snapshot(), {});
}

void refused(const std::string& text, Code code, const std::string& where,
             const std::string& says) {
  const auto made = job(text);
  REQUIRE(!made);
  INFO(made.error().where << ": " << made.error().message);
  CHECK(int(made.error().code) == int(code));
  CHECK(made.error().where == where);
  CHECK(made.error().message.find(says) != std::string::npos);
}

constexpr Code kInvalid = Code::kInvalidArgument;

}  // namespace

TEST_CASE("render: a request's defaults") {
  const auto made = job(kGood);
  REQUIRE(made);
  CHECK(made->scene == 5);
  CHECK(made->cameras.size() == 1);
  CHECK(made->planes == std::vector<Plane>{Plane::BEAUTY});
  CHECK(made->time == 2.0);
  CHECK(made->frame_interval == 0.5);
  CHECK(made->stop.spp == 4);
  CHECK(made->settings.max_depth == 12);
  CHECK(made->settings.roulette_depth == 3);
  CHECK(std::isinf(made->settings.clamp));
  CHECK(made->settings.filter == kernels::PixelFilter::kBlackmanHarris);
  CHECK(made->overlay == 0);
  CHECK(made->labels.canvas == 1);
  CHECK(made->labels.max_rows == 65536);
}

TEST_CASE("render: every plane is built") {
  int built = 0;
  for (int number = v1::Plane_MIN; number <= v1::Plane_MAX; ++number) {
    if (number == 0 || !v1::Plane_IsValid(number)) continue;
    const auto plane = to_plane(v1::Plane(number));
    REQUIRE(plane);
    ++built;
    CHECK(int(to_proto(*plane)) == number);
  }
  CHECK(built == int(kernels::kPlanes));
}

TEST_CASE("render: refusals") {
  refused("planes { plane: PLANE_DEPTH }", kInvalid, "cameras", "name 1 to");
  refused("planes { plane: PLANE_DEPTH } cameras { name: 'lefd' }", Code::kNotFound, "cameras[0]",
          "lefd");
  refused("planes { plane: PLANE_DEPTH } cameras { name: 'left' } cameras { name: 'rock' }",
          kInvalid, "cameras[1]", "'rock' has no camera");
  refused("planes { plane: PLANE_DEPTH } cameras { name: 'paint' }", kInvalid, "cameras[0]",
          "is not of the kind entity");
  refused("planes { plane: PLANE_DEPTH } cameras { id: 77 }", Code::kNotFound, "cameras[0].id",
          "no object 77");
  refused("cameras { name: 'left' }", kInvalid, "planes", "at least one plane, or for labels");
  refused("cameras { name: 'left' } planes { }", kInvalid, "planes[0]", "name a plane");
  refused(kGood + "planes { plane: PLANE_BEAUTY }", kInvalid, "planes[1]", "twice");
  refused(kGood + "planes { plane: PLANE_DISPARITY }", kInvalid, "planes[1].camera",
          "second camera");
  refused(kGood + "planes { plane: PLANE_DEPTH camera { name: 'right' } }", kInvalid,
          "planes[1].camera", "disparity planes");
  refused(kGood + "planes { plane: PLANE_DISPARITY camera { name: 'rigth' } }", Code::kNotFound,
          "planes[1].camera", "rigth");
  refused(kGood + "planes { plane: PLANE_DEPTH group: 'a' }", kInvalid, "planes[1].group",
          "leave it out");
  refused(kGood + "width: 0 height: 10", kInvalid, "width", "[1, 16384]");
  refused(kGood + "width: 10 height: 100000", kInvalid, "height", "[1, 16384]");
  refused(kGood + "width: 10", kInvalid, "height", "give both");
  refused(kShot + "spp: 1000000000", kInvalid, "spp", "[1, 1048576]");
  refused(kShot + "spp: 0", kInvalid, "spp", "[1, 1048576]");
  refused("cameras { name: 'left' } planes { plane: PLANE_VARIANCE }", kInvalid, "spp",
          "set spp, seconds or noise");
  refused(kGood + "seconds: nan", kInvalid, "seconds", "finite");
  refused(kGood + "noise: -1", kInvalid, "noise", "");
  refused(kGood + "clamp_indirect: 0", kInvalid, "clamp_indirect", "");
  refused(kGood + "tile_rounds: 3", kInvalid, "tile_rounds", "set adaptive");
  refused(kGood + "time: inf", kInvalid, "time", "finite");
  refused(kGood + "frame_interval: 0", kInvalid, "frame_interval", "seconds to the next frame");
  refused(kGood + "max_depth: 0", kInvalid, "max_depth", "[1, 1024]");
  refused(kGood + "vertex: 1 labels { boxes: true }", kInvalid, "vertex", "labels");
  refused(kGood + "vertex: 1 through_transmission: true", kInvalid, "vertex", "through");
  refused(kGood + "vertex: 1025", kInvalid, "vertex", "[0, 1024]");
  refused(kGood + "roulette_depth: 0", kInvalid, "roulette_depth", "[1, 1024]");
  refused(kGood + "priority: -101", kInvalid, "priority", "[-100, 100]");
  refused(kGood + "clamp: -1", kInvalid, "clamp", "");
  refused(kGood + "labels { canvas: nan }", kInvalid, "labels.canvas", "finite");
  v1::RenderRequest unknown = parse<v1::RenderRequest>(kGood);
  unknown.add_planes()->set_plane(v1::Plane(4711));
  const auto made = to_job(unknown, snapshot(), {});
  REQUIRE(!made);
  CHECK(int(made.error().code) == int(Code::kUnimplemented));
  CHECK(made.error().where == "planes[1].plane");
}

TEST_CASE("render: planes that stay on the GPU are those that are made there") {
  const std::string there = "memory: FRAME_MEMORY_CUDA ";
  CHECK(job(kGood + there)->on_device);
  CHECK_FALSE(job(kGood)->on_device);
  CHECK(job(kGood + there + "planes { plane: PLANE_DENOISED }")->on_device);
  refused(kGood + there + "planes { plane: PLANE_SENSOR_RGB }", Code::kUnimplemented, "planes[1]",
          "sensor_rgb is made on the host");
  refused(kGood + there + "planes { plane: PLANE_DEPTH half: true }", Code::kUnimplemented,
          "planes[1].half", "a half float is made on the host");
}

TEST_CASE("render: labels alone need no plane and no samples") {
  CHECK(job("cameras { name: 'left' } labels { boxes: true }"));
  const auto made = job("cameras { name: 'left' } labels { amodal_masks: true }");
  REQUIRE(made);
  CHECK(made->labels.amodal);
}

TEST_CASE("render: an overlay is named by its content") {
  const auto a = parse<v1::Transaction>("edits { advance { dt: 1 } }");
  const auto b = parse<v1::Transaction>("edits { advance { dt: 2 } }");
  CHECK(overlay_hash(a) == overlay_hash(a));
  CHECK(overlay_hash(a) != overlay_hash(b));
  CHECK(overlay_hash(v1::Transaction{}) != 0);
}

TEST_CASE("render: a manifest asks for the same frame again") {
  const auto request = parse<v1::RenderRequest>(
      "scene: 5 cameras { name: 'left' } cameras { name: 'right' } seconds: 2 progressive: true "
      "planes { plane: PLANE_BEAUTY } planes { plane: PLANE_DISPARITY camera { name: 'left' } }");
  const auto made = to_job(request, snapshot(), {});
  REQUIRE(made);
  Frame frame{.index = 1, .scene = 5, .revision = 9, .camera = "right", .width = 64, .height = 48};
  frame.time = made->time;
  frame.seed = 3;
  frame.samples = 17;
  const FrameContext context{request, std::make_shared<const RenderJob>(*made), "1", "embree",
                             "v3"};
  const std::string text = manifest(frame, context, json_of(request_again(frame, context)));
  const auto at = text.find("\"request\":") + 10;
  v1::RenderRequest again;
  REQUIRE(google::protobuf::util::JsonStringToMessage(text.substr(at, text.size() - at - 1), &again)
              .ok());
  CHECK(again.revision() == 9);
  CHECK(again.cameras_size() == 1);
  CHECK(again.cameras(0).name() == "right");
  CHECK(again.spp() == 17);
  CHECK(!again.has_seconds());
  CHECK(again.width() == 64);
  CHECK(again.time() == 2.0);
  CHECK(again.frame_interval() == 0.5);
  CHECK(again.seed() == 3);
  CHECK(again.planes_size() == 2);
  CHECK(text.find("\"backend\":\"embree\"") != std::string::npos);
}

TEST_CASE(
    "render: a manifest names the caller's trace beside the request, and only where there is one") {
  const auto request = parse<v1::RenderRequest>(
      "scene: 5 cameras { name: 'left' } spp: 16 planes { plane: PLANE_BEAUTY }");
  const auto made = to_job(request, snapshot(), {});
  REQUIRE(made);
  FrameContext context{request, std::make_shared<const RenderJob>(*made), "1", "embree", "v3"};
  const Frame frame = frame_header(*made, 0);
  const std::string again = json_of(request_again(frame, context));
  const std::string plain = manifest(frame, context, again);
  CHECK(plain.find("trace") == std::string::npos);
  context.trace = {.parent = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01",
                   .state = "a=1"};
  const std::string traced = manifest(frame, context, again);
  CHECK(
      traced.find(
          R"("trace":{"traceparent":"00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01","tracestate":"a=1"})") !=
      std::string::npos);
  CHECK(traced.substr(traced.find("\"request\":")) == plain.substr(plain.find("\"request\":")));
}

TEST_CASE("render: a manifest that was written ahead is that of the frame, or is written again") {
  const auto request = parse<v1::RenderRequest>(
      "scene: 5 cameras { name: 'left' } cameras { name: 'right' } spp: 16 "
      "planes { plane: PLANE_BEAUTY }");
  const auto made = to_job(request, snapshot(), {});
  REQUIRE(made);
  const FrameContext context{request, std::make_shared<const RenderJob>(*made), "1", "embree",
                             "v3"};
  FrameHeaders ahead(context), late(context);
  ahead.write_ahead();
  for (const u32 samples : {16u, 4u, 16u})
    for (const u32 camera : {1u, 0u}) {
      Frame frame = frame_header(*made, camera);
      frame.samples = samples;
      const std::string text = ahead.header(frame).manifest();
      CHECK(text == late.header(frame).manifest());
      CHECK(text.find(fmt::format("\"spp\":{}", samples)) != std::string::npos);
    }
}

TEST_CASE("render: a frame's header and chunks carry it whole") {
  const auto request = parse<v1::RenderRequest>(
      "cameras { name: 'left' } planes { plane: PLANE_DISPARITY camera { name: 'right' } }");
  const auto made = to_job(request, snapshot(), {});
  REQUIRE(made);
  Frame frame{.width = 2, .height = 1, .categories = {"bolt"}};
  frame.k = glm::dmat3(0);
  frame.k[2][0] = 31.5;
  frame.planes.push_back({Plane::DISPARITY, Pixels(Plane::DISPARITY, 8, PixelAllocator())});
  std::memset(frame.planes[0].pixels.data(), 7, 8);
  const FrameContext context{request, std::make_shared<const RenderJob>(*made), "1", "embree",
                             "v3"};
  const v1::FrameHeader header = to_header(frame, context);
  CHECK(header.planes(0).name() == "disparity");
  CHECK(header.planes(0).dtype() == v1::D_TYPE_F32);
  CHECK(header.planes(0).size() == 8);
  CHECK(header.planes(0).argument() == "right");
  CHECK(header.planes(0).fold() == v1::FOLD_CENTRE);
  CHECK(header.categories(0).id() == 1);
  double k[9];
  constexpr std::size_t kBytes = sizeof k;
  REQUIRE(header.k().inline_().size() == kBytes);
  std::memcpy(k, header.k().inline_().data(), kBytes);
  CHECK(k[2] == 31.5);
  const WirePlane plane(frame.planes[0], false);
  std::string bytes;
  while (bytes.size() < plane.size()) bytes += plane.chunk(bytes.size(), 3);
  CHECK(bytes == std::string(8, 7));
}

TEST_CASE("convert frame: an f32 plane travels as half floats, in chunks of any size") {
  constexpr std::array<float, 4> kValues{1, -0.5f, 1e9f, INFINITY};
  constexpr std::array<u16, 4> kHalves{0x3c00, 0xb800, 0x7bff, 0x7c00};
  PlaneData data{Plane::DEPTH, Pixels(Plane::DEPTH, sizeof kValues, PixelAllocator())};
  std::memcpy(data.pixels.data(), kValues.data(), sizeof kValues);
  const WirePlane plane(data, true);
  CHECK(plane.size() == sizeof kHalves);
  for (u64 limit = 1; limit < 10; ++limit) {
    std::string bytes;
    while (bytes.size() < plane.size()) bytes += plane.chunk(bytes.size(), limit);
    REQUIRE(bytes.size() == sizeof kHalves);
    CHECK(std::memcmp(bytes.data(), kHalves.data(), sizeof kHalves) == 0);
  }
}
