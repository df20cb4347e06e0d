// Writes kernels/bsdf/ggx_tables.h: albedos of GGX microfacets after a single scattering. Takes
// about a minute; the result is checked in.
//
//   g++ -std=c++20 -O3 -ffast-math -I. scripts/make_ggx_tables.cpp -o make_ggx_tables
//   ./make_ggx_tables > kernels/bsdf/ggx_tables.h
#include <array>
#include <cstdio>
#include <string_view>
#include <vector>

#include "kernels/bsdf/ggx_axes.h"

namespace heliograph::kernels::inline HELIO_ISA {
KERNEL double root(double x) { return std::sqrt(x); }
}  // namespace heliograph::kernels::inline HELIO_ISA

using namespace heliograph::kernels;
using dvec3 = glm::dvec3;
using Two = std::array<double, 2>;

namespace {

struct Alpha {
  double x, y;
};

double lambda(dvec3 w, Alpha a) {
  const double slope2 = sqr(a.x * w.x) + sqr(a.y * w.y);
  return (std::sqrt(1 + slope2 / std::max(sqr(w.z), 1e-12)) - 1) / 2;
}

/// Share of the light between wo and wi that no other microfacet holds up, of what wo sees.
double open_to(double lambda_wo, dvec3 wi, Alpha a) {
  return (1 + lambda_wo) / (1 + lambda_wo + lambda(wi, a));
}

dvec3 direction(double mu, double cos_phi = 1) {
  const double sine = std::sqrt(1 - mu * mu);
  return {sine * cos_phi, sine * std::sqrt(1 - sqr(cos_phi)), mu};
}

/// Normals visible from wo (Dupuy and Benyoub 2023), over a Fibonacci lattice: what happens at the
/// edge of the hemisphere is as narrow as alpha, and a grid of as many points has few rows there.
template <class Visit>
void visible_normals(dvec3 wo, Alpha a, const Visit& visit) {
  constexpr u32 kPoints = 17711, kStep = 10946;
  static const std::vector<Two> circle = [] {
    std::vector<Two> points(kPoints);
    for (u64 i = 0; i < kPoints; ++i) {
      const double phi = 2 * M_PI * (double(i * kStep % kPoints) + 0.5) / kPoints;
      points[i] = {std::cos(phi), std::sin(phi)};
    }
    return points;
  }();
  const dvec3 s = normalize(wo * dvec3(a.x, a.y, 1));
  for (u32 i = 0; i < kPoints; ++i) {
    const double z = (1 - (i + 0.5) / kPoints) * (1 + s.z) - s.z;
    const double r = std::sqrt(std::max(1 - z * z, 0.0));
    const dvec3 h = s + dvec3(r * circle[i][0], r * circle[i][1], z);
    visit(normalize(h * dvec3(a.x, a.y, 1)), 1.0 / kPoints);
  }
}

/// Albedo with Fresnel 1, and the same weighted by (1 - cos)^5: what both lack of a mirror's, over
/// loss_scale().
Two reflection_loss(dvec3 wo, Alpha a) {
  const double lambda_wo = lambda(wo, a);
  Two sum{};
  visible_normals(wo, a, [&](dvec3 h, double weight) {
    const double c = dot(h, wo);
    const dvec3 wi = h * (2 * c) - wo;
    if (wi.z <= 0) return;
    const double share = weight * open_to(lambda_wo, wi, a), m = 1 - c;
    sum[0] += share;
    sum[1] += share * m * sqr(sqr(m));
  });
  const double scale = loss_scale(wo.z, a.x), m = 1 - wo.z;
  return {(1 - sum[0]) / scale, (m * sqr(sqr(m)) - sum[1]) / scale};
}

/// Shares of light in one scattering, as struct GlassAlbedo has them.
std::array<double, 4> glass_shares(double mu, double alpha, double eta) {
  const dvec3 wo = direction(mu);
  const Alpha a{alpha, alpha};
  const double lambda_wo = lambda(wo, a);
  std::array<double, 4> sum{};
  visible_normals(wo, a, [&](dvec3 h, double weight) {
    const double c = dot(h, wo);
    const dvec3 up = h * (2 * c) - wo;
    const double reflects = up.z > 0 ? weight * open_to(lambda_wo, up, a) : 0;
    const double t2 = 1 - (1 - c * c) / sqr(eta);
    if (t2 <= 0) {
      sum[1] += reflects;
      return;
    }
    const double t = std::sqrt(t2);
    const double fresnel =
        (sqr((eta * c - t) / (eta * c + t)) + sqr((c - eta * t) / (c + eta * t))) / 2;
    const dvec3 down = h * (c / eta - t) - wo / eta;
    const double refracts = down.z < 0 ? weight * open_to(lambda_wo, down, a) : 0;
    sum[0] += fresnel * reflects;
    sum[2] += (1 - fresnel) * refracts;
    sum[3] += fresnel * refracts;
  });
  return sum;
}

/// The number in [1e-6, 1] that an axis has at entry i of n.
template <class Axis>
double number_at(u32 i, u32 n, const Axis& axis) {
  double low = 1e-6, high = 1;
  for (u32 step = 0; step < 60; ++step) {
    const double middle = (low + high) / 2;
    (axis(middle) < double(i) / (n - 1) ? low : high) = middle;
  }
  return low;
}

double alpha_of(u32 i, u32 n) { return std::max(sqr(double(i) / (n - 1)), 1e-4); }

/// Losses over the cosines of one row.
struct Row {
  Alpha alpha;
  double seen;  // alpha that wo sees, which is the axis'
  std::vector<Two> losses;
};
Row reflection_row(Alpha a, u32 cosines, double cos_phi = 1) {
  Row row{a, std::sqrt(sqr(a.x * cos_phi) + sqr(a.y) * (1 - sqr(cos_phi))), {}};
  for (u32 i = 0; i < cosines; ++i) {
    const double mu = number_at(i, cosines, [&](double x) { return axis_place(x, row.seen); });
    row.losses.push_back(reflection_loss(direction(mu, cos_phi), a));
  }
  return row;
}

/// Between entries, as kernels interpolate.
Two loss_at(const Row& row, double mu) {
  const double place = axis_place(mu, row.seen) * double(row.losses.size() - 1);
  const size_t i = std::min(size_t(place), row.losses.size() - 2);
  const double w = place - double(i), scale = loss_scale(mu, row.alpha.x);
  const Two a = row.losses[i], b = row.losses[i + 1];
  return {(a[0] + (b[0] - a[0]) * w) * scale, (a[1] + (b[1] - a[1]) * w) * scale};
}

/// Average by cosine, over alpha along x times alpha along y.
Two average_loss(const Row& row) {
  constexpr u32 kPoints = 20000;
  Two sum{};
  for (u32 i = 0; i < kPoints; ++i) {
    const double x = (i + 0.5) / kPoints;  // the fourth root of the cosine: small ones count
    const Two loss = loss_at(row, sqr(sqr(x)));
    const double weight = 8 * sqr(x * x * x) * x / kPoints / (row.alpha.x * row.alpha.y);
    for (u32 k = 0; k < 2; ++k) sum[k] += loss[k] * weight;
  }
  return sum;
}

class Table {
 public:
  Table(const char* name, u32 size, const char* comment) {
    std::printf("/// %s\nHELIO_TABLE float %s[%u] = {\n", comment, name, size);
  }
  ~Table() { std::printf("};\n"); }
  template <class Values>
  void add(const Values& values) {
    for (const double v : values) {
      char text[32];
      std::snprintf(text, sizeof text, "%.6g", v);
      const bool whole = std::string_view(text).find_first_of(".e") == std::string_view::npos;
      std::printf("%s%sf,%s", text, whole ? ".0" : "", ++count_ % 8 == 0 ? "\n" : " ");
    }
  }

