// A wave of paths against the loop over pixels: the same samples, whoever takes the steps.
#include "kernels/schedule/wave.h"

#include <numeric>
#include <random>

#include "tests/unit/catch.h"
#include "tests/unit/path_room.h"

using namespace heliograph::test;

namespace {

/// Runs a wave as its reader does, its items in random order.
class HostWave {
 public:
  HostWave(const std::vector<Picture>& pictures, const WaveWork& work)
      : pictures_(pictures), work_(work), items_(items_of(work)) {
    const ShotView& shot = pictures[0].shot;
    arrivals_.resize(items_);
    paths_.resize(items_);
    rays_.resize(items_);
    hits_.resize(items_);
    lights_.resize(items_);
    insides_.resize(items_);
    reaches_.resize(items_);
    samples_.resize(items_);
    riches_.resize(items_);
    groups_.assign(size_t(items_) * 3 * std::max(shot.film.groups, 1u), 0);
    firsts_.resize(items_);
    routes_.resize(2 * size_t(items_));
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
    if (shot.film.wanted & planes_from<SampleRich>()) {
      view_.riches = riches_.data();
      view_.routes = routes_.data();
    }
    view_.film.width = items_;
    view_.film.height = 1;
    view_.film.partial[u32(Plane::BEAUTY_GROUP)] = groups_.data();
  }
  void run() {
    std::vector<u32> order(items_);
    std::iota(order.begin(), order.end(), 0);
    std::mt19937 dice(1);
    for (const u32 item : order) arrivals_[item] = {wave_of(item).begin(item), false};
    while (std::ranges::any_of(arrivals_, [](const Arrival& a) { return goes_on(a); })) {
      std::ranges::shuffle(order, dice);
      for (const u32 item : order) trace(item);
      for (const u32 item : order) {
        Arrival& arrival = arrivals_[item];
        arrival = arrival.goes_on ? wave_of(item).arrive(item) : Arrival{false, false};
      }
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
  static bool goes_on(const Arrival& arrival) {
    return arrival.goes_on || arrival.wants_shadow_ray;
  }
  /// An item's ray, and the one that its light waits for.
  void trace(u32 item) {
    const TestTracer& tracer = tracer_of(item);
    if (arrivals_[item].goes_on)
      hits_[item].hit = tracer.closest(rays_[item].ray, rays_[item].mask);
    if (arrivals_[item].wants_shadow_ray && !tracer.occluded(lights_[item].ray, kShadowRay))
      wave_of(item).shine(item);
  }

  const std::vector<Picture>& pictures_;
  const WaveWork work_;
  WaveView view_{};
  u32 items_;
  std::vector<Arrival> arrivals_;
  std::vector<PathState> paths_;
  std::vector<PathRay> rays_;
  std::vector<WaveHit> hits_;
  std::vector<WaveLight> lights_;
  std::vector<Inside> insides_;
  std::vector<Reach> reaches_;
  std::vector<WaveSample> samples_;
  std::vector<WaveFirst> firsts_;
  std::vector<WaveRoute> routes_;
  std::vector<SampleRich> riches_;
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
    const float tolerance = sums_differ ? 1e-5f : 0;
    CHECK(different_means(films.loop, films.wave, Plane(plane), kSamples, tolerance) == 0);
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
