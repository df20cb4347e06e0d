// All parameters of the material: furnaces, sampling against densities, reciprocity, bounded
// weights.
#include "tests/unit/principled.h"
#include "kernels/bsdf/bsdf.h"
#include "tests/unit/catch.h"
#include "tests/unit/chi2.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

/// The standard material with some changes.
template <class F>
Config config(const char* name, F change, bool thin_walled = false) {
  Config c{name, standard(), thin_walled};
  change(c.m);
  return c;
}

/// One for each lobe, and mixtures.
std::vector<Config> configs() {
  const auto metal = [](MaterialValues& m) { m.metallic = 1; };
  const auto glass = [](MaterialValues& m) { m.transmission = 1; };
  return {
      config("anisotropic metal 0.4",
             [&](MaterialValues& m) { metal(m), m.roughness = 0.4f, m.anisotropic = 0.8f; }),
      config("anisotropic metal 0.9",
             [&](MaterialValues& m) { metal(m), m.roughness = 0.9f, m.anisotropic = 1; }),
      config("tinted plastic", [](MaterialValues& m) { m.specular_tint = 1; }),
      config("clearcoat 0.03 on paint",
             [](MaterialValues& m) { m.clearcoat = 1, m.clearcoat_roughness = 0.03f; }),
      config("rough clearcoat on rough metal",
             [&](MaterialValues& m) {
               metal(m), m.roughness = 0.8f, m.clearcoat = 1, m.clearcoat_roughness = 0.5f;
             }),
      config("sheen 0.5", [](MaterialValues& m) { m.sheen = 1, m.specular = 0; }),
      config("sheen 0.2 on plastic",
             [](MaterialValues& m) { m.sheen = 1, m.sheen_roughness = 0.2f; }),
      config("sheen under clearcoat",
             [](MaterialValues& m) { m.sheen = m.clearcoat = 1, m.clearcoat_roughness = 0.2f; }),
      config("rougher refraction",
             [&](MaterialValues& m) {
               glass(m), m.roughness = 0.3f, m.transmission_roughness = 0.3f;
             }),
      config(
          "polished outside, rough inside",
          [&](MaterialValues& m) { glass(m), m.roughness = 0, m.transmission_roughness = 0.5f; }),
      config(
          "rough sheet", [&](MaterialValues& m) { glass(m), m.roughness = 0.4f; }, true),
      config(
          "anisotropic sheet",
          [&](MaterialValues& m) { glass(m), m.roughness = 0.6f, m.anisotropic = 0.7f; }, true),
      config("film on metal",
             [&](MaterialValues& m) {
               metal(m), m.iridescence = 1, m.roughness = 0.4f, m.base_color = vec3(0.6f);
             }),
      config("film on plastic", [](MaterialValues& m) { m.iridescence = 1, m.roughness = 0.3f; }),
      config("strong film on rough plastic",
             [](MaterialValues& m) {
               m.iridescence = 1, m.iridescence_ior = 2.4f, m.roughness = 0.7f;
             }),
      config("film on glass",
             [&](MaterialValues& m) { glass(m), m.iridescence = 1, m.roughness = 0.4f; }),
      config("strong film on polished glass",
             [&](MaterialValues& m) {
               glass(m), m.iridescence = 1, m.iridescence_ior = 2, m.roughness = 0;
             }),
      config(
          "film on a sheet",
          [&](MaterialValues& m) {
            glass(m), m.iridescence = 1, m.iridescence_ior = 1.6f, m.roughness = 0.4f;
          },
          true),
      config("all at once", [](MaterialValues& m) {
        m.iridescence = 0.5f, m.metallic = 0.2f, m.transmission = 0.5f,
        m.transmission_roughness = 0.2f;
        m.anisotropic = 0.5f, m.sheen = 0.6f, m.clearcoat = 0.7f, m.clearcoat_roughness = 0.3f;
      })};
}

/// The ends of a range more often than by chance.
float parameter(Random& random) {
  const float u = random.next();
  return u < 0.2f ? 0 : u > 0.8f ? 1 : random.next();
}

void randomize(float& value, Random& random) { value = parameter(random); }
void randomize(vec3& value, Random& random) {
  value = vec3(parameter(random), random.next(), parameter(random));
}

