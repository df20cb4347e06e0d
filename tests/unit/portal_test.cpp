// Portals: directions through windows follow their density, which integrates to 1.
#include "kernels/light/portal.h"

#include "kernels/light/light.h"
#include "renderer/lights/portals.h"
#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;
using heliograph::resident::DerivedCache;
using heliograph::resident::place_portal;
using heliograph::resident::portal_map;

namespace {

constexpr float kPi2 = 2 * kPi;

/// A small sky: dim, with one texel a thousand times brighter.
heliograph::Texture sky() {
  std::vector<float> texels(32 * 16, 1);
  for (std::size_t i = 0; i < texels.size(); ++i) texels[i] += 0.5f * float(i % 7);
  texels[5 * 32 + 12] = 1000;
  auto image = std::make_shared<heliograph::ImageData>();
  image->texels = heliograph::ArrayOf(std::move(texels)).buffer();
  image->width = 32;
  image->height = 16;
  image->channels = 1;
  image->type = heliograph::TexelType::kF32;
  return {.image = image};
}

/// A dome of probability 1 with these portals.
class Windows {
 public:
  explicit Windows(const heliograph::Texture* texture) : texture_(texture) {
    const float c = std::cos(0.7f), s = std::sin(0.7f);
    dome.world_from_dome = mat3(c, s, 0, -s, c, 0, 0, 0, 1);
    dome.dome_from_world = glm::transpose(dome.world_from_dome);
    dome.probability = 1;
  }
  void add(heliograph::Portal portal, const mat4x3& world) {
    PortalView view{};
    REQUIRE(place_portal(portal, world, view));
    maps_.push_back(portal_map(texture_, dome, view, cache_));
    view.sums = maps_.back()->sums.data();
    views_.push_back(view);
    dome.portals = views_.data();
    dome.portal_count = u32(views_.size());
  }
  DomeView dome{};

 private:
  const heliograph::Texture* texture_;
  DerivedCache cache_{1 << 28};
  std::vector<std::shared_ptr<const heliograph::resident::PortalMap>> maps_;
  std::vector<PortalView> views_;
};

/// A pose whose z axis points to +y, its x axis to +x, times a size.
mat4x3 upright(vec3 at, float size = 1) {
  return mat4x3(vec3(size, 0, 0), vec3(0, 0, -size), vec3(0, size, 0), at);
}

vec3 direction(double x, double y) {
  const float phi = float(kPi2 * x), z = float(2 * y - 1), r = std::sqrt(1 - z * z);
  return vec3(r * std::cos(phi), r * std::sin(phi), z);
}

}  // namespace

TEST_CASE("portals: places and directions are inverse, and the stretch is their solid angle") {
  Random random;
  double sum = 0;
  const int n = 1000;
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      const vec2 place((float(i) + 0.5f) / n, (float(j) + 0.5f) / n);
      sum += double(portal_stretch(portal_direction(place))) / (n * n);
    }
  CHECK(sum == Approx(2 * M_PI).epsilon(1e-3));
  for (int i = 0; i < 1000; ++i) {
    const vec2 place = random.next2();
    CHECK(length(portal_place(portal_direction(place)) - place) < 1e-6f);
  }
}

TEST_CASE("portals: directions follow the density (1e-6), which integrates to 1") {
  const heliograph::Texture texture = sky();
  for (const heliograph::Texture* image :
       {&texture, static_cast<const heliograph::Texture*>(nullptr)})
    for (const vec3 p : {vec3(0, 0, 0), vec3(1.5f, 1.8f, -0.4f)}) {
      Windows windows(image);
      windows.add({.width = 1, .height = 1.5f}, upright({0.2f, 2, 0.3f}));
      windows.add({}, upright({0.8f, 2.5f, 0}, 2));  // partly behind the first
      windows.add({.width = 3}, mat4x3(vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1), {0, 0, 2}));
      windows.add({}, upright({0, -5, 0}));  // p is behind it
      const DomeView& dome = windows.dome;
      REQUIRE(portal_faces(dome, p));
      Random random;
      const auto sample = [&](double& x, double& y) {
        vec3 d;
        float pdf = 0;
        if (!sample_portals(dome, p, random.next2(), d, pdf)) return false;
        REQUIRE(portal_pdf(dome, p, d) == Approx(pdf).epsilon(1e-5));
        x = std::atan2(double(d.y), double(d.x)) / (2 * M_PI);
        if (x < 0) x += 1;
        y = 0.5 + 0.5 * double(d.z);
        return true;
      };
      double integral = 0;
      const auto density = [&](double x, double y) {
        return 4 * M_PI * double(portal_pdf(dome, p, direction(x, y)));
      };
      const int n = 1500;  // its cells are cut by the windows' edges
      for (int i = 0; i < n; ++i)
        for (int j = 0; j < n; ++j) integral += density((i + 0.5) / n, (j + 0.5) / n) / (n * n);
      INFO("p " << p.x << " textured " << (image != nullptr));
      CHECK(integral == Approx(1).epsilon(5e-3));
      CHECK(square_p_value({24, 120, 30000}, sample, density) > kLevel);
    }
}

TEST_CASE("portals: what is behind all of them samples the dome as without any") {
  Windows windows(nullptr);
  windows.add({}, upright({0, 2, 0}));
  CHECK_FALSE(portal_faces(windows.dome, {0, 3, 0}));
  CHECK_FALSE(portal_faces(windows.dome, {0, 2, 0}));
  const auto pdf = [&](vec3 p, vec3 direction) {
    return dome_pdf(windows.dome, {p, vec3(0), Facing::kAny, 0}, direction, {});
  };
  CHECK(pdf({0, 3, 0}, {0, 1, 0}) == Approx(0.25 / M_PI));
  CHECK(pdf({0, 1, 0}, {0, -1, 0}) == 0);
  // A square window of 1 m, 100 m away, under a constant sky: 1 / its solid angle. Within a texel
  // of the map the density follows the stretch.
  CHECK(pdf({0, -98, 0}, {0, 1, 0}) == Approx(1e4).epsilon(0.02));
}
