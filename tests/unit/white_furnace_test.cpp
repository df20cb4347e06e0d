// White materials that lose nothing, over the whole disc that a ball shows, from outside and
// inside.
//
// The long run takes 5,000 and 1,000: white_furnace_test "[.long]".
#include <vector>

#include "tests/unit/catch.h"
#include "tests/unit/principled.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

/// What tables and means over microfacets may give a disc too much.
constexpr double kAbove = 2e-4;

/// A number as often 0 as not, else anywhere in [0, 1).
float sometimes(Random& random, float standard = 0) {
  return random.next() < 0.5f ? standard : random.next();
}

/// All of a white material that scatters, at random.
Config white(Random& random) {
  Config c{"white", standard(), random.next() < 0.2f};
  MaterialValues& m = c.m;
  m.base_color = m.sheen_color = m.subsurface_color = vec3(1);
  m.roughness = random.next() < 0.15f ? 0 : random.next();
  m.metallic = sometimes(random);
  m.specular = sometimes(random, 1);
  m.ior = 1.01f + 2 * sqr(random.next());
  m.transmission = sometimes(random, 1);
  m.transmission_roughness = sometimes(random);
  m.anisotropic = sometimes(random);
  m.sheen = sometimes(random);
  m.sheen_roughness = random.next();
  m.clearcoat = sometimes(random);
  m.clearcoat_roughness = random.next();
  m.iridescence = sometimes(random);
  m.iridescence_ior = 1 + 2 * random.next();
  m.iridescence_thickness = 1000 * random.next();
  m.diffuse_transmission = sometimes(random);
  return c;
}

/// Ends of the lobes in u_lobe.
std::vector<double> lobe_ends(const Bsdf& b) {
  const double base = b.layered ? double(b.layers.base_probability) : 1;
  const double clearcoat = b.layered ? double(b.layers.clearcoat_probability) : 0;
  std::vector<double> ends{0};
  const double above = double(above_probability(b));
  for (const double p : {base * above, base * (double(b.diffuse_probability) - above),
                         base * double(b.facet_probability), base * double(through_probability(b)),
                         clearcoat, 1 - base - clearcoat}) {
    if (p > 1e-7) ends.push_back(ends.back() + p);
  }
  return ends;
}

struct Mean {
  vec3 albedo{0};
  double error = 0;  // standard deviation
};
void add(Mean& sum, const Mean& m, float weight) {
  sum.albedo += m.albedo * weight;
  sum.error = std::hypot(sum.error, m.error * double(weight));
}

/// Mean weight in [first, last) of u_lobe, from n points of Roberts' sequence shifted at random.
vec3 lobe_mean(const Bsdf& b, double first, double last, int n, Random& random) {
  const vec3 shift(random.next(), random.next(), random.next());
  glm::dvec3 sum(0);
  for (int i = 0; i < n; ++i) {
    const auto u = [i](float from, double step) {
      return std::fmod(double(from) + i * step, 1.0) * 0.9999999;
    };
    const float lobe = float(first + (last - first) * u(shift.x, 0.5497004779));
    const vec2 v(float(u(shift.y, 0.8191725134)), float(u(shift.z, 0.6710436067)));
    BsdfSample s;
    if (sample_bsdf(b, std::min(lobe, 0.9999999f), v, s)) sum += s.weight * sqr(s.eta);
  }
  return vec3(sum / double(n));
}

/// Lobe by lobe, each from two sets of points, whose difference tells the error.
Mean albedo_of(const Bsdf& b, int n, Random& random) {
  Mean sum;
  const std::vector<double> ends = lobe_ends(b);
  for (size_t i = 0; i + 1 < ends.size(); ++i) {
    const vec3 one = lobe_mean(b, ends[i], ends[i + 1], n / 2, random);
    const vec3 two = lobe_mean(b, ends[i], ends[i + 1], n / 2, random);
    const Mean lobe{(one + two) * 0.5f, double(max_component(abs3(one - two))) / 2};
    add(sum, lobe, float(ends[i + 1] - ends[i]));
  }
  return sum;
}

constexpr float kDiscAngles = 16;

/// Over the disc that a ball shows from afar.
Mean disc_of(const Config& c, bool inside, int n, Random& random) {
  Mean sum;
  for (float i = 0.5f; i < kDiscAngles; ++i) {
    const vec3 wo = direction_at(std::sqrt(i / kDiscAngles), !inside);
    add(sum, albedo_of(bsdf_of(c, wo), n, random), 1 / kDiscAngles);
  }
  return sum;
}

/// No disc may be darker by more than 1 %, nor brighter by more than kAbove; but for noise, of
/// which estimates know little from few points.
void check_whole_disc(int count, bool inside) {
  Random random(inside ? 11 : 12);
  for (int i = 0; i < count; ++i) {
    Config c = white(random);
    if (inside) c.m.transmission = 1, c.m.metallic = 0;
    Mean disc = disc_of(c, inside, 256, random);
    const auto off = [&] {
      return double(max_component(disc.albedo)) > 1 + kAbove ||
             double(min_component(disc.albedo)) < 0.99;
    };
    for (int n = 2048; off() && n <= 16384; n *= 8) disc = disc_of(c, inside, n, random);
    const MaterialValues& m = c.m;
    CAPTURE(inside, m.metallic, m.roughness, m.specular, m.transmission, m.ior,
            m.transmission_roughness, m.anisotropic, m.sheen, m.sheen_roughness, m.clearcoat,
            m.clearcoat_roughness, m.iridescence, m.iridescence_ior, m.iridescence_thickness,
            m.diffuse_transmission, c.thin_walled, disc.error, disc.albedo.x, disc.albedo.y,
            disc.albedo.z);
    CHECK(double(max_component(disc.albedo)) < 1 + kAbove + 4 * disc.error);
    CHECK(double(min_component(disc.albedo)) > 0.99 - 4 * disc.error);
  }
}

}  // namespace

TEST_CASE("white furnace: materials neither lose nor gain over the whole disc, from either side") {
  check_whole_disc(200, false);
  check_whole_disc(100, true);
}
TEST_CASE("white furnace: 5,000 from outside, 1,000 from inside", "[.long]") {
  check_whole_disc(5000, false);
  check_whole_disc(1000, true);
}
