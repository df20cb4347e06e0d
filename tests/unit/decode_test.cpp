// The decoder end to end: the real heliograph-decode, its children, their results and their deaths.
#include <fcntl.h>
#include <fmt/format.h>
#include <signal.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <future>
#include <random>
#include <set>

#include "renderer/assets/load.h"
#include "server/decode/child.h"
#include "server/decode/decoder.h"
#include "server/decode/result.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using namespace heliograph::server;
using Catch::Matchers::Contains;

namespace {

BufferPtr buffer_of(std::vector<std::byte> bytes) {
  return ArrayOf<std::byte>(std::move(bytes)).buffer();
}

DecodeJob job_of(const TestBundle& bundle) {
  DecodeJob job;
  for (std::size_t i = 0; i < bundle.paths.size(); ++i) {
    job.files.push_back({bundle.paths[i], buffer_of(bundle.contents[i])});
  }
  return job;
}
DecodeJob job_of(const std::string& name) { return job_of(bundle_of(test_assets() / name)); }

DecoderOptions options() {
  DecoderOptions result;
  result.program = std::filesystem::canonical("/proc/self/exe").parent_path() / "heliograph-decode";
  return result;
}

std::unique_ptr<Decoder> start(const DecoderOptions& with = options()) {
  auto decoder = Decoder::create(with);
  REQUIRE(decoder);
  return std::move(*decoder);
}

std::future<Expected<Decoded>> begin(Decoder& decoder, DecodeJob job, std::stop_token stop = {}) {
  auto promise = std::make_shared<std::promise<Expected<Decoded>>>();
  decoder.decode(
      std::move(job),
      [promise](Expected<Decoded> result) { promise->set_value(std::move(result)); },
      std::move(stop));
  return promise->get_future();
}
Expected<Decoded> decode_now(Decoder& decoder, DecodeJob job) {
  return begin(decoder, std::move(job)).get();
}

std::string said(const Expected<Decoded>& result) {
  if (result) return "";
  return fmt::format("{} {}: {}", int(result.error().code), result.error().where,
                     result.error().message);
}

/// Processes whose parent is `parent`.
std::vector<pid_t> children_of(pid_t parent) {
  std::vector<pid_t> result;
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    const std::string name = entry.path().filename();
    if (name.find_first_not_of("0123456789") != name.npos) continue;
    std::ifstream file(entry.path() / "stat");
    std::string text;
    std::getline(file, text);  // nothing of a process that has just ended
    const std::size_t end = text.rfind(')');
    if (end == text.npos || std::atoi(text.c_str() + end + 4) != parent) continue;
    result.push_back(std::atoi(name.c_str()));
  }
  return result;
}

/// Once the others are reaped: the one that waits for the next job.
pid_t the_only_child() {
  for (int i = 0; i < 500 && children_of(getpid()).size() != 1; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  const auto children = children_of(getpid());
  REQUIRE(children.size() == 1);
  return children.front();
}

/// A region as a child would send it.
std::shared_ptr<const Region> region_of(const decode::Result& result) {
  auto fd = write_region(result, {});
  REQUIRE(fd);
  auto region = Region::map(fd->get(), 1 << 30);
  REQUIRE(region);
  return *region;
}

}  // namespace

TEST_CASE("decode: a model arrives as it was loaded, array by array") {
  const auto decoder = start();
  for (const char* name :
       {"gltf/Fox.glb", "gltf/12_orm_two_uvmaps/12_orm_two_uvmaps.gltf", "gltf/Lights.glb",
        "mesh/link_6.obj", "gltf/01_morphed_cube/01_morphed_cube.gltf"}) {
    INFO(name);
    const auto direct = bundle_of(test_assets() / name).load();
    DecodeJob job = job_of(name);
    job.hash = std::string(32, 'h');
    const auto decoded = decode_now(*decoder, job);
    INFO(said(decoded));
    REQUIRE(direct);
    REQUIRE(decoded);
    const Asset& asset = *decoded->asset;
    CHECK(asset.hash == job.hash);
    CHECK(asset.name == direct->asset.name);
    REQUIRE(asset.library.size() == direct->asset.library.size());
    REQUIRE(asset.entities.size() == direct->asset.entities.size());
    CHECK(asset.animations.size() == direct->asset.animations.size());
    CHECK(decoded->bounds_max == direct->bounds_max);
    for (std::size_t i = 0; i < asset.library.size(); ++i) {
      const auto* a = std::get_if<PutMesh>(&asset.library[i].action);
      const auto* b = std::get_if<PutMesh>(&direct->asset.library[i].action);
      if (!a) continue;
      CHECK(std::ranges::equal(a->vertices->positions, b->vertices->positions));
      CHECK(std::ranges::equal(a->topology->triangles, b->topology->triangles));
    }
    for (std::size_t i = 0; i < asset.entities.size(); ++i) {
      const auto& a = std::get<PutEntity>(asset.entities[i].action);
      const auto& b = std::get<PutEntity>(direct->asset.entities[i].action);
      CHECK(a.pose.has_value() == b.pose.has_value());
      if (a.pose) CHECK(a.pose->matrices == b.pose->matrices);
    }
  }
}

