// A wave of paths against the loop over pixels: the same samples, whoever takes the steps.
#include "kernels/wave.h"

#include <numeric>
#include <random>

#include "tests/unit/catch.h"
#include "tests/unit/path_room.h"

using namespace heliograph::test;

namespace {

constexpr u32 kSlots = 700;  // fewer than there are items

/// Runs a wave as its reader does, its slots in random order.
class HostWave {
 public:
  HostWave(const std::vector<Picture>& pictures, const WaveWork& work)
      : pictures_(pictures), work_(work), items_(items_of(work)) {
    const ShotView& shot = pictures[0].shot;
    item_.assign(kSlots, kNone);
    paths_.resize(kSlots);
    rays_.resize(kSlots);
    hits_.resize(kSlots);
    lights_.resize(kSlots);
    lit_.assign(kSlots, false);
    insides_.resize(kSlots);
    reaches_.resize(kSlots);
    samples_.resize(items_);
    light_planes_.resize(size_t(items_) * kLightPlanes);
    groups_.assign(size_t(items_) * 3 * std::max(shot.film.groups, 1u), 0);
    firsts_.resize(items_);
    routes_.resize(2 * kSlots);
    view_ = {.paths = paths_.data(),
             .rays = rays_.data(),
             .hits = hits_.data(),
             .lights = lights_.data(),
             .samples = samples_.data(),
             .firsts = firsts_.data(),
             .film = shot.film};
    if (std::ranges::any_of(pictures, [](const auto& p) { return p.shot.scene.any_media; })) {
      view_.insides = insides_.data();
      view_.reaches = reaches_.data();
    }
    if (shot.film.wanted & kLightPlaneSet) {
      view_.light_planes = light_planes_.data();
      view_.routes = routes_.data();
    }
    view_.film.width = items_;
    view_.film.height = 1;
    view_.film.partial[u32(Plane::BEAUTY_GROUP)] = groups_.data();
  }
  void run() {
    std::vector<u32> order(kSlots);
    std::iota(order.begin(), order.end(), 0);
    std::mt19937 dice(1);
    for (u32 next = 0, active = 1; active > 0 || next < items_;) {
      std::shuffle(order.begin(), order.end(), dice);
      active = 0;
      for (const u32 slot : order) {
        while (item_[slot] == kNone && next < items_) {
          if (wave_of(next).begin(slot, next)) item_[slot] = next;
          ++next;
        }
        active += trace(slot);
      }
      for (const u32 slot : order) arrive(slot);
    }
  }
  u64 fold(u32 pixels) {
    u64 rays = 0;
    for (u32 i = 0; i < pixels; ++i) rays += wave_of(i).fold(i);
    return rays;
  }

 private:
  const Picture& picture(u32 item) const {
    return pictures_[picture_of(pictures_[0].shot.film, work_, item)];
  }
  const TestTracer& tracer_of(u32 item) const { return picture(item).tracer; }
  Wave<TestTracer> wave_of(u32 item) const {
    return {picture(item).shot, work_, view_, tracer_of(item)};
  }
  /// The ray of a slot, and the one that its light waits for. Returns how many.
  u32 trace(u32 slot) {
    u32 rays = 0;
    if (item_[slot] != kNone) {
      hits_[slot].hit = tracer_of(item_[slot]).closest(rays_[slot].ray, rays_[slot].mask);
      ++rays;
    }
    if (lit_[slot]) {
      const u32 item = lights_[slot].item;
      if (!tracer_of(item).occluded(lights_[slot].ray, kShadowRay)) wave_of(item).shine(slot);
      lit_[slot] = false;
      ++rays;
    }
    return rays;
  }
  void arrive(u32 slot) {
    if (item_[slot] == kNone) return;
    const Arrival arrival = wave_of(item_[slot]).arrive(slot);
    lit_[slot] = arrival.takes_light;
    if (!arrival.goes_on) item_[slot] = kNone;
  }

  const std::vector<Picture>& pictures_;
  const WaveWork work_;
  WaveView view_{};
  u32 items_;
  std::vector<u32> item_;
  std::vector<WavePath> paths_;
  std::vector<WaveRay> rays_;
  std::vector<WaveHit> hits_;
  std::vector<WaveLight> lights_;
  std::vector<bool> lit_;
  std::vector<Inside> insides_;
  std::vector<Reach> reaches_;
  std::vector<WaveSample> samples_;
  std::vector<WaveFirst> firsts_;
  std::vector<WaveRoute> routes_;
  std::vector<vec3> light_planes_;
  std::vector<float> groups_;
};

/// A film of the loop over pixels and one of a wave.
struct Films {
  explicit Films(PlaneSet planes) : loop(kSize, planes), wave(kSize, planes), wanted(planes) {}
  TestFilm loop, wave;
  PlaneSet wanted;
};

void check_same(const Films& films) {
  for (u32 plane = 0; plane < kPlanes; ++plane) {
    if (!(films.wanted >> plane & 1)) continue;
    INFO(plane);
    const bool sums_differ = Plane(plane) == Plane::BEAUTY_GROUP;  // of a sample, then of samples
    u64 different = 0;
    for (u64 i = 0; i < u64(kSize.x) * kSize.y; ++i) {
      const float a = films.loop.mean(Plane(plane), i, kSamples),
                  b = films.wave.mean(Plane(plane), i, kSamples);
      different += sums_differ ? std::abs(a - b) > 1e-5f * std::abs(a) : a != b;
    }
    CHECK(different == 0);
  }
}

/// Pictures of scenes, in a wave of all.
void check_same(const std::vector<const SceneView*>& scenes, PlaneSet wanted) {
  std::deque<Films> films;
  std::deque<TestTracer> tracers;
  std::vector<Picture> pictures;
  u64 rays = 0;
  for (const SceneView* scene : scenes) {
    const Films& own = films.emplace_back(wanted);
    pictures.push_back(
        {shot_of(*scene, 7 + pictures.size(), own.wave), tracers.emplace_back(*scene)});
    rays += run_loop(pictures.back(), own.loop);
  }
  // In two batches of samples, for all tiles but the last picture's last two, then for those.
  const u32 tiles = 4 * u32(scenes.size());
  for (const auto& [first_tile, count] : {std::pair{0u, tiles - 2}, std::pair{tiles - 2, 2u}})
    for (const auto& [first, samples] : {std::pair{0u, 7u}, std::pair{7u, kSamples - 7}}) {
      const WaveWork work{first_tile, count, first, samples};
      HostWave host(pictures, work);
      host.run();
      rays -= host.fold(pixels_of(work));
    }
  CHECK(rays == 0);
  for (const Films& own : films) check_same(own);
}

}  // namespace

TEST_CASE("wave: its film is that of the loop over pixels") {
  TestScene scene;
  const SceneView& view = furnish(scene, false);
  check_same({&view}, kBeauty);
  check_same({&view}, kEverything);
}

TEST_CASE("wave: media keep to their paths") {
  TestScene scene;
  const SceneView& view = furnish(scene, true);
  REQUIRE(view.any_media);
  check_same({&view}, kEverything);
}

TEST_CASE("wave: pictures of several scenes go side by side") {
  TestScene clear, fog;
  const SceneView &one = furnish(clear, false), &other = furnish(fog, true);
  check_same({&one, &other, &one}, kEverything);
}