/// Albedo, the error of its estimate, and the largest weight of a sample.
struct Furnace {
  vec3 albedo{0};
  float error = 0;
  float largest = 0;
  bool finite = true;
};
Furnace furnace(const Bsdf& b, int n) {
  Furnace f;
  Random random(5);
  double sum = 0, square = 0;
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      BsdfSample s;
      const vec2 u((float(i) + random.next()) / float(n), (float(j) + random.next()) / float(n));
      if (!sample_bsdf(b, random.next(), u, s)) continue;
      const vec3 w = s.weight * (s.eta * s.eta);
      f.albedo += w / float(n * n);
      f.largest = std::max(f.largest, max_component(w));
      // Of light that travels inside there is no direction, and all of it counts.
      const bool unit = s.lobe == Lobe::kSubsurface || std::fabs(length(s.wi) - 1) < 1e-4f;
      f.finite &= std::isfinite(w.x + w.y + w.z + s.pdf) && unit;
      sum += double(max_component(w));
      square += double(max_component(w)) * double(max_component(w));
    }
  }
  const double count = double(n) * n, mean = sum / count;
  f.error = float(std::sqrt(std::max(square / count - mean * mean, 0.0) / count));
  return f;
}

}  // namespace

TEST_CASE("principled: chi-squared of every lobe, level 1e-6") {
  for (const Config& c : configs()) {
    for (const float cosine : {0.95f, 0.5f, 0.12f}) {
      for (const bool front : {true, false}) {
        INFO(c.name << " cos " << cosine << " front " << front);
        const Bsdf b = bsdf_of(c, direction_at(cosine, front));
        Random random(5);
        const auto sample = [&](double& x, double& y) {
          BsdfSample s;
          const float choice = random.next(), u = random.next(), v = random.next();
          if (!sample_bsdf(b, choice, vec2(u, v), s) || s.pdf == 0) return false;
          to_square(s.wi, x, y);
          return true;
        };
        const auto density = [&](double x, double y) {
          return 4 * M_PI * double(evaluate_bsdf(b, from_square(x, y)).pdf);
        };
        // Fine steps: a narrow lobe must be integrated well.
        CHECK(square_p_value({24, 40, 40000}, sample, density) > kLevel);
      }
    }
  }
}

TEST_CASE("principled: a sample's weight is the value over the density, and bounded") {
  Random random(5);
  for (const Config& c : configs()) {
    for (const float cosine : {0.9f, 0.4f, 0.05f}) {
      const Bsdf b = bsdf_of(c, direction_at(cosine));
      for (int i = 0; i < 2000; ++i) {
        BsdfSample s;
        const float choice = random.next(), u = random.next(), v = random.next();
        if (!sample_bsdf(b, choice, vec2(u, v), s)) continue;
        INFO(c.name);
        REQUIRE(max_component(s.weight) * s.eta * s.eta < 8);
        if (s.pdf == 0) continue;
        const BsdfValue f = evaluate_bsdf(b, s.wi);
        REQUIRE(f.pdf == Approx(s.pdf));
        REQUIRE((f.diffuse + f.glossy).y == Approx(s.weight.y * s.pdf).margin(1e-7));
      }
    }
  }
}

/// Whether so many of 1,000 independent ones may be if this share is; level 1e-6 (Poisson).
bool may_be(int count, double share) {
  return count == 0 || 1 - upper_gamma(count, 1000 * share) > kLevel;
}

TEST_CASE("principled: 1,000 random materials are finite and give off at most what they take") {
  Random random(5);
  int bright = 0, heavy = 0;
  for (int i = 0; i < 1000; ++i) {
    MaterialValues m = standard();
#define HELIO_PARAMETER(name, components, standard, low, high) \
  if (float(high) == 1) randomize(m.name, random);
    HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
    if (random.next() < 0.3f) m.metallic = 0;
    if (random.next() < 0.3f) m.transmission = 0;
    m.ior = 1 + 2 * parameter(random);
    m.iridescence_ior = 1 + 2 * parameter(random);
    m.iridescence_thickness = 1000 * parameter(random);
    const Config c{"random", m, random.next() < 0.3f};
    const float cosine = 0.02f + 0.98f * random.next();
    const vec3 coat = normalize(kUp + 0.3f * vec3(random.next(), random.next(), 0));
    const Bsdf b = bsdf_of(c, direction_at(cosine, random.next() < 0.7f), coat);
    const Furnace f = furnace(b, 48);
    CAPTURE(i, cosine, m.metallic, m.roughness, m.transmission, m.transmission_roughness, m.ior,
            m.anisotropic, m.sheen, m.sheen_roughness, m.clearcoat, m.clearcoat_roughness,
            m.iridescence, m.iridescence_ior, m.iridescence_thickness, c.thin_walled, f.largest,
            f.error);
    CHECK(f.finite);
    CHECK(max_component(f.albedo) < 1.06f + 4.5f * f.error);
    bright += max_component(f.albedo) > 1.01f + 4.5f * f.error;
    heavy += f.largest > 16;
  }
  CHECK(may_be(bright, 0.002));  // see docs/materials.md
  CHECK(may_be(heavy, 0.005));   // heavier than 16 is one of 2,304 samples
}

