// Thin films against what they are without one, and against the spectrum of an exact Airy sum.
#include <complex>

#include "kernels/bsdf/bsdf.h"
#include "tests/unit/catch.h"
#include "tests/unit/random.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

using Complex = std::complex<double>;

ThinFilm film_of(float ior, float nanometres) { return {1, ior, 2e-9f * nanometres * ior}; }

/// Piecewise Gaussian.
double lobe(double x, double middle, double before, double after) {
  const double t = (x - middle) / (x < middle ? before : after);
  return std::exp(-0.5 * t * t);
}

/// Linear Rec.709 of a reflectance by wavelength [nm] under light of equal energy, with white at 1.
///
/// Source: Wyman, Sloan and Shirley 2013, "Simple Analytic Approximations to the CIE XYZ Color
/// Matching Functions", JCGT 2(2), the multi-lobe fit.
template <class F>
vec3 color_of(F reflectance) {
  glm::dvec3 sum(0), white(0);
  for (double l = 360; l <= 830; l += 2) {
    const glm::dvec3 xyz(1.056 * lobe(l, 599.8, 37.9, 31.0) + 0.362 * lobe(l, 442.0, 16.0, 26.7) -
                             0.065 * lobe(l, 501.1, 20.4, 26.2),
                         0.821 * lobe(l, 568.8, 46.9, 40.5) + 0.286 * lobe(l, 530.9, 16.3, 31.1),
                         1.217 * lobe(l, 437.0, 11.8, 36.0) + 0.681 * lobe(l, 459.0, 26.0, 13.8));
    sum += xyz * reflectance(l);
    white += xyz;
  }
  const glm::dvec3 xyz = sum / white * glm::dvec3(0.95047, 1, 1.08883);
  return vec3(3.2404542 * xyz.x - 1.5371385 * xyz.y - 0.4985314 * xyz.z,
              -0.9692660 * xyz.x + 1.8760108 * xyz.y + 0.0415560 * xyz.z,
              0.0556434 * xyz.x - 0.2040259 * xyz.y + 1.0572252 * xyz.z);
}

/// Light in air at cosine c on a film of index n and thickness d [nm] over something of index n3.
struct Stack {
  double c, n, d, n3;
};

/// Airy's sum of all bounces at a wavelength [nm], both polarisations. schlick: what lies below has
/// this reflectance at normal incidence and Schlick's Fresnel; negative: that of n3.
double airy(const Stack& s, double wavelength, double schlick = -1) {
  const double c2 = std::sqrt(1 - (1 - s.c * s.c) / (s.n * s.n));
  const double c3 = std::sqrt(1 - (1 - s.c * s.c) / (s.n3 * s.n3));
  const Complex turned = std::polar(1.0, 4 * M_PI * s.n * s.d * c2 / wavelength);
  double sum = 0;
  for (const bool p : {false, true}) {
    const auto amplitude = [p](double from, double c_from, double to, double c_to) {
      return p ? (from * c_to - to * c_from) / (from * c_to + to * c_from)
               : (from * c_from - to * c_to) / (from * c_from + to * c_to);
    };
    const double outer = amplitude(1, s.c, s.n, c2);
    double inner = amplitude(s.n, c2, s.n3, c3);
    if (schlick >= 0) {
      const double below = (1 + std::sqrt(schlick)) / (1 - std::sqrt(schlick));
      const double normal = (s.n - below) / (s.n + below), f0 = normal * normal;
      inner = std::copysign(std::sqrt(f0 + (1 - f0) * std::pow(1 - c2, 5)), normal);
    }
    sum += 0.5 * std::norm((outer + inner * turned) / (1.0 + outer * inner * turned));
  }
  return sum;
}

MaterialValues metal(float roughness) {
  MaterialValues m{};
  m.base_color = vec3(0.9f, 0.6f, 0.3f);
  m.metallic = 1;
  m.roughness = roughness;
  m.ior = 1.5f;
  m.iridescence = 1;
  m.iridescence_ior = 1.6f;
  m.iridescence_thickness = 400;
  return m;
}

const vec3 kUp(0, 0, 1);
vec3 direction_at(float cosine) { return vec3(std::sqrt(1 - cosine * cosine), 0, cosine); }

vec3 value(const MaterialValues& m, vec3 wo, vec3 wi) {
  const BsdfValue f = evaluate_bsdf(make_bsdf(m, {wo, kUp, kUp}), wi);
  return f.diffuse + f.glossy;
}

}  // namespace

TEST_CASE("film: one without thickness is none, to the bit") {
  for (const float transmission : {0.0f, 0.6f}) {
    MaterialValues m = metal(0.3f);
    m.metallic = 0.5f;
    m.specular = 0.8f;
    m.specular_color = vec3(1);
    m.transmission = transmission;
    for (const float below : {1.0f, -1.0f}) {
      const vec3 wo = direction_at(0.6f), wi = normalize(vec3(-0.4f, 0.2f, below));
      const vec3 with = value(m, wo, wi);
      m.iridescence = 0;
      const vec3 none = value(m, wo, wi);
      m.iridescence = 1;
      m.iridescence_thickness = 0;
      CHECK(value(m, wo, wi) == none);
      m.iridescence_thickness = 400;
      if (transmission > 0 || below > 0) CHECK(length(with - none) > 1e-4f);
    }
  }
}