TEST_CASE("decode: pictures, volumes, missing files, refusals") {
  const auto decoder = start();
  const auto picture = decode_now(*decoder, job_of("picture/AllHalfValues.exr"));
  REQUIRE(picture);
  CHECK(picture->image->width == 256);
  CHECK(picture->warnings.size() == 2);
  const DecodeJob volume_job = job_of("volume/torus.nvdb");
  const auto volume = decode_now(*decoder, volume_job);
  INFO(said(volume));
  REQUIRE(volume);
  const auto& put = std::get<PutVolume>(volume->asset->library.at(0).action);
  CHECK(put.density->bricks.size() > 0);
  DecodeJob alone = job_of("gltf/03_skinned_cylinder/03_skinned_cylinder.gltf");
  alone.files.resize(1);
  CHECK(decode_now(*decoder, alone)->missing.size() == 1);
  CHECK(decode_now(*decoder, job_of("gltf/heart_draco.glb")));
  DecodeJob unknown = job_of("gltf/Lights.glb");
  unknown.format = "blend";
  CHECK_THAT(said(decode_now(*decoder, unknown)),
             Contains("12 Lights.glb") && Contains("'blend' is not one of"));
  CHECK_THAT(said(decode_now(*decoder, {})), Contains("empty"));
}

TEST_CASE("decode: it says what confines it, and whether it works") {
  const auto decoder = start();
  std::promise<Status> tried;
  decoder->try_out([&](const Status& status) { tried.set_value(status); });
  CHECK(tried.get_future().get());
  const DecoderState state = decoder->state();
  CHECK(std::ranges::find(state.sandbox, "seccomp") != state.sandbox.end());
  CHECK_THAT(state.versions, Contains("OpenImageIO"));
  CHECK(state.works);
}

TEST_CASE("decode: a program that does not confine itself decodes nothing") {
  DecoderOptions other = options();
  other.program = "/bin/false";
  const auto decoder = start(other);
  CHECK_THAT(said(decode_now(*decoder, job_of("mesh/link_6.stl"))),
             Contains("/bin/false exited with 1"));
  CHECK_FALSE(decoder->state().works);
}

TEST_CASE("decode: room for a result is asked for, and its refusal is the decode's") {
  const auto decoder = start();
  DecodeJob job = job_of("picture/gradient16.png");
  std::atomic<u64> asked = 0;
  job.pay = [&](u64 bytes) -> Expected<std::shared_ptr<const void>> {
    asked = bytes;
    return nullptr;
  };
  const auto decoded = decode_now(*decoder, job);
  REQUIRE(decoded);
  CHECK(asked > decoded->image->texels->bytes().size());
  job.pay = [](u64) -> Expected<std::shared_ptr<const void>> {
    return fail(Code::kResourceExhausted, "", "no room");
  };
  CHECK_THAT(said(decode_now(*decoder, job)), Contains("8 gradient16.png: no room"));
}

TEST_CASE("decode: a message that is larger than one may be is not read") {
  decode::Result much;
  for (u64 bytes = 0; bytes <= kMessageBytes; bytes += 1 << 20)
    much.add_missing(std::string(1 << 20, 'a'));
  CHECK_THAT(said(read_result(region_of(much), DecodeJob(), nullptr)),
             Contains("as large as no message"));
}

TEST_CASE("decode: each child has an address layout of its own") {
  const auto decoder = start();
  std::set<std::string> layouts;
  std::string lines;
  for (int i = 0; i < 4; ++i) {
    REQUIRE(decode_now(*decoder, job_of("mesh/link_6.stl")));
    const pid_t spare = the_only_child();  // made for the next job
    std::ifstream maps("/proc/" + std::to_string(spare) + "/maps");
    std::string first;
    REQUIRE(std::getline(maps, first));
    lines += first + "\n";
    layouts.insert(first.substr(0, first.find('-')));
  }
  INFO(lines);
  CHECK(layouts.size() == 4);
}

