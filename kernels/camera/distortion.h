// Models of distortion, Brown and Conrady's and Kannala and Brandt's, and their inverses; in f32
// for rays, in f64 for labels. Called by projection.h.
#pragma once

#include "kernels/core/math.h"
#include "kernels/scene/scene_view.h"

namespace heliograph::kernels::inline HELIO_ISA {

template <class F>
using Vec2 = glm::vec<2, F>;
template <class F>
using Vec3 = glm::vec<3, F>;

KERNEL float angle_of(float y, float x) { return 2 * kPi * atan2_turns(y, x); }
KERNEL double angle_of(double y, double x) { return std::atan2(y, x); }
KERNEL vec2 cos_sin(float angle) {
  const SinCos turn = sincos_turns(angle * (0.5f * kInvPi));
  return vec2(turn.cos, turn.sin);
}
KERNEL Vec2<double> cos_sin(double angle) { return {std::cos(angle), std::sin(angle)}; }

/// A function of one number and its derivative.
template <class F>
struct Slope {
  F value, slope;
};

/// The x in [0, high] where an increasing function is `target`, to a relative step of 4 rounding
/// errors: Newton's steps, halving the bracket where they leave it. The caller has checked that it
/// lies there.
///
/// Source: Press et al. 2007, "Numerical Recipes", section 9.4 (rtsafe).
template <class F, class Function>
KERNEL F solve_increasing(F target, F high, const Function& f) {
  constexpr F kStep = sizeof(F) == 4 ? F(4.8e-7) : F(9e-16);
  F low = 0;
  F x = min2(target, F(0.5) * high);
  for (u32 i = 0; i < 64; ++i) {
    const Slope<F> at = f(x);
    const F missing = target - at.value;
    (missing > 0 ? low : high) = x;
    F next = x + missing / at.slope;
    if (!(next > low && next < high)) next = F(0.5) * (low + high);
    const F step = next - x;
    x = next;
    if (step * step <= kStep * kStep * x * x) break;
  }
  return x;
}

// ---------------------------------------------------------------- Brown-Conrady

/// The radial factor R(r^2) = (1 + k1 r^2 + k2 r^4 + k3 r^6) / (1 + k4 r^2 + k5 r^4 + k6 r^6) and
/// its derivative by r^2. k: k1 k2 p1 p2 k3 k4 k5 k6.
///
/// Source: Brown 1966, "Decentering Distortion of Lenses"; OpenCV's calib3d, whose order this is.
template <class F>
KERNEL Slope<F> radial_factor(const F (&k)[8], F r2) {
  const F up = 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
  const F up_slope = k[0] + r2 * (2 * k[1] + r2 * 3 * k[4]);
  const F down = 1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7]));
  const F down_slope = k[5] + r2 * (2 * k[6] + r2 * 3 * k[7]);
  return {up / down, (up_slope - up / down * down_slope) / down};
}

/// A distorted point and the symmetric matrix of its derivatives: d/dx (xx, xy), d/dy (xy, yy).
template <class F>
struct Distorted {
  Vec2<F> m;
  F xx, xy, yy;
};
template <class F>
KERNEL Distorted<F> distort(const F (&k)[8], Vec2<F> p) {
  const F p1 = k[2], p2 = k[3];
  const F r2 = p.x * p.x + p.y * p.y;
  const Slope<F> radial = radial_factor(k, r2);
  const F a = radial.value + 2 * (p1 * p.y + p2 * p.x);
  return {Vec2<F>(p.x * a + p2 * r2, p.y * a + p1 * r2),
          radial.value + 2 * p.x * p.x * radial.slope + 2 * p1 * p.y + 6 * p2 * p.x,
          2 * p.x * p.y * radial.slope + 2 * (p1 * p.x + p2 * p.y),
          radial.value + 2 * p.y * p.y * radial.slope + 6 * p1 * p.y + 2 * p2 * p.x};
}

/// The smallest determinant of those derivatives on the circle of radius r, negative where the
/// radial factor is. On that circle it is a quadratic in the cosine c to the direction of (p2, p1):
/// 4 s^2 c^2 + s (g + 3 R) c + g R - s^2, with s = 2 r |(p1, p2)| and g = d(r R)/dr.
template <class F>
KERNEL F least_determinant(const F (&k)[8], F r) {
  const Slope<F> radial = radial_factor(k, r * r);
  if (!(radial.value > 0) || !(1 + r * r * (k[5] + r * r * (k[6] + r * r * k[7])) > 0)) return -1;
  const F g = radial.value + 2 * r * r * radial.slope;
  const F s = 2 * r * std::sqrt(k[2] * k[2] + k[3] * k[3]);
  const F linear = s * (g + 3 * radial.value);
  const F c = s > 0 ? max2(F(-1), -linear / (8 * s * s)) : 0;
  return 4 * s * s * c * c + linear * c + g * radial.value - s * s;
}

