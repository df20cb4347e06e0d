// Report of a real camera in place of the exact image: the planes sensor_rgb, sensor_mosaic
// and sensor_depth. Called by post.cpp.
#pragma once

#include "renderer/frame/image_camera.h"
#include "renderer/frame/interrupt.h"

namespace heliograph {

/// Context of a sensor: the camera, its image's random numbers, and when to stop.
struct SensorContext {
  const ImageCamera& camera;
  u64 seed;
  const Interrupt& interrupt;
};

/// Planes of the frame, row-major.
struct RgbImage {
  const float* beauty;  // 4 a pixel
};
struct DepthImage {
  const float* depth;
  const float* distance;
  const float* normal_camera;  // 3 a pixel
  const float* base_color;     // 3 a pixel
  const float* roughness;
  const float* metallic;
  const float* transmission;
};

/// Signal of a linear sensor, 3 a pixel in [0, 1], 1 at saturation: lens shading, exposure, photon
/// and read noise, black level, quantisation.
///
/// Source: EMVA Standard 1288, release 4.0 (2021), section 2; Foi et al. 2008, "Practical
/// Poissonian-Gaussian Noise Modeling and Fitting for Single-Image Raw-Data". Lens shading: the
/// cosine fourth law, Reiss 1945.
///
/// A sensor with a pattern gives its mosaic, demosaiced: Malvar, He and Cutler 2004, "High-Quality
/// Linear Interpolation for Demosaicing of Bayer-Patterned Color Images", figure 2; clipped, but
/// not quantised once more.
[[nodiscard]] Status sense_rgb(const RgbSensor& sensor, const RgbImage& image,
                               const SensorContext& context, float* out);

/// The same where each pixel is a photosite of one colour: one value a pixel. The sensor has a
/// pattern.
[[nodiscard]] Status sense_mosaic(const RgbSensor& sensor, const RgbImage& image,
                                  const SensorContext& context, float* out);

/// Metres as a depth camera measures them: along the optical axis, of fisheye and equirectangular
/// cameras along the ray; 0 where it has no measurement.
[[nodiscard]] Status sense_depth(const DepthSensor& sensor, const DepthImage& image,
                                 const SensorContext& context, float* out);

}  // namespace heliograph
