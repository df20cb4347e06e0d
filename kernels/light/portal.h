// The dome through windows: directions in proportion to the light that a rectangle lets through to
// a point. Called by light.h; who fills a PortalView makes its map with the functions here.
//
// A map holds the dome over a portal's half space, by the slopes t of a direction along the
// portal's sides, each as t / (1 + |t|). There every point sees the portal as an upright rectangle,
// over which sums of the map are differences of its running sums.
//
// Source: Bitterli, Novák and Jarosz 2015, "Portal-Masked Environment Map Sampling", sections 3 and
// 4; they take the angles of the slopes, which cost more and are as even.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Rounding of where a sampled direction meets its portal's plane, relative to the portal.
inline constexpr float kPortalSlack = 1 + 1e-5f;

/// Place of a local direction in [0, 1]^2. d.z > 0.
KERNEL vec2 portal_place(vec3 d) {
  return vec2(0.5f + 0.5f * d.x / (d.z + std::fabs(d.x)),
              0.5f + 0.5f * d.y / (d.z + std::fabs(d.y)));
}
/// The unit direction at a place.
KERNEL vec3 portal_direction(vec2 place) {
  const vec2 s = 2.0f * place - 1.0f;
  const vec2 rest = 1.0f - vec2(std::fabs(s.x), std::fabs(s.y));
  return normalize_or(vec3(s.x * rest.y, s.y * rest.x, rest.x * rest.y), vec3(0, 0, 1));
}
/// Solid angle of a unit of the map's area about a unit direction.
KERNEL float portal_stretch(vec3 d) {
  return 4 * sqr(d.z + std::fabs(d.x)) * sqr(d.z + std::fabs(d.y)) / max2(d.z, 1e-6f);
}

/// The part of a map, in texels, that a portal shows to a point; empty where the point is behind
/// it.
struct PortalWindow {
  vec2 low{0}, high{0};
};
KERNEL PortalWindow portal_window(const PortalView& portal, vec3 p) {
  const vec3 d = portal.center - p;
  const float depth = dot(d, portal.z);
  if (!(depth > 0)) return {};
  const vec2 middle(dot(d, portal.x), dot(d, portal.y));
  const vec2 low = middle - portal.half, high = middle + portal.half;
  return {portal_place(vec3(low, depth)) * float(kPortalSide),
          portal_place(vec3(high, depth)) * float(kPortalSide)};
}

/// The running sum at a column and a place between rows.
KERNEL double portal_sum(const double* sums, u32 x, double y) {
  const u32 row = min2(u32(y), kPortalSide - 1);
  const double* at = sums + u64(row) * (kPortalSide + 1) + x;
  return at[0] + (at[kPortalSide + 1] - at[0]) * (y - row);
}
/// Part of the running sum at column x that lies between two rows.
KERNEL double portal_band(const double* sums, u32 x, double low, double high) {
  return portal_sum(sums, x, high) - portal_sum(sums, x, low);
}
KERNEL double portal_band(const double* sums, double x, double low, double high) {
  const u32 column = min2(u32(x), kPortalSide - 1);
  const double left = portal_band(sums, column, low, high);
  return left + (portal_band(sums, column + 1, low, high) - left) * (x - column);
}
KERNEL double window_light(const PortalView& portal, const PortalWindow& w) {
  const double* sums = portal.sums;
  return max2(portal_band(sums, double(w.high.x), w.low.y, w.high.y) -
                  portal_band(sums, double(w.low.x), w.low.y, w.high.y),
              0.0);
}

/// True if a point is before some portal. Then sample_light() looks for the dome through portals.
KERNEL bool portal_faces(const DomeView& dome, vec3 p) {
  for (u32 i = 0; i < dome.portal_count; ++i) {
    if (dot(dome.portals[i].center - p, dome.portals[i].z) > 0) return true;
  }
  return false;
}

/// Light that comes to a point through all portals, up to a factor of the dome.
KERNEL double portal_light(const DomeView& dome, vec3 p) {
  double light = 0;
  for (u32 i = 0; i < dome.portal_count; ++i) {
    light += window_light(dome.portals[i], portal_window(dome.portals[i], p));
  }
  return light;
}

