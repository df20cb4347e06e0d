// Paths in lockstep against the loop over pixels: the same bytes.
#include "kernels/lockstep.h"

#include <array>
#include <set>
#include <span>
#include <utility>
#include <vector>

#include "tests/unit/catch.h"
#include "tests/unit/path_room.h"

using namespace heliograph::test;

namespace {

using Company = std::vector<std::array<float, 3>>;

/// Notes which camera rays come together.
struct NotingTracer {
  const TestTracer& tracer;
  std::set<Company>& companies;

  [[nodiscard]] Hit closest(const Ray& ray, u32 mask) const { return tracer.closest(ray, mask); }
  [[nodiscard]] bool occluded(const Ray& ray, u32 mask) const { return tracer.occluded(ray, mask); }
  [[nodiscard]] Hit closest_in(u32 instance, const Ray& ray) const {
    return tracer.closest_in(instance, ray);
  }
  void closest(const CameraRays& rays) const {
    Company company;
    for (u32 i = 0; i < rays.count; ++i) {
      const vec3 d = rays.ray[i]->direction;
      company.push_back({d.x, d.y, d.z});
      *rays.hit[i] = tracer.closest(*rays.ray[i], kCameraRay);
    }
    companies.insert(company);
  }
};

/// The companies of a rectangle's camera rays.
std::set<Company> companies_of(const SceneView& scene, std::span<const PixelRect> rects,
                               std::span<const std::pair<u32, u32>> ranges) {
  std::set<Company> companies;
  const TestFilm film(kSize, kBeauty);
  const ShotView shot = shot_of(scene, 7, film);
  const TestTracer tracer(scene);
  for (const auto& [first, samples] : ranges)
    for (const PixelRect& rect : rects)
      render_rect(shot.scene, shot.camera, shot.settings, NotingTracer{tracer, companies},
                  film.view, rect, first, samples);
  return companies;
}

/// Renders a scene both ways, in lockstep by rectangles and ranges of samples.
void check_same(const SceneView& scene, PlaneSet wanted) {
  const TestFilm loop(kSize, wanted), lockstep(kSize, wanted);
  const TestTracer tracer(scene);
  u64 rays = run_loop({shot_of(scene, 7, loop), tracer}, loop);
  const ShotView shot = shot_of(scene, 7, lockstep);
  for (const auto& [first, samples] : {std::pair{0u, 3u}, std::pair{3u, kSamples - 3}}) {
    for (const PixelRect& rect :
         {PixelRect{0, 0, 7, 5}, PixelRect{7, 0, kSize.x, 5}, PixelRect{0, 5, kSize.x, kSize.y}}) {
      rays -= render_rect(shot.scene, shot.camera, shot.settings, tracer, lockstep.view, rect,
                          first, samples);
    }
  }
  CHECK(rays == 0);
  for (u32 plane = 0; plane < kPlanes; ++plane) {
    if (!(wanted >> plane & 1)) continue;
    INFO(plane);
    CHECK(different_means(loop, lockstep, Plane(plane), kSamples) == 0);
  }
}

}  // namespace

TEST_CASE("lockstep: its film is that of the loop over pixels") {
  TestScene scene;
  const SceneView& view = furnish(scene, false);
  check_same(view, kBeauty);
  check_same(view, kEverything);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: media keep to their paths") {
  TestScene scene;
  const SceneView& view = furnish(scene, true);
  REQUIRE(view.any_media);
  check_same(view, kEverything & ~plane_bit(Plane::BEAUTY_GROUP));
}

TEST_CASE("lockstep: however work is cut, the same camera rays are traced together") {
  TestScene scene;
  const SceneView& view = furnish(scene, false);
  const PixelRect whole{0, 0, kSize.x, kSize.y};
  const u32 x = kPatchWidth, y = 2 * kPatchHeight;
  const PixelRect cut[]{{0, 0, x, y}, {x, 0, kSize.x, y}, {0, y, kSize.x, kSize.y}};
  const std::pair<u32, u32> all{0, 5}, some[]{{0, 1}, {1, 4}};
  const auto companies = companies_of(view, {&whole, 1}, {&all, 1});
  CHECK(companies.size() > kSize.x * kSize.y * 5 / kPatchPixels / 2);
  CHECK(companies == companies_of(view, cut, {&all, 1}));
  CHECK(companies == companies_of(view, {&whole, 1}, some));
}
