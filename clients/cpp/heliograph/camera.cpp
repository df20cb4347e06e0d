// Cameras from fields of view, focal lengths and calibrations.
#include "heliograph/camera.h"

#include <cmath>
#include <string>
#include <utility>

#include "heliograph/error.h"

namespace heliograph::client {
namespace {

constexpr double kPi = 3.14159265358979323846;

double positive(double value, const std::string& field) {
  if (value > 0 && std::isfinite(value)) return value;
  throw ClientError(Code::kInvalidArgument, field + ": is not above 0; give a number that is",
                    {field});
}

Camera make(Camera::Projection projection, double fx, double fy,
            std::array<std::uint32_t, 2> size) {
  Camera out;
  out.projection = projection;
  out.width = size[0];
  out.height = size[1];
  out.fx = fx;
  out.fy = fy;
  out.cx = 0.5 * size[0] - 0.5;
  out.cy = 0.5 * size[1] - 0.5;
  return out;
}

}  // namespace

Camera Camera::from_intrinsics(const Mat3& K, std::uint32_t width, std::uint32_t height) {
  if (K(0, 1) != 0 || K(1, 0) != 0 || K(2, 0) != 0 || K(2, 1) != 0 || K(2, 2) != 1)
    throw ClientError(Code::kInvalidArgument,
                      "K: has skew, which is not modelled; give [[fx, 0, cx], [0, fy, cy], "
                      "[0, 0, 1]]",
                      {"K"});
  Camera out = make(Projection::kPerspective, K(0, 0), K(1, 1), {width, height});
  out.cx = K(0, 2);
  out.cy = K(1, 2);
  return out;
}

Camera Camera::from_fov(double fov, std::uint32_t width, std::uint32_t height) {
  if (!(fov > 0 && fov < kPi))
    throw ClientError(Code::kInvalidArgument,
                      "fov: is not between 0 and pi; give radians, degrees(60) of degrees",
                      {"fov"});
  const double focal = 0.5 * width / std::tan(0.5 * fov);
  return make(Projection::kPerspective, focal, focal, {width, height});
}

Camera Camera::from_focal_length(double focal_length, std::uint32_t width, std::uint32_t height,
                                 double sensor_width) {
  const double pixels =
      positive(focal_length, "focal_length") / positive(sensor_width, "sensor_width") * width;
  return make(Projection::kPerspective, pixels, pixels, {width, height});
}

Camera Camera::orthographic(double pixels_per_metre, std::uint32_t width, std::uint32_t height) {
  const double scale = positive(pixels_per_metre, "pixels_per_metre");
  return make(Projection::kOrthographic, scale, scale, {width, height});
}

Camera Camera::fisheye(double fov, std::uint32_t width, std::uint32_t height) {
  const double scale = width / positive(fov, "fov");
  return make(Projection::kFisheye, scale, scale, {width, height});
}

Camera Camera::equirectangular(std::uint32_t width, std::uint32_t height) {
  return make(Projection::kEquirectangular, width / (2 * kPi), height / kPi, {width, height});
}

Camera Camera::from_rays(RayTable rays) {
  const Shape& shape = rays.rays.shape();
  if (shape.size() != 3 || shape[2] != 6)
    throw ClientError(Code::kInvalidArgument,
                      "rays: has shape " + to_string(shape) +
                          "; give (height, width, 6): origin and direction of each pixel",
                      {"rays"});
  Camera out =
      make(Projection::kRayTable, 0, 0, {std::uint32_t(shape[1]), std::uint32_t(shape[0])});
  out.rays = std::move(rays);
  return out;
}

Mat3 Camera::K() const {
  Mat3 out;
  out.rows = {{{fx, 0, cx}, {0, fy, cy}, {0, 0, 1}}};
  return out;
}

}  // namespace heliograph::client
