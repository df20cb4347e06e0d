// The sky: the numbers of the Python client's, and on a scene.
#include <cmath>

#include "fixture.h"

using namespace heliograph::client;

namespace {

using Rgb = std::array<float, 3>;

void check_pixel(const Sky& made, std::size_t y, std::size_t x, const Rgb& wanted) {
  const Rgb found = made.radiance.view<Rgb>()(y, x);
  for (std::size_t c = 0; c < 3; ++c) CHECK(found[c] == Approx(wanted[c]).epsilon(1e-5));
}

void check_sun(const Sky& made, const Color& wanted, Vec3 direction) {
  CHECK(made.sun_irradiance.r == Approx(wanted.r).epsilon(1e-6));
  CHECK(made.sun_irradiance.g == Approx(wanted.g).epsilon(1e-6));
  CHECK(made.sun_irradiance.b == Approx(wanted.b).epsilon(1e-6));
  CHECK(made.sun_direction.x == Approx(direction.x));
  CHECK(made.sun_direction.y == Approx(direction.y));
  CHECK(made.sun_direction.z == Approx(direction.z));
}

double red_of(const Sky& made) {
  double sum = 0;
  for (const Rgb& pixel : made.radiance.view<Rgb>()) sum += pixel[0];
  return sum;
}

}  // namespace

TEST_CASE("the sky is that of heliograph.sky") {  // printed by hg.sky
  Air air;
  air.width = 64;
  const Sky day = sky(0.5, 1.1, air);
  CHECK(day.radiance.shape() == Shape{32, 64, 3});
  check_sun(day, {181.921886, 136.862736, 96.4935146}, {0.39806805, 0.78210804, 0.47942554});
  check_pixel(day, 2, 5, {0.964416623F, 1.81955099F, 3.88185811F});
  check_pixel(day, 10, 40, {1.51749039F, 2.82835698F, 5.76651812F});
  check_pixel(day, 15, 20, {17.4595509F, 19.8908825F, 19.1856194F});
  check_pixel(day, 20, 60, {8.92991161F, 7.27207041F, 6.28092051F});
  CHECK(red_of(day) == Approx(11833.38255841).epsilon(1e-6));

  air = {4, 0.8, 32, 3000};
  const Sky evening = sky(0.05, -2.5, air);
  check_sun(evening, {111.198927, 42.7289101, 10.3882293}, {-0.80014239, -0.59772421, 0.04997917});
  check_pixel(evening, 0, 0, {0.33197251F, 0.440140456F, 0.820458949F});
  check_pixel(evening, 7, 31, {4.60513783F, 4.66784573F, 4.67052603F});
  check_pixel(evening, 5, 14, {1.02709258F, 1.28323805F, 2.08978319F});
  CHECK(red_of(evening) == Approx(806.81281146).epsilon(1e-6));
}

TEST_CASE("a sky lights a scene, its sun from where it stands") {
  Ball world;
  Transaction edit = world.scene.edit();
  edit.sky(0.5, -1.5707963);  // behind the camera
  edit.commit();
  const Frame frame = world.scene.render(
      world.camera, RenderOptions().spp(16).planes({"direct_diffuse", "environment_light"}));
  const auto light = frame.plane<Rgb>("direct_diffuse");
  CHECK(light(24, 32)[0] > 5 * light(35, 32)[0]);  // the ball's lower side is in the shade
  const Rgb above = frame.plane<Rgb>("environment_light")(0, 0);
  CHECK(above[2] > above[0]);
}

TEST_CASE("a sky that cannot be is refused") {
  Air wide;
  wide.width = 30;
  CHECK(error_of([&] { (void)sky(0.5, 0, wide); }).details().field == "width");
  CHECK(error_of([&] { (void)sky(2); }).details().field == "elevation");
}
