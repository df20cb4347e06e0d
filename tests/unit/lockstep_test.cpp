// Paths in lockstep against the loop over pixels: the same bytes.
#include "kernels/lockstep.h"

#include "tests/unit/catch.h"
#include "tests/unit/path_room.h"

using namespace heliograph::test;

namespace {

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