TEST_CASE("decode: a program that is not there is an error at once") {
  DecoderOptions none = options();
  none.program = "/no/such/program";
  const auto decoder = Decoder::create(none);
  REQUIRE_FALSE(decoder);
  CHECK(decoder.error().code == Code::kUnavailable);
}

TEST_CASE("decode: limits of time, memory and size answer, and the next job works") {
  DecoderOptions tight = options();
  tight.limits.bytes = 100'000;
  const auto small = start(tight);
  CHECK_THAT(said(decode_now(*small, job_of("gltf/Fox.glb"))), Contains("8 Fox.glb"));
  CHECK(decode_now(*small, job_of("mesh/cube_blender_uv.ply")));
  DecoderOptions hurried = options();
  hurried.deadline_seconds = 0;
  const auto late = start(hurried);
  CHECK_THAT(said(decode_now(*late, job_of("gltf/Fox.glb"))), Contains("4 Fox.glb"));
}

TEST_CASE("decode: a cancelled job ends, and its child with it") {
  const auto decoder = start();
  std::stop_source stop;
  stop.request_stop();
  const auto before = begin(*decoder, job_of("gltf/Fox.glb"), stop.get_token()).get();
  REQUIRE_FALSE(before);
  CHECK(before.error().code == Code::kCancelled);
  // A job of some length, stopped at random moments.
  TestBundle large;
  std::string text =
      "ply\nformat ascii 1.0\nelement vertex 300000\nproperty float x\nproperty float "
      "y\nproperty float z\nelement face 1\nproperty list uchar int vertex_index\n"
      "end_header\n";
  for (int i = 0; i < 300000; ++i) text += "0.125 0.25 0.5\n";
  large.add("large.ply", text + "3 0 1 2\n");
  std::mt19937 random(1);
  int cancelled = 0;
  for (int i = 0; i < 20; ++i) {
    std::stop_source late;
    auto result = begin(*decoder, job_of(large), late.get_token());
    std::this_thread::sleep_for(std::chrono::milliseconds(random() % 20));
    late.request_stop();
    const auto ended = result.get();
    if (!ended) CHECK(ended.error().code == Code::kCancelled);
    cancelled += !ended;
  }
  CHECK(cancelled > 0);
  CHECK(decode_now(*decoder, job_of("mesh/cube_blender_uv.ply")));
  // Nothing is left of them but the one that waits for the next job.
  (void)the_only_child();
}

TEST_CASE("decode: where the child that waits is killed, another takes the job") {
  const auto decoder = start();
  REQUIRE(decode_now(*decoder, job_of("gltf/Lights.glb")));
  for (int i = 0; i < 5; ++i) {
    const pid_t spare = the_only_child();
    kill(spare, SIGKILL);
    siginfo_t ended;
    REQUIRE(waitid(P_PID, id_t(spare), &ended, WEXITED | WNOWAIT) == 0);
    const auto result = decode_now(*decoder, job_of("gltf/Lights.glb"));
    INFO(said(result));
    CHECK(result);
  }
}

TEST_CASE("decode: many jobs at once, one result each") {
  const auto decoder = start();
  std::vector<std::future<Expected<Decoded>>> results;
  for (int i = 0; i < 60; ++i) {
    results.push_back(begin(*decoder, job_of(i % 2 ? "gltf/Lights.glb" : "mesh/link_6.stl")));
  }
  int good = 0;
  for (auto& result : results) good += result.get().has_value();
  CHECK(good == 60);
}

TEST_CASE("decode: mutants through the sandbox; each answers, and the next job works") {
  const auto decoder = start();
  for (const char* name : {"gltf/Lights.glb", "picture/stripes.exr", "picture/gradient.jpg"}) {
    for (u32 seed = 0; seed < 40; ++seed) {
      std::mt19937 random(seed);
      TestBundle bundle = bundle_of(test_assets() / name);
      auto& bytes = bundle.contents[0];
      for (int i = 0; i < 6; ++i) bytes[random() % bytes.size()] = std::byte(random());
      const auto result = decode_now(*decoder, job_of(bundle));
      if (!result) CHECK_FALSE(result.error().message.empty());
    }
  }
  CHECK(decode_now(*decoder, job_of("gltf/Lights.glb")));
}

