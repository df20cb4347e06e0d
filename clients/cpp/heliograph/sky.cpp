// The air by Hillaire 2020, "A Scalable and Production Ready Sky and Atmosphere Rendering
// Technique".
#include "heliograph/sky.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include "heliograph/error.h"

namespace heliograph::client {
namespace {

constexpr double kPi = 3.14159265358979323846;
using Rgb = std::array<double, 3>;

// Per metre at sea level, for wavelengths of 680, 550 and 440 nm; heights in metres. Table 1.
constexpr Rgb kRayleigh{5.802e-6, 13.558e-6, 33.1e-6};
constexpr double kMieScattering = 3.996e-6, kMieAbsorption = 0.444e-6;
constexpr Rgb kOzone{0.650e-6, 1.881e-6, 0.085e-6};
constexpr double kRayleighHeight = 8000, kMieHeight = 1200;
constexpr double kMieAsymmetry = 0.8;
constexpr double kGround = 6.360e6, kTop = 6.460e6;
// Linear Rec.709 of 128 klx of black-body light of 5,772 K (683 lm/W): the sun outside the air.
constexpr Rgb kSunOutside{128e3 / 683 * 1.1023, 128e3 / 683 * 0.9795, 128e3 / 683 * 0.9035};
constexpr std::size_t kSteps = 24, kHeights = 24, kCosines = 64, kViews = 24;
constexpr std::size_t kAzimuths = 64;  // at which the integrals are made

double square(double x) { return x * x; }

void add(Rgb& sum, const Rgb& x, const Rgb& y) {
  for (std::size_t c = 0; c < 3; ++c) sum[c] += x[c] * y[c];
}

Rgb mix(const Rgb& a, const Rgb& b, double t) {
  Rgb out{};
  for (std::size_t c = 0; c < 3; ++c) out[c] = a[c] * (1 - t) + b[c] * t;
  return out;
}

Rgb rayleigh_at(double height) {
  const double density = std::exp(-height / kRayleighHeight);
  return {kRayleigh[0] * density, kRayleigh[1] * density, kRayleigh[2] * density};
}

Rgb extinction_at(double height, double aerosol) {
  const double mie = std::exp(-height / kMieHeight) * aerosol * (kMieScattering + kMieAbsorption);
  const double ozone = std::max(0.0, 1 - std::fabs(height - 25e3) / 15e3);
  Rgb out = rayleigh_at(height);
  for (std::size_t c = 0; c < 3; ++c) out[c] += mie + ozone * kOzone[c];
  return out;
}

/// Distance to the far side of a sphere about the earth's middle.
double to_sphere(double radius, double cosine, double sphere) {
  return std::sqrt(square(radius) * (square(cosine) - 1) + square(sphere)) - radius * cosine;
}

bool meets_ground(double radius, double cosine) {
  return cosine < 0 && square(radius) * (square(cosine) - 1) + square(kGround) > 0;
}

/// Steps that grow with the square of the distance: edge i of a length of 1.
double edge(std::size_t i) { return square(double(i) / kSteps); }

struct Step {
  double t = 0;       // distance of its middle
  double r = 0;       // its distance to the earth's middle
  Rgb by_rayleigh{};  // light that scatters there for a phase function of 1
  Rgb by_mie{};
  [[nodiscard]] double height() const { return std::max(r - kGround, 0.0); }
};

/// A ray in steps: all that does not depend on the sun.
struct Ray {
  std::array<Step, kSteps> steps{};
  Rgb to_ground{};  // share of light from the ground; 0 where the ray misses it
};

Ray make_ray(double radius, double cosine, double aerosol) {
  const bool grounded = meets_ground(radius, cosine);
  const double half = square(radius) * (square(cosine) - 1) + square(kGround);
  const double length = std::max(0.0, grounded ? -radius * cosine - std::sqrt(std::max(half, 0.0))
                                               : to_sphere(radius, cosine, kTop));
  Ray ray;
  Rgb depth{};
  for (std::size_t i = 0; i < kSteps; ++i) {
    Step& step = ray.steps[i];
    step.t = length * 0.5 * (edge(i) + edge(i + 1));
    step.r = std::sqrt(square(radius) + square(step.t) + 2 * radius * cosine * step.t);
    const Rgb extinction = extinction_at(step.height(), aerosol);
    const Rgb rayleigh = rayleigh_at(step.height());
    const double mie = std::exp(-step.height() / kMieHeight) * aerosol * kMieScattering;
    for (std::size_t c = 0; c < 3; ++c) {
      const double each = extinction[c] * length * (edge(i + 1) - edge(i));
      const double weight = std::exp(-depth[c]) * (1 - std::exp(-each)) / extinction[c];
      depth[c] += each;
      step.by_rayleigh[c] = weight * rayleigh[c];
      step.by_mie[c] = weight * mie;
    }
  }
  if (grounded)
    for (std::size_t c = 0; c < 3; ++c) ray.to_ground[c] = std::exp(-depth[c]);
  return ray;
}

/// Cosine of the sun's zenith angle at a step, from that at the ray's origin and from the cosine
/// between ray and sun.
double up_at(const Step& step, double radius, double zenith, double view) {
  return (radius * zenith + step.t * view) / step.r;
}

/// Interval of increasing places that holds x: its index, and the share of the way to the next.
template <std::size_t N>
std::pair<std::size_t, double> place(const std::array<double, N>& places, double x) {
  const auto* const above = std::upper_bound(places.begin() + 1, places.end() - 1, x);
  const auto i = std::size_t(above - places.begin()) - 1;
  return {i, std::clamp((x - places[i]) / (places[i + 1] - places[i]), 0.0, 1.0)};
}

/// Tables over (height, cosine of the sun's zenith angle), as of Hillaire 2020, sections 5.2, 5.5.
class Tables {
 public:
  using Table = std::array<std::array<Rgb, kCosines>, kHeights>;