TEST_CASE("film: one of the index of a neighbour is not seen") {
  for (const float c : {1.0f, 0.7f, 0.2f}) {
    for (const float d : {50.0f, 400.0f}) {
      INFO("cos " << c << " thickness " << d);
      const float glass = fresnel_dielectric(c, 1.5f).reflectance;
      CHECK(film_on_dielectric(film_of(1, d), c, 1.5f).y == Approx(glass).epsilon(1e-4));
      CHECK(film_on_dielectric(film_of(1.5f, d), c, 1.5f).x == Approx(glass).epsilon(1e-4));
      const ThinFilm air = film_of(1, d);
      const vec3 gold(0.9f, 0.6f, 0.3f);
      const vec3 got = film_on_schlick(film_face(air, c), amplitude_below(air, gold));
      const vec3 expected = gold + (vec3(1) - gold) * schlick_weight(c);
      CHECK(length(got - expected) < 1e-4f);
    }
  }
}

TEST_CASE("film: white keeps all light, thick films have no colour") {
  const ThinFilm film = film_of(1.7f, 300);
  for (const float c : {1.0f, 0.5f, 0.02f})
    CHECK(length(film_on_schlick(film_face(film, c), amplitude_below(film, vec3(1))) - vec3(1)) <
          1e-4f);
  // Without interference: reflections of both faces and all bounces between them.
  const vec3 thick = film_on_dielectric(film_of(2, 9000), 1, 1);
  const float r = 1 / 9.0f;
  CHECK(thick.x == Approx(2 * r / (1 + r)).epsilon(1e-3));
  CHECK(length(thick - vec3(thick.x)) < 1e-4f);
}

TEST_CASE("film: the colours of an exact Airy sum") {
  // Three orders and one Gaussian for each sensitivity: 0.01 on average, most of it at the grazing
  // angles at which both faces reflect nearly everything.
  Random random(3);
  double total = 0;
  float largest = 0;
  constexpr int kStacks = 400;
  for (int i = 0; i < kStacks; ++i) {
    const bool schlick = i % 2 == 0;
    const Stack s{0.1 + 0.9 * double(random.next()), 1.1 + 0.9 * double(random.next()),
                  1000 * double(random.next()), 1 + 1.5 * double(random.next())};
    const double f0 = schlick ? 0.02 + 0.9 * double(random.next()) : -1;
    const ThinFilm film = film_of(float(s.n), float(s.d));
    const vec3 got = schlick ? film_on_schlick(film_face(film, float(s.c)),
                                               amplitude_below(film, vec3(float(f0))))
                             : film_on_dielectric(film, float(s.c), float(s.n3));
    const vec3 exact = color_of([&](double l) { return airy(s, l, f0); });
    const float error = max_component(abs3(got - glm::clamp(exact, vec3(0), vec3(1))));
    CAPTURE(s.c, s.n, s.d, s.n3, f0);
    CHECK(error < 0.08f);
    largest = std::max(largest, error);
    total += double(error) / kStacks;
  }
  CAPTURE(largest);
  CHECK(total < 0.012);
}

TEST_CASE("film: it reflects the same from both sides of glass") {
  for (const float c : {0.95f, 0.6f, 0.3f}) {
    const float ior = 1.5f;
    const float inside = fresnel_dielectric(c, ior).cos_t;
    const ThinFilm film = film_of(1.9f, 350);
    const ThinFilm from_inside{1, 1.9f / ior, film.way};
    const vec3 front = film_on_dielectric(film, c, ior);
    const vec3 back = film_on_dielectric(from_inside, inside, 1 / ior);
    CHECK(length(front - back) < 1e-4f);
    CHECK(front.x != Approx(double(front.z)).epsilon(0.02));
  }
  CHECK(film_on_dielectric({1, 1.3f / 1.5f, 1e-6f}, 0.5f, 1 / 1.5f) == vec3(1));
}

TEST_CASE("film: metal below it is reciprocal, its colour depends on the half vector") {
  Random random(5);
  const MaterialValues m = metal(0.4f);
  for (int i = 0; i < 200; ++i) {
    const vec3 wo = direction_at(0.1f + 0.9f * random.next());
    const float z = 0.1f + 0.9f * random.next();
    const float r = std::sqrt(1 - z * z), phi = 6.28f * random.next();
    const vec3 wi(r * std::cos(phi), r * std::sin(phi), z);
    const vec3 there = value(m, wo, wi) * wo.z, back = value(m, wi, wo) * wi.z;
    REQUIRE(length(there - back) < 1e-3f * length(there) + 1e-6f);
  }
  // Directions on a cone about the normal: the same cosines, other half vectors.
  const vec3 wo = direction_at(0.6f);
  const vec3 near = value(m, wo, normalize(vec3(0.7f, 0.4f, 0.6f)));
  const vec3 far = value(m, wo, vec3(-wo.x, 0, wo.z));
  CHECK(std::fabs(near.x / near.z - far.x / far.z) > 0.05f);
}