 private:
  u32 count_ = 0;
};

void write_isotropic() {
  std::vector<Row> rows;
  for (u32 r = 0; r < kAlbedoRoughnesses; ++r) {
    const double a = alpha_of(r, kAlbedoRoughnesses);
    rows.push_back(reflection_row({a, a}, kAlbedoCosines));
  }
  {
    Table table("kReflectionLoss", 2 * kAlbedoRoughnesses * kAlbedoCosines,
                "[roughness][axis_place()][of Fresnel 1, of (1 - cos_h)^5], over loss_scale()");
    for (const Row& row : rows)
      for (const Two& loss : row.losses) table.add(loss);
  }
  Table table("kReflectionAverageLoss", 2 * kAlbedoRoughnesses,
              "[roughness][the same two], averaged by cosine, over alpha squared");
  for (const Row& row : rows) table.add(average_loss(row));
}

void write_anisotropic() {
  std::vector<Two> averages;
  {
    Table table(
        "kAnisotropicLoss",
        2 * kAnisotropies * kAnisotropicRoughnesses * kAnisotropicPhis * kAnisotropicCosines,
        "[aspect_place()][roughness][cos(phi)][axis_place()][the same two]");
    for (u32 i = 0; i < kAnisotropies * kAnisotropicRoughnesses; ++i) {
      const double place = double(i / kAnisotropicRoughnesses) / (kAnisotropies - 1);
      const double aspect = 1 - place * (1 - kLeastAspect);
      const double a = alpha_of(i % kAnisotropicRoughnesses, kAnisotropicRoughnesses);
      std::vector<Two> by_phi;
      for (u32 p = 0; p < kAnisotropicPhis; ++p) {
        const Row row = reflection_row({a / aspect, a * aspect}, kAnisotropicCosines,
                                       double(p) / (kAnisotropicPhis - 1));
        for (const Two& loss : row.losses) table.add(loss);
        by_phi.push_back(average_loss(row));
      }
      // Over the azimuth, of values over cos(phi) that are interpolated.
      Two sum{};
      for (u32 k = 0; k < 400; ++k) {
        const double place = std::cos((k + 0.5) / 400 * M_PI / 2) * (kAnisotropicPhis - 1);
        const u32 p = std::min(u32(place), kAnisotropicPhis - 2);
        for (u32 n = 0; n < 2; ++n)
          sum[n] += (by_phi[p][n] + (by_phi[p + 1][n] - by_phi[p][n]) * (place - p)) / 400;
      }
      averages.push_back(sum);
    }
  }
  Table table("kAnisotropicAverageLoss", 2 * u32(averages.size()),
              "[aspect_place()][roughness][the same two], over alpha squared");
  for (const Two& average : averages) table.add(average);
}

void write_glass(const char* name, bool enters, u32 iors, u32 roughnesses, u32 cosines) {
  Table table(name, 4 * iors * roughnesses * cosines,
              "[ior_place()][roughness][glass_place()][as GlassAlbedo]");
  for (u32 i = 0; i < iors * roughnesses; ++i) {
    const double place = double(i / roughnesses) / (iors - 1);
    const double x2 = sqr(kLeastIorRoot + place * (double(kLargestIorRoot) - kLeastIorRoot));
    const double ior = (1 + x2) / (1 - x2), eta = enters ? ior : 1 / ior;
    const double alpha = alpha_of(i % roughnesses, roughnesses);
    for (u32 m = 0; m < cosines; ++m) {
      const double mu = number_at(m, cosines, [&](double x) { return glass_place(x, alpha, eta); });
      table.add(glass_shares(mu, alpha, eta));
    }
  }
}

}  // namespace

int main() {
  std::printf(
      "// Albedos of GGX microfacets (single scattering). Written by scripts/make_ggx_tables.cpp.\n"
      "#pragma once\n\n#include \"kernels/bsdf/ggx_axes.h\"\n\n"
      "namespace heliograph::kernels::inline HELIO_ISA {\n\n// clang-format off\n");
  write_isotropic();
  write_anisotropic();
  write_glass("kEnteringAlbedo", true, kEnteringIors, kEnteringRoughnesses, kEnteringCosines);
  write_glass("kLeavingAlbedo", false, kLeavingIors, kLeavingRoughnesses, kLeavingCosines);
  std::printf("// clang-format on\n\n}  // namespace heliograph::kernels::inline HELIO_ISA\n");
}