  Tables(double aerosol, double albedo) : aerosol_(aerosol), albedo_(albedo) {
    for (std::size_t i = 0; i < kHeights; ++i)
      heights_[i] = square(double(i) / (kHeights - 1)) * (kTop - kGround - 1);
    for (std::size_t j = 0; j < kCosines; ++j)
      cosines_[j] = std::sinh(-3 + 6 * double(j) / (kCosines - 1)) / std::sinh(3.0);
    for (std::size_t i = 0; i < kHeights; ++i)
      for (std::size_t j = 0; j < kCosines; ++j)
        transmittance_[i][j] = passed(heights_[i], cosines_[j]);
    for (std::size_t i = 0; i < kHeights; ++i) multiple_[i] = scattered_again(heights_[i]);
  }

  [[nodiscard]] double aerosol() const { return aerosol_; }
  /// Share of the sun's light that arrives.
  [[nodiscard]] Rgb sunlight(double height, double cosine) const {
    return look_up(transmittance_, height, cosine);
  }
  /// Radiance of light that has scattered twice or more, the same in all directions.
  [[nodiscard]] Rgb multiple(double height, double cosine) const {
    return look_up(multiple_, height, cosine);
  }

 private:
  [[nodiscard]] Rgb look_up(const Table& table, double height, double cosine) const {
    const auto [i, v] = place(heights_, height);
    const auto [j, u] = place(cosines_, cosine);
    return mix(mix(table[i][j], table[i + 1][j], v), mix(table[i][j + 1], table[i + 1][j + 1], v),
               u);
  }

  [[nodiscard]] Rgb passed(double height, double cosine) const {
    const double radius = kGround + height;
    if (meets_ground(radius, cosine)) return {};
    const double length = to_sphere(radius, cosine, kTop);
    Rgb depth{};
    for (std::size_t i = 0; i < kSteps; ++i) {
      const double t = length * 0.5 * (edge(i) + edge(i + 1));
      const double r = std::sqrt(square(radius) + square(t) + 2 * radius * cosine * t);
      const Rgb extinction = extinction_at(std::max(r - kGround, 0.0), aerosol_);
      for (std::size_t c = 0; c < 3; ++c)
        depth[c] += extinction[c] * length * (edge(i + 1) - edge(i));
    }
    return {std::exp(-depth[0]), std::exp(-depth[1]), std::exp(-depth[2])};
  }

