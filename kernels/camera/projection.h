// The kinds of cameras: where each sees a point, along what it looks, and what else sets them
// apart. In f32 for rays, in f64 for labels. Called by camera.h and
// renderer/frame/image_camera.cpp.
//
// A kind is a type with
//   kStraight    straight lines are seen straight unless the lens distorts them; depth and clipping
//                count along the optical axis, of other kinds along the ray
//   kParallel    its rays are parallel
//   kWraps       the image joins itself at its sides
//   kDistortion  the coefficients that it may be given, for messages; "": it takes none
//   takes()      whether it may be given so many
//   limit()      how far from the axis the lens can be inverted: LensModel::limit
//   project()    where on the normalised image plane a point is seen; false: nowhere
//   unproject()  the point on the optical axis' plane z = 1, or for lenses wider than that the unit
//                direction, that is seen at m; for parallel rays where the ray starts. false:
//                nothing is seen there
// Points and directions are in the OpenCV camera frame (x right, y down, z forward). The image
// plane is normalised: raster = focal length * m + principal point.
#pragma once

#include "kernels/camera/distortion.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The common part of lenses without coefficients.
struct UndistortedLens {
  static constexpr const char* kDistortion = "";
  static constexpr bool takes(u32) { return false; }

  template <class F>
  KERNEL static F limit(const LensModel<F>&) {
    return INFINITY;
  }
};

struct PerspectiveLens {
  static constexpr bool kStraight = true, kParallel = false, kWraps = false;
  static constexpr const char* kDistortion =
      "k1 k2 p1 p2, with k3, or with k3 k4 k5 k6 (thin prisms and tilted sensors are not modelled)";
  static constexpr bool takes(u32 coefficients) {
    return coefficients == 4 || coefficients == 5 || coefficients == 8;
  }

  template <class F>
  KERNEL static F limit(const LensModel<F>& lens) {
    return lens.distorted ? brown_conrady_limit(lens.k) : INFINITY;
  }
  template <class F>
  KERNEL static bool project(const LensModel<F>& lens, Vec3<F> p, Vec2<F>& m) {
    m = Vec2<F>(p.x, p.y) / p.z;
    if (lens.distorted) {
      if (!(std::sqrt(p.x * p.x + p.y * p.y) < lens.limit * p.z)) return false;
      m = distort(lens.k, m).m;
    }
    return p.z > 0;
  }
  template <class F>
  KERNEL static bool unproject(const LensModel<F>& lens, Vec2<F> m, Vec3<F>& d) {
    Vec2<F> p = m;
    const bool seen = !lens.distorted || undistort(lens.k, lens.limit, m, p);
    d = Vec3<F>(p, 1);
    return seen;
  }
};

struct OrthographicLens : UndistortedLens {
  static constexpr bool kStraight = true, kParallel = true, kWraps = false;

  template <class F>
  KERNEL static bool project(const LensModel<F>&, Vec3<F> p, Vec2<F>& m) {
    m = Vec2<F>(p.x, p.y);
    return p.z > 0;
  }
  template <class F>
  KERNEL static bool unproject(const LensModel<F>&, Vec2<F> m, Vec3<F>& d) {
    d = Vec3<F>(m, 0);
    return true;
  }
};

struct FisheyeLens {
  static constexpr bool kStraight = false, kParallel = false, kWraps = false;
  static constexpr const char* kDistortion = "k1 k2 k3 k4";
  static constexpr bool takes(u32 coefficients) { return coefficients == 4; }