/// Density [1/sr] of a direction times portal_light().
HELIO_GPU_NOINLINE KERNEL double portal_density(const DomeView& dome, vec3 p, vec3 direction) {
  double density = 0;
  for (u32 i = 0; i < dome.portal_count; ++i) {
    const PortalView& portal = dome.portals[i];
    const vec3 d(dot(direction, portal.x), dot(direction, portal.y), dot(direction, portal.z));
    const vec3 from = p - portal.center;
    const float depth = -dot(from, portal.z);
    if (!(d.z > 0 && depth > 0)) continue;
    const vec2 at = vec2(dot(from, portal.x), dot(from, portal.y)) + vec2(d) * (depth / d.z);
    if (!(std::fabs(at.x) <= portal.half.x * kPortalSlack)) continue;
    if (!(std::fabs(at.y) <= portal.half.y * kPortalSlack)) continue;
    const vec2 place = portal_place(d) * float(kPortalSide);
    const u32 x = min2(u32(place.x), kPortalSide - 1), y = min2(u32(place.y), kPortalSide - 1);
    const double texel =
        portal_band(portal.sums, x + 1, y, y + 1.0) - portal_band(portal.sums, x, y, y + 1.0);
    density += texel * (double(kPortalSide) * kPortalSide) / portal_stretch(d);
  }
  return density;
}

/// Density [1/sr] with which sample_portals() takes a direction.
KERNEL float portal_pdf(const DomeView& dome, vec3 p, vec3 direction) {
  const double density = portal_density(dome, p, direction);
  if (!(density > 0)) return 0;  // most directions
  const double light = portal_light(dome, p);
  return light > 0 ? float(density / light) : 0;
}

/// The place in [low, high] where a function that is linear between whole numbers takes a value.
template <class F>
KERNEL float find_between(float low, float high, double value, const F& sum) {
  u32 first = min2(u32(low), kPortalSide - 1);
  u32 count = min2(u32(high), kPortalSide - 1) + 1 - first;
  while (count > 1) {  // in four at once: three sums that do not wait for each other
    const u32 step = (count + 3) / 4;
    u32 passed = 0;
    for (u32 i = 1; i < 4; ++i) passed += i * step < count && sum(first + i * step) <= value;
    first += passed * step;
    count = min2(step, count - passed * step);
  }
  const double before = sum(first), width = sum(first + 1) - before;
  const double rest = width > 0 ? (value - before) / width : 0;
  return min2(max2(float(first + rest), low), high);
}

/// A direction to the dome through some portal, by the light that comes there, and its density.
HELIO_GPU_NOINLINE KERNEL bool sample_portals(const DomeView& dome, vec3 p, vec2 u, vec3& direction,
                                              float& pdf) {
  double total = 0, light = 0, rest = double(u.x);
  PortalWindow w;
  u32 chosen = 0;
  for (u32 i = 0; i < dome.portal_count; ++i) {
    const PortalWindow window = portal_window(dome.portals[i], p);
    const double here = window_light(dome.portals[i], window);
    if (!(here > 0)) continue;
    total += here;
    const double share = here / total;
    const bool taken = rest < share;
    rest = taken ? rest / share : (rest - share) / (1 - share);
    if (!taken) continue;
    light = here;
    w = window;
    chosen = i;
  }
  if (!(total > 0)) return false;
  const PortalView& portal = dome.portals[chosen];
  const double start = portal_band(portal.sums, double(w.low.x), w.low.y, w.high.y);
  const auto columns = [&](u32 x) { return portal_band(portal.sums, x, w.low.y, w.high.y); };
  vec2 at;
  at.x = find_between(w.low.x, w.high.x, start + rest * light, columns);
  const u32 x = min2(u32(at.x), kPortalSide - 1);
  const auto rows = [&](double y) {
    return portal_sum(portal.sums, x + 1, y) - portal_sum(portal.sums, x, y);
  };
  const double low = rows(w.low.y);
  at.y = find_between(w.low.y, w.high.y, low + (rows(w.high.y) - low) * u.y, rows);
  const vec3 d = portal_direction(at / float(kPortalSide));
  direction = portal.x * d.x + portal.y * d.y + portal.z * d.z;
  pdf = float(portal_density(dome, p, direction) / total);
  return pdf > 0;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