  /// The second order's mean over directions, times the geometric series of all further ones.
  [[nodiscard]] std::array<Rgb, kCosines> scattered_again(double height) const {
    const double radius = kGround + height + 1;
    std::array<Rgb, kCosines> second{};
    Rgb kept{};
    for (std::size_t n = 0; n < kViews; ++n) {  // a spherical Fibonacci lattice
      const double z = 1 - 2 * (double(n) + 0.5) / kViews;
      const double x =
          std::sqrt(1 - z * z) * std::cos(kPi * (1 + std::sqrt(5.0)) * (double(n) + 0.5));
      const Ray ray = make_ray(radius, z, aerosol_);
      for (const Step& step : ray.steps)
        for (std::size_t c = 0; c < 3; ++c)
          kept[c] += (step.by_rayleigh[c] + step.by_mie[c]) / kViews;
      for (std::size_t k = 0; k < kCosines; ++k) {
        const double view = x * std::sqrt(1 - square(cosines_[k])) + z * cosines_[k];
        add(second[k], once(ray, radius, cosines_[k], view),
            {1.0 / kViews, 1.0 / kViews, 1.0 / kViews});
      }
    }
    for (Rgb& value : second)
      for (std::size_t c = 0; c < 3; ++c) value[c] /= 1 - kept[c];
    return second;
  }

  /// Sunlight that comes along a ray after one scattering, as if that were isotropic, or from the
  /// ground.
  [[nodiscard]] Rgb once(const Ray& ray, double radius, double zenith, double view) const {
    Rgb sum{};
    for (const Step& step : ray.steps) {
      Rgb scattered{};
      for (std::size_t c = 0; c < 3; ++c)
        scattered[c] = (step.by_rayleigh[c] + step.by_mie[c]) / (4 * kPi);
      add(sum, scattered, sunlight(step.height(), up_at(step, radius, zenith, view)));
    }
    const double ground = up_at(ray.steps.back(), radius, zenith, view);
    Rgb bounced = sunlight(0, ground);
    for (double& value : bounced) value *= std::max(ground, 0.0) * albedo_ / kPi;
    add(sum, ray.to_ground, bounced);
    return sum;
  }