TEST_CASE("decode: a result that breaks a rule is refused, whatever it says") {
  const DecodeJob job = job_of("mesh/cube_blender_uv.ply");
  decode::Result good;
  for (int i = 0; i < 6; ++i) good.add_bounds(0);
  auto* root = good.mutable_entities()->add_edits();
  root->mutable_entity()->set_visible(true);
  REQUIRE(read_result(region_of(good), job, nullptr));
  const auto first = [](decode::Result& r) -> v1::Entity& {
    return *r.mutable_entities()->mutable_edits(0)->mutable_entity();
  };
  const auto refused = [&](const auto& change) {
    decode::Result bad = good;
    change(bad);
    return said(read_result(region_of(bad), job, nullptr));
  };
  CHECK_THAT(refused([&](auto& r) { first(r).mutable_mesh()->set_id(77); }),
             Contains("entities[0]"));
  CHECK_THAT(refused([&](auto& r) { first(r).mutable_parent()->set_name("other"); }),
             Contains("entities[0]"));
  CHECK_THAT(refused([&](auto& r) { first(r).mutable_parent()->set_created_by_edit(0); }),
             Contains("entities[0]"));
  CHECK_THAT(refused([](auto& r) { r.mutable_entities()->add_edits()->mutable_remove(); }),
             Contains("broken"));
  CHECK_THAT(refused([](auto& r) { r.mutable_entities()->add_edits()->mutable_prune(); }),
             Contains("entities[1]"));
  CHECK_THAT(refused([](auto& r) { r.mutable_library()->add_edits()->mutable_entity(); }),
             Contains("library[0]"));
  CHECK_THAT(refused([](auto& r) { r.set_bounds(0, std::numeric_limits<float>::infinity()); }),
             Contains("bounds"));
  CHECK_THAT(refused([](auto& r) { r.add_animations()->add_channels()->set_entity(5); }),
             Contains("channel"));
  CHECK_THAT(refused([](auto& r) {
               auto* texels = r.mutable_texels();
               texels->set_dtype(v1::D_TYPE_U8);
               for (int i = 0; i < 3; ++i) texels->add_shape(4);
               texels->mutable_buffer()->set_offset(0);
               texels->mutable_buffer()->set_size(64);
             }),
             Contains("leaves the result"));
  CHECK_THAT(refused([](auto& r) { r.set_code(3), r.set_message("why"); }), Contains("3 : why"));
  CHECK_THAT(refused([](auto& r) { r.set_code(9999); }), Contains("13 "));
}

TEST_CASE("decode: only sealed memfds of a possible size are mapped") {
  decode::Result result;
  auto sealed = write_region(result, {});
  REQUIRE(sealed);
  CHECK(Region::map(sealed->get(), 1 << 20));
  CHECK_FALSE(Region::map(sealed->get(), 4));
  const Fd open_memfd(memfd_create("x", MFD_ALLOW_SEALING));
  REQUIRE(ftruncate(open_memfd.get(), 4096) == 0);
  CHECK_FALSE(Region::map(open_memfd.get(), 1 << 20));
  REQUIRE(fcntl(open_memfd.get(), F_ADD_SEALS, F_SEAL_SHRINK | F_SEAL_GROW) == 0);
  CHECK_FALSE(Region::map(open_memfd.get(), 1 << 20));
  const u64 beyond = 1 << 20;
  REQUIRE(pwrite(open_memfd.get(), &beyond, 8, 0) == 8);
  REQUIRE(fcntl(open_memfd.get(), F_ADD_SEALS, F_SEAL_WRITE) == 0);
  CHECK_FALSE(Region::map(open_memfd.get(), 1 << 20));
  const Fd file(open("/proc/self/exe", O_RDONLY));
  CHECK_FALSE(Region::map(file.get(), 1 << 20));
  // Ranges of the data section are checked without overflow.
  const std::vector<std::byte> data(100);
  const Bytes arrays[] = {data};
  auto fd = write_region(result, arrays);
  REQUIRE(fd);
  const auto region = *Region::map(fd->get(), 1 << 20);
  CHECK(region->data(0, 100));
  CHECK_FALSE(region->data(0, 101));
  CHECK_FALSE(region->data(64, 64));
  CHECK_FALSE(region->data(~0ull, 2));
  CHECK_FALSE(region->data(64, ~0ull));
}