TEST_CASE("principled: white and lossless loses and gains at most 1 %") {
  for (Config c : configs()) {
    c.m.base_color = vec3(1);
    for (const float cosine : {0.95f, 0.5f, 0.2f}) {
      const Furnace f = furnace(bsdf_of(c, direction_at(cosine)), 300);
      INFO(c.name << " cos " << cosine << " error " << f.error << " blue " << f.albedo.z);
      CHECK(std::fabs(f.albedo.y - 1) < 0.01f + 4 * f.error);
      CHECK(std::fabs(f.albedo.z - 1) < 0.01f + 4 * f.error);
    }
  }
}

TEST_CASE("principled: lobes that reflect are reciprocal, and what is diffuse below layers") {
  const auto black = [](MaterialValues& m) { m.base_color = vec3(0), m.specular = 0; };
  const Config reciprocal[] = {
      configs()[0], configs()[1],
      config("clearcoat alone",
             [&](MaterialValues& m) { black(m), m.clearcoat = 1, m.clearcoat_roughness = 0.4f; }),
      config("sheen alone", [&](MaterialValues& m) { black(m), m.sheen = 1; }),
      config("diffuse below both", [](MaterialValues& m) {
        m.sheen = 1, m.clearcoat = 1, m.clearcoat_roughness = 0, m.specular = 0;
      })};
  Random random(5);
  for (const Config& c : reciprocal) {
    const bool diffuse = &c == &reciprocal[4];
    for (int i = 0; i < 500; ++i) {
      const vec3 wo = direction_at(0.1f + 0.9f * random.next());
      const float z = 0.1f + 0.9f * random.next(), r = std::sqrt(1 - z * z);
      const float phi = 6.28f * random.next();
      const vec3 wi(r * std::cos(phi), r * std::sin(phi), z);
      BsdfValue there = evaluate_bsdf(bsdf_of(c, wo), wi);
      BsdfValue back = evaluate_bsdf(bsdf_of(c, wi), wo);
      if (diffuse) {  // without the sheen itself, which the clearcoat scales towards wo
        const Bsdf b = bsdf_of(c, wo), a = bsdf_of(c, wi);
        there.diffuse -= vec3(b.layers.below_clearcoat * sheen_reflection(b.layers.sheen, wo, wi));
        back.diffuse -= vec3(a.layers.below_clearcoat * sheen_reflection(a.layers.sheen, wi, wo));
      }
      INFO(c.name);
      REQUIRE((there.diffuse + there.glossy).x * wo.z ==
              Approx((back.diffuse + back.glossy).x * wi.z).epsilon(1e-3).margin(1e-6));
    }
  }
}

TEST_CASE("sheet: light passes straight on, both faces reflect") {
  const Config c = config(
      "sheet",
      [](MaterialValues& m) { m.base_color = vec3(0.5f), m.transmission = 1, m.roughness = 0; },
      true);
  for (const bool front : {true, false}) {
    const vec3 wo = direction_at(0.8f, front);
    const Bsdf b = bsdf_of(c, wo);
    const float face = fresnel_dielectric(0.8f, 1.5f).reflectance;
    const float both = 2 * face / (1 + face);
    BsdfSample s;
    double through = 0, reflected = 0;
    for (int i = 0; i < 1000; ++i) {
      REQUIRE(sample_bsdf(b, (float(i) + 0.5f) / 1000, vec2(0.5f), s));
      CHECK((s.pdf == 0 && s.eta == 1));
      (s.lobe == Lobe::kTransmission ? through : reflected) += double(s.weight.x) / 1000;
      if (s.lobe == Lobe::kTransmission) CHECK(length(s.wi + wo) < 1e-5f);
    }
    CHECK(reflected == Approx(both).epsilon(0.05));
    CHECK(through == Approx(0.5 * (1 - both)).epsilon(0.01));
  }
}
