// A film whose pixels a device writes into memory of its own.
#include "renderer/host/film.h"

#include "kernels/scene/film.h"
#include "tests/unit/render_scene.h"

using namespace heliograph;
using namespace heliograph::test;

namespace {

constexpr u32 kWidth = 42, kHeight = 37, kPixels = kWidth * kHeight;

/// A film of every fold, as an engine would begin it.
std::unique_ptr<host::HostFilm> make_film(Backend& backend) {
  RenderJob job = job_of(still_life().apply(),
                         {Plane::BEAUTY, Plane::BEAUTY_GROUP, Plane::BEAUTY_STILL, Plane::VARIANCE,
                          Plane::DEPTH, Plane::INSTANCE},
                         1);
  job.width = kWidth;
  job.height = kHeight;
  job.groups = {""};
  const SceneAt at{job.snapshot, {job.time, job.time}};
  auto scenes = backend.prepare({&at, 1}, {});
  REQUIRE(scenes.has_value());
  const auto& scene = scenes->front();
  auto film = host::HostFilm::create(
      {.job = std::make_shared<const RenderJob>(std::move(job)), .open = scene, .still = scene});
  REQUIRE(film.has_value());
  return *std::move(film);
}

/// The film's arrays once more.
struct Device {
  explicit Device(const host::HostFilm& film)
      : sums(film.memory().sums.size()), centres(film.memory().centres.size()) {}
  std::vector<std::byte> sums, centres;
};

/// One sample of pixel i is (i, 0, 0, 1) in beauty, twice that in beauty_still; its depth -i.
void draw(const host::HostFilm& film, Device& device) {
  const host::FilmMemory memory{device.sums, device.centres};
  const auto tasks = film.render_tasks();
  REQUIRE(tasks.size() == 2);
  const kernels::FilmView view = film.rebased(*tasks[0].film, memory);
  const kernels::FilmView still = film.rebased(*tasks[1].film, memory);
  const kernels::FilmView probed = film.rebased(*film.probe_task().film, memory);
  for (u32 i = 0; i < kPixels; ++i) {
    const float beauty[]{float(i), 0, 0, 1}, twice[]{2.0f * float(i), 0, 0, 1};
    kernels::add_sample<4>(view, Plane::BEAUTY, i, beauty, true);
    kernels::add_to_group(view, 0, i, vec3(float(i)));
    kernels::add_sample<4>(still, Plane::BEAUTY, i, twice, false);
    view.moments[2 * i] = view.moments_partial[2 * i] = 1;
    static_cast<float*>(probed.planes[u32(Plane::DEPTH)])[i] = -float(i);
    static_cast<u32*>(probed.planes[u32(Plane::INSTANCE)])[i] = i;
  }
}

}  // namespace

TEST_CASE("host film: what a device wrote elsewhere resolves once its bytes are copied") {
  auto backend = make_backend("embree", {.threads = 1});
  REQUIRE(backend.has_value());
  const auto film = make_film(**backend);
  Device device(*film);
  draw(*film, device);
  for (u32 tile = 0; tile < film->tiles(); ++tile) film->set_samples(tile, 1);
  const auto at = [](const std::vector<PlaneData>& planes, u32 plane, u32 i) {
    return reinterpret_cast<const float*>(planes[plane].pixels.data())[i];
  };
  const auto before = film->resolve();
  for (u32 i = 0; i < kPixels; ++i) CHECK((at(before, 0, 4 * i) == 0 && at(before, 4, i) == 0));
  std::ranges::copy(device.sums, film->memory().sums.begin());
  const auto sums = film->resolve();
  for (u32 i = 0; i < kPixels; ++i) {
    CHECK((at(sums, 0, 4 * i) == float(i) && at(sums, 0, 4 * i + 3) == 1));
    CHECK(at(sums, 1, 3 * i + 2) == float(i));
    CHECK(at(sums, 2, 4 * i) == 2.0f * float(i));
    CHECK(at(sums, 4, i) == 0);
  }
  std::ranges::copy(device.centres, film->memory().centres.begin());
  const auto all = film->resolve();
  for (u32 i = 0; i < kPixels; ++i) {
    CHECK(at(all, 4, i) == -float(i));
    CHECK(reinterpret_cast<const u32*>(all[5].pixels.data())[i] == i);
  }
}

TEST_CASE("host film: arrays moved elsewhere lie apart, within as many bytes") {
  auto backend = make_backend("embree", {.threads = 1});
  REQUIRE(backend.has_value());
  const auto film = make_film(**backend);
  Device device(*film);
  const kernels::FilmView view = film->rebased(film->view(), {device.sums, device.centres});
  std::vector<const std::byte*> arrays;
  for (const void* plane : view.planes) arrays.push_back(static_cast<const std::byte*>(plane));
  for (const float* partial : {view.partial[u32(Plane::BEAUTY)], view.partial[u32(Plane::COVERAGE)],
                               view.moments, view.moments_partial})
    arrays.push_back(reinterpret_cast<const std::byte*>(partial));
  std::erase(arrays, nullptr);
  CHECK(arrays.size() == 6 + 4);  // COVERAGE comes along, VARIANCE has no array of its own
  std::ranges::sort(arrays);
  for (std::size_t i = 0; i + 1 < arrays.size(); ++i)
    CHECK(arrays[i + 1] - arrays[i] >= kPixels * 4);
  for (const std::byte* array : arrays) {
    const std::vector<std::byte>& in =
        array >= device.centres.data() && array < device.centres.data() + device.centres.size()
            ? device.centres
            : device.sums;
    CHECK((array >= in.data() && array + kPixels * 4 <= in.data() + in.size()));
  }
  CHECK(view.rank_of_group == film->view().rank_of_group);
}

TEST_CASE("host film: arrays of several pictures follow each other") {
  auto backend = make_backend("embree", {.threads = 1});
  REQUIRE(backend.has_value());
  const auto film = make_film(**backend);
  constexpr u32 kCount = 3;
  std::vector<std::byte> sums(film->memory().sums.size() * kCount),
      centres(film->memory().centres.size() * kCount);
  std::vector<std::pair<const std::byte*, u64>> arrays;
  for (u32 i = 0; i < kCount; ++i) {
    const kernels::FilmView view = film->rebased(film->view(), {sums, centres}, {i, kCount});
    const auto note = [&](const void* at, Plane plane) {
      const PlaneInfo& info = plane_info(plane);
      const u64 bytes = u64(kPixels) * info.channels * size_of(info.dtype);
      if (at) arrays.emplace_back(static_cast<const std::byte*>(at), bytes);
    };
    for (const Plane plane : {Plane::BEAUTY, Plane::BEAUTY_STILL, Plane::DEPTH, Plane::INSTANCE})
      note(view.planes[u32(plane)], plane);
    note(view.partial[u32(Plane::BEAUTY)], Plane::BEAUTY);
  }
  REQUIRE(arrays.size() == 5 * kCount);
  for (u32 i = 0; i < 5 * (kCount - 1); ++i)
    CHECK(arrays[i + 5].first == arrays[i].first + arrays[i].second);
  std::ranges::sort(arrays);
  for (std::size_t i = 0; i + 1 < arrays.size(); ++i)
    CHECK(arrays[i].first + arrays[i].second <= arrays[i + 1].first);
  CHECK(std::ranges::all_of(arrays, [&](const auto& array) {
    const auto within = [&](const std::vector<std::byte>& memory) {
      return array.first >= memory.data() &&
             array.first + array.second <= memory.data() + memory.size();
    };
    return within(sums) || within(centres);
  }));
}