  template <class F>
  KERNEL static F limit(const LensModel<F>& lens) {
    return fisheye_limit(lens.k);
  }
  template <class F>
  KERNEL static bool project(const LensModel<F>& lens, Vec3<F> p, Vec2<F>& m) {
    const F r = std::sqrt(p.x * p.x + p.y * p.y);
    const F angle = angle_of(r, p.z);
    m = r > 0 ? Vec2<F>(p.x, p.y) * (fisheye_radius(lens.k, angle).value / r) : Vec2<F>(0);
    return angle < lens.limit && (r > 0 || p.z > 0);
  }
  template <class F>
  KERNEL static bool unproject(const LensModel<F>& lens, Vec2<F> m, Vec3<F>& d) {
    const F radius = std::sqrt(m.x * m.x + m.y * m.y);
    d = Vec3<F>(0, 0, 1);
    if (!(radius > 0)) return true;
    if (!(radius < fisheye_radius(lens.k, lens.limit).value)) return false;
    const Vec2<F> angle = cos_sin(
        solve_increasing(radius, lens.limit, [&](F x) { return fisheye_radius(lens.k, x); }));
    d = Vec3<F>(m * (angle.y / radius), angle.x);
    return true;
  }
};

/// Longitude along x, latitude along y.
struct EquirectangularLens : UndistortedLens {
  static constexpr bool kStraight = false, kParallel = false, kWraps = true;

  template <class F>
  KERNEL static bool project(const LensModel<F>&, Vec3<F> p, Vec2<F>& m) {
    m = Vec2<F>(angle_of(p.x, p.z), angle_of(p.y, std::sqrt(p.x * p.x + p.z * p.z)));
    return p.x != 0 || p.y != 0 || p.z != 0;
  }
  template <class F>
  KERNEL static bool unproject(const LensModel<F>&, Vec2<F> m, Vec3<F>& d) {
    constexpr F kHalfTurn = F(3.14159265358979323846);
    const Vec2<F> longitude = cos_sin(m.x), latitude = cos_sin(m.y);
    d = Vec3<F>(latitude.x * longitude.y, latitude.y, latitude.x * longitude.x);
    return std::fabs(m.x) <= kHalfTurn && std::fabs(m.y) <= F(0.5) * kHalfTurn;
  }
};

/// A ray of its own for each pixel (ray_table.h): no formula gives where it sees a point.
struct RayTableLens : UndistortedLens {
  static constexpr bool kStraight = false, kParallel = false, kWraps = false;

  template <class F>
  KERNEL static bool project(const LensModel<F>&, Vec3<F>, Vec2<F>& m) {
    m = Vec2<F>(0);
    return false;
  }
  template <class F>
  KERNEL static bool unproject(const LensModel<F>&, Vec2<F>, Vec3<F>& d) {
    d = Vec3<F>(0, 0, 1);
    return false;
  }
};

/// f(kind) of a projection.
template <class F>
KERNEL auto with_kind(Projection projection, const F& f) {
  switch (projection) {
#define HELIO_PROJECTION(Name) \
  case Projection::k##Name:    \
    return f(Name##Lens{});
    HELIO_PROJECTIONS(HELIO_PROJECTION)
#undef HELIO_PROJECTION
  }
  return f(PerspectiveLens{});
}

KERNEL bool is_straight(Projection projection) {
  return with_kind(projection, [](auto kind) { return kind.kStraight; });
}
KERNEL bool is_parallel(Projection projection) {
  return with_kind(projection, [](auto kind) { return kind.kParallel; });
}
KERNEL bool wraps(Projection projection) {
  return with_kind(projection, [](auto kind) { return kind.kWraps; });
}

/// Straight lines are seen straight.
template <class F>
KERNEL bool is_rectilinear(const LensModel<F>& lens) {
  return !lens.distorted && is_straight(lens.projection);
}

template <class F>
KERNEL F lens_limit(const LensModel<F>& lens) {
  return with_kind(lens.projection, [&](auto kind) { return F(kind.limit(lens)); });
}
template <class F>
HELIO_GPU_NOINLINE KERNEL bool project(const LensModel<F>& lens, Vec3<F> p, Vec2<F>& m) {
  return with_kind(lens.projection, [&](auto kind) { return kind.project(lens, p, m); });
}
template <class F>
HELIO_GPU_NOINLINE KERNEL bool unproject(const LensModel<F>& lens, Vec2<F> m, Vec3<F>& d) {
  return with_kind(lens.projection, [&](auto kind) { return kind.unproject(lens, m, d); });
}

}  // namespace heliograph::kernels::inline HELIO_ISA
