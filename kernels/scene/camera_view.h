// The plain data a device sees of a camera. Filled by a backend, read by every kernel.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels {

/// Where something is at one of the equidistant times that it has keys at: world = translate *
/// rotate * shear. Between two keys translation and shear go linearly, the rotation by slerp.
struct MotionKey {
  vec3 translation;
  vec4 rotation;                 // unit quaternion, xyzw
  float xx, xy, xz, yy, yz, zz;  // upper triangle of the shear, whose diagonal is the scale
};

/// The kinds of cameras; camera/projection.h has a type for each.
#define HELIO_PROJECTIONS(KIND) \
  KIND(Perspective) KIND(Orthographic) KIND(Fisheye) KIND(Equirectangular) KIND(RayTable)

enum class Projection : u8 {
#define HELIO_PROJECTION(Name) k##Name,
  HELIO_PROJECTIONS(HELIO_PROJECTION)
#undef HELIO_PROJECTION
};

/// How directions become places in the image. Perspective: k1 k2 p1 p2 k3 k4 k5 k6 of Brown and
/// Conrady; fisheye: k1 k2 k3 k4 of Kannala and Brandt.
template <class F>
struct LensModel {
  Projection projection;
  bool distorted;  // perspective: some coefficient is not 0
  F k[8];
  F limit;  // beyond it nothing is seen. Perspective: radius at z = 1; fisheye: radians off the
            // axis
};

/// The opening of a thin lens, and the plane that it sees sharply.
struct ApertureView {
  float radius;  // metres; 0: a pinhole
  float focus;   // metres along the optical axis
  u32 blades;    // 0: round; otherwise corners, which lie on the circle
  float turn;    // of the first corner from the camera's +X towards its +Y, whole turns
};

/// When a camera sees, on the scene's time axis: 0 is the start and 1 the end of its motion.
struct ShutterView {
  float open;     // of row 0, or of a ray table's time 0
  float length;   // how long each row is open
  float row;      // how much later than the row above a row opens
  float seconds;  // of a ray table's times: how much later a pixel opens per second
};

/// The ray of a pixel, in the OpenCV camera frame (x right, y down, z forward).
struct TableRay {
  vec3 origin;     // metres
  vec3 direction;  // of any length; 0: the pixel sees nothing
};

/// Rays that a camera sees along, pixel by pixel, row-major.
struct RayTableView {
  const TableRay* rays;  // null: the camera is of another kind
  const float* times;    // seconds; null: all 0
  bool interpolated;     // between the centres of pixels
  float width, spread;   // Cone of a pixel: the distance and the angle between neighbours
};

/// raster = (fx, fy) * (place on the lens model's image plane) + (cx, cy): cx, cy are raster
/// coordinates here.
struct CameraView {
  mat4x3 world_from_camera;  // OpenGL frame: looks down -Z
  mat4x3 camera_from_world;
  const MotionKey* motion_keys;  // segments + 1; camera_at() has the poses
  u32 segments;                  // 0: it does not move
  float time;                    // of its rays, where it does not move
  ShutterView shutter;
  float fx, fy, cx, cy;
  u32 width;
  u32 height;
  LensModel<float> lens;
  RayTableView table;
  ApertureView aperture;
  // Metres along the optical axis, or along the ray where is_straight() does not hold, where rays
  // start and end. far 0: they do not end.
  float near, far;
};

static_assert(std::is_trivially_copyable_v<CameraView>);

}  // namespace heliograph::kernels