  double aerosol_, albedo_;
  std::array<double, kHeights> heights_{};
  std::array<double, kCosines> cosines_{};
  Table transmittance_{}, multiple_{};
};

/// Cornette and Shanks 1992.
double mie_phase(double cosine) {
  constexpr double g = kMieAsymmetry;
  const double scale = 3 / (8 * kPi) * (1 - g * g) / (2 + g * g);
  return scale * (1 + square(cosine)) / std::pow(1 + g * g - 2 * g * cosine, 1.5);
}

struct Integrals {
  Rgb rayleigh{}, mie{}, multiple{};
};

/// The upper half's radiance for a sun of irradiance 1 at azimuth 0: row theta, columns from the
/// sun's azimuth to the opposite one.
std::vector<Rgb> sky_row(const Tables& tables, double radius, double theta,
                         std::pair<double, std::size_t> sun) {
  const auto [elevation, columns] = sun;
  const double level = std::cos(elevation), up = std::sin(elevation);
  const auto between = [&](double phi) {
    return std::sin(theta) * std::cos(phi) * level + std::cos(theta) * up;
  };
  const Ray ray = make_ray(radius, std::cos(theta), tables.aerosol());
  const std::size_t coarse = std::min(columns, kAzimuths);
  std::vector<Integrals> sums(coarse + 1);
  for (std::size_t k = 0; k <= coarse; ++k)
    for (const Step& step : ray.steps) {
      const double at = up_at(step, radius, up, between(kPi * double(k) / double(coarse)));
      const Rgb sunlight = tables.sunlight(step.height(), at);
      const Rgb multiple = tables.multiple(step.height(), at);
      add(sums[k].rayleigh, step.by_rayleigh, sunlight);
      add(sums[k].mie, step.by_mie, sunlight);
      add(sums[k].multiple, step.by_rayleigh, multiple);
      add(sums[k].multiple, step.by_mie, multiple);
    }
  std::vector<Rgb> out(columns);
  for (std::size_t x = 0; x < columns; ++x) {
    const double at = (double(x) + 0.5) / double(columns) * double(coarse);
    const auto j = std::size_t(at);
    const double u = at - double(j), cosine = between(kPi * (double(x) + 0.5) / double(columns));
    const Rgb rayleigh = mix(sums[j].rayleigh, sums[j + 1].rayleigh, u);
    const Rgb mie = mix(sums[j].mie, sums[j + 1].mie, u);
    out[x] = mix(sums[j].multiple, sums[j + 1].multiple, u);
    for (std::size_t c = 0; c < 3; ++c)
      out[x][c] += rayleigh[c] * 3 / (16 * kPi) * (1 + square(cosine)) + mie[c] * mie_phase(cosine);
  }
  return out;
}

void check(const char* name, double value, double low, double high) {
  if (value >= low && value <= high) return;
  throw ClientError(Code::kInvalidArgument,
                    std::string(name) + ": " + std::to_string(value) + " is not in [" +
                        std::to_string(low) + ", " + std::to_string(high) + "]",
                    {name});
}

void check(double elevation, const Air& air) {
  check("elevation", elevation, -kPi / 2, kPi / 2);
  check("aerosol", air.aerosol, 0, 20);
  check("albedo", air.albedo, 0, 1);
  check("height", air.height, 0, 50e3);
  if (air.width < 8 || air.width % 4 != 0)
    throw ClientError(Code::kInvalidArgument,
                      "width: " + std::to_string(air.width) + " is not a multiple of 4 from 8 on",
                      {"width"});
}

/// (H, W, 3) of the half from the sun's azimuth on, mirrored and turned by the azimuth.
Array picture_of(const std::vector<std::vector<Rgb>>& half, double azimuth) {
  const std::size_t rows = half.size(), width = 2 * rows;
  const double turn = -azimuth / (2 * kPi) * double(width), low = std::floor(turn);
  const auto at = [&](std::size_t y, double x) {  // column x of the picture before its turn
    const double wrapped = x - std::floor(x / double(width)) * double(width);
    const auto column = std::size_t(wrapped);
    return half[y][column < rows ? rows - 1 - column : column - rows];
  };
  std::vector<std::array<float, 3>> pixels;
  pixels.reserve(rows * width);
  for (std::size_t y = 0; y < rows; ++y)
    for (std::size_t x = 0; x < width; ++x) {
      const Rgb value = mix(at(y, double(x) - low), at(y, double(x) - low - 1), turn - low);
      pixels.push_back({float(value[0] * kSunOutside[0]), float(value[1] * kSunOutside[1]),
                        float(value[2] * kSunOutside[2])});
    }
  return {std::move(pixels), {rows, width, 3}};
}

}  // namespace

Sky sky(double elevation, double azimuth, const Air& air) {
  check(elevation, air);
  const Tables tables(air.aerosol, air.albedo);
  // The picture is symmetric about the sun's azimuth: half of it, the sun at its first column.
  const std::size_t rows = std::size_t(air.width) / 2, above = rows / 2;
  std::vector<std::vector<Rgb>> half;
  Rgb diffuse{};
  for (std::size_t y = 0; y < above; ++y) {
    const double theta = kPi * (double(y) + 0.5) / double(rows);
    const double weight =
        std::cos(theta) * std::sin(theta) * 2 * square(kPi) / (double(rows) * double(rows));
    half.push_back(sky_row(tables, kGround + air.height + 1, theta, {elevation, rows}));
    for (const Rgb& value : half.back()) add(diffuse, value, {weight, weight, weight});
  }
  const double up = std::sin(elevation);
  const Rgb direct = tables.sunlight(air.height + 1, up);
  Rgb ground{};
  for (std::size_t c = 0; c < 3; ++c)
    ground[c] = air.albedo / kPi * (diffuse[c] + direct[c] * std::max(up, 0.0));
  half.resize(rows, std::vector<Rgb>(rows, ground));
  const double level = std::cos(elevation);
  return {picture_of(half, azimuth),
          {direct[0] * kSunOutside[0], direct[1] * kSunOutside[1], direct[2] * kSunOutside[2]},
          {level * std::cos(azimuth), level * std::sin(azimuth), up}};
}

}  // namespace heliograph::client