/// The largest radius within which distort() is invertible. Its derivatives are a symmetric matrix,
/// the identity in the middle: where no determinant on the way is 0 it is positive definite, so
/// that distort() is the gradient of a strictly convex function and meets no value twice.
template <class F>
KERNEL F brown_conrady_limit(const F (&k)[8]) {
  constexpr u32 kSteps = 2048;
  constexpr F kWidest = F(1.5690);  // radians: 0.1 degrees short of the camera's plane
  F low = 0;
  for (u32 i = 1; i <= kSteps; ++i) {
    F high = std::tan(kWidest * F(i) / F(kSteps));
    if (least_determinant(k, high) > 0) {
      low = high;
      continue;
    }
    for (u32 halving = 0; halving < 40; ++halving) {
      const F middle = F(0.5) * (low + high);
      (least_determinant(k, middle) > 0 ? low : high) = middle;
    }
    break;
  }
  return low;
}

/// The point within `limit` that distort() takes to m, to 4e-6 (1 + |m|) in f32; false: there is
/// none. First the radial part alone, then Newton's method on the whole.
template <class F>
KERNEL bool undistort(const F (&k)[8], F limit, Vec2<F> m, Vec2<F>& p) {
  constexpr F kError = sizeof(F) == 4 ? F(4e-6) : F(1e-13);
  const F target = std::sqrt(m.x * m.x + m.y * m.y);
  p = m;
  if (!(target > 0)) {
    p = Vec2<F>(0);
  } else if (limit * radial_factor(k, limit * limit).value > target) {
    const F r = solve_increasing(target, limit, [&](F x) {
      const Slope<F> radial = radial_factor(k, x * x);
      return Slope<F>{x * radial.value, radial.value + 2 * x * x * radial.slope};
    });
    p = m * (r / target);
  } else if (k[2] == 0 && k[3] == 0) {
    return false;
  } else {
    p = m * (F(0.99) * limit / target);
  }
  if (k[2] != 0 || k[3] != 0) {
    for (u32 i = 0; i < 16; ++i) {
      const Distorted<F> at = distort(k, p);
      const Vec2<F> missing = m - at.m;
      const F determinant = at.xx * at.yy - at.xy * at.xy;
      const Vec2<F> step =
          Vec2<F>(at.yy * missing.x - at.xy * missing.y, at.xx * missing.y - at.xy * missing.x) /
          determinant;
      p += step;
      const F r2 = p.x * p.x + p.y * p.y;
      if (r2 > limit * limit) p *= limit / std::sqrt(r2);
      if (step.x * step.x + step.y * step.y <= kError * kError * F(0.01) * r2) break;
    }
  }
  const Vec2<F> miss = distort(k, p).m - m;
  const F allowed = kError * (1 + target);
  return miss.x * miss.x + miss.y * miss.y <= allowed * allowed &&
         p.x * p.x + p.y * p.y < limit * limit;
}

// ---------------------------------------------------------------- Kannala-Brandt

/// Distance from the middle of the image of a ray at an angle to the optical axis: a (1 + k1 a^2 +
/// k2 a^4 + k3 a^6 + k4 a^8).
///
/// Source: Kannala and Brandt 2006, "A Generic Camera Model and Calibration Method", equation 6;
/// OpenCV's fisheye.
template <class F>
KERNEL Slope<F> fisheye_radius(const F (&k)[8], F a) {
  const F a2 = a * a;
  return {a * (1 + a2 * (k[0] + a2 * (k[1] + a2 * (k[2] + a2 * k[3])))),
          1 + a2 * (3 * k[0] + a2 * (5 * k[1] + a2 * (7 * k[2] + a2 * 9 * k[3])))};
}

/// The largest angle up to which that radius grows, radians, at most pi.
template <class F>
KERNEL F fisheye_limit(const F (&k)[8]) {
  constexpr u32 kSteps = 2048;
  F low = 0;
  for (u32 i = 1; i <= kSteps; ++i) {
    F high = F(3.14159265358979323846) * F(i) / F(kSteps);
    if (fisheye_radius(k, high).slope > 0) {
      low = high;
      continue;
    }
    for (u32 halving = 0; halving < 40; ++halving) {
      const F middle = F(0.5) * (low + high);
      (fisheye_radius(k, middle).slope > 0 ? low : high) = middle;
    }
    break;
  }
  return low;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
