// Cameras and their sensors: plain values that entities carry. docs/cameras.md, docs/motion.md.
#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <optional>
#include <vector>

#include "heliograph/array.h"

namespace heliograph::client {

/// A linear colour sensor, for the planes sensor_rgb and sensor_mosaic; a signal of 1 fills its
/// wells.
struct RgbSensor {
  enum class Pattern : int { kNone = 1, kRggb = 2, kBggr = 3, kGrbg = 4, kGbrg = 5 };

  double exposure = 0;               // stops: signal = radiance * 2^exposure
  double full_well = 0;              // electrons at a signal of 1, which make photon noise; 0: none
  double read_noise = 0;             // electrons, standard deviation; needs full_well
  double black_level = 0;            // share of the output's range that black reads
  std::uint32_t bits = 0;            // of the output; 0: not quantised
  double vignetting = 0;             // [0, 1], share of the cosine fourth law
  Pattern pattern = Pattern::kNone;  // colours of the photosites from the upper left corner on
};

/// A depth camera, for the plane sensor_depth; what it cannot measure reads 0.
struct DepthSensor {
  enum class Kind : int { kActiveStereo = 1, kTimeOfFlight = 2 };

  Kind kind = Kind::kActiveStereo;
  // Active stereo alone: a projector at +x of a perspective camera without distortion.
  double baseline = 0;         // metres to the projector
  double disparity_noise = 0;  // pixels, standard deviation
  double disparity_step = 0;   // pixels; 0: not quantised
  double lateral_noise = 0;    // pixels, standard deviation
  // Time of flight alone.
  double range_noise = 0;  // metres, standard deviation at a signal of 1
  // Both. A white matt surface at 1 m that faces the camera has a signal of 1.
  std::uint32_t window = 1;               // pixels, odd, that are matched together or mixed
  double min_signal = 0;                  // less reads 0
  double max_angle = 1.5707963267948966;  // radians between ray and normal; more reads 0
  double min_depth = 0;                   // metres
  double max_depth = 0;                   // metres; 0: none
};

/// Rays of a camera, pixel by pixel: of a scanner, or of a lens that no model describes.
struct RayTable {
  Array rays;  // (H, W, 6) f32: origin, metres, and direction, zeros where a pixel sees nothing; in
               // the OpenCV camera frame
  Array times;  // (H, W) f32 seconds in [0, 1000] after the shutter's opening; empty: all 0
  bool interpolated = false;  // samples spread over a pixel, along rays between its neighbours'
};

/// OpenCV intrinsics at the calibrated size, lens, clipping. The camera looks down its -Z axis, +Y
/// is up in the image; integers of cx and cy are pixel centres.
struct Camera {
  enum class Projection : int {
    kPerspective = 1,
    kOrthographic = 2,     // fx, fy: pixels a metre
    kFisheye = 3,          // Kannala and Brandt 2006, as OpenCV's
    kEquirectangular = 4,  // fx, fy: pixels a radian
    kRayTable = 5          // `rays` in place of fx, fy, cx and cy
  };

  std::uint32_t width = 0;  // pixels
  std::uint32_t height = 0;
  double fx = 0;  // pixels
  double fy = 0;
  double cx = 0;
  double cy = 0;
  Projection projection = Projection::kPerspective;
  // OpenCV's: k1 k2 p1 p2 [k3 [k4 k5 k6]] of a perspective camera, k1 k2 k3 k4 of a fisheye.
  std::vector<double> distortion{};
  double aperture = 0;        // metres, diameter of a thin lens; 0: a pinhole
  double focus_distance = 0;  // metres along the optical axis; needed with an aperture
  std::uint32_t blades = 0;   // corners of the aperture; 0: round
  double blade_rotation = 0;  // radians, of a corner from +X towards +Y
  double near = 0;            // metres along the optical axis, where rays start, and
  double far = std::numeric_limits<double>::infinity();  // where they end
  // Seconds relative to the frame's time: opening and closing of the first row; both 0: no motion
  // blur. rolling: from the first row's opening to the last one's.
  std::array<double, 2> shutter{0, 0};
  double rolling = 0;
  std::optional<RgbSensor> rgb_sensor{};
  std::optional<DepthSensor> depth_sensor{};
  std::optional<RayTable> rays{};

  /// K of OpenCV: [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]; skew is kInvalidArgument.
  static Camera from_intrinsics(const Mat3& K, std::uint32_t width, std::uint32_t height);
  /// The full angle of view along the image's width, radians.
  static Camera from_fov(double fov, std::uint32_t width, std::uint32_t height);
  /// As photographers name a lens: millimetres of the focal length and of the sensor's width.
  static Camera from_focal_length(double focal_length, std::uint32_t width, std::uint32_t height,
                                  double sensor_width = 36);
  /// Parallel rays; one metre is that many pixels at any distance.
  static Camera orthographic(double pixels_per_metre, std::uint32_t width, std::uint32_t height);
  /// An equidistant lens, `distortion` aside: radians along the width, up to 2 pi.
  static Camera fisheye(double fov, std::uint32_t width, std::uint32_t height);
  /// Longitude along x, latitude along y, all around; what lies ahead is in the middle.
  static Camera equirectangular(std::uint32_t width, std::uint32_t height);

  /// Such a camera is rendered at its own size and does not know where it sees a point: flow in
  /// pixels, disparity, tracks, and keypoints where a mesh has some, are kUnimplemented. Rays of
  /// another shape are kInvalidArgument.
  static Camera from_rays(RayTable rays);

  [[nodiscard]] Mat3 K() const;
};

/// Radians of degrees.
constexpr double degrees(double angle) { return angle * (3.14159265358979323846 / 180.0); }

}  // namespace heliograph::client
