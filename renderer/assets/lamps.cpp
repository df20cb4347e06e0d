#include "renderer/assets/lamps.h"

#include <algorithm>
#include <cmath>

namespace heliograph::assets {
namespace {

constexpr float kRadius = 0.01f;  // metres

Camera camera_of(double aspect) {
  constexpr double kHeight = 1080, kWidest = 65536;
  Camera camera{.height = u32(kHeight)};
  camera.width = u32(std::clamp(std::round(kHeight * aspect), 1.0, kWidest));
  camera.cx = (camera.width - 1) / 2.0;
  camera.cy = (camera.height - 1) / 2.0;
  return camera;
}

}  // namespace

Light small_sphere() { return {.shape = LightShape::kSphere, .radius = kRadius}; }

void put_light(Builder& builder, LightPatch light, const std::string& name, const Place& place) {
  PutEntity put{.parent = builder.entity_ref(place.entity)};
  if (place.pose != mat4x3(1)) put.pose = constant_pose(place.pose);
  put.light = std::move(light);
  put.label = LabelPatch{.kind = LabelPatch::Kind::kValue, .value = 0, .category = {}};
  put.visibility = u8(kAllRays & ~kCameraRay & ~kShadowRay);
  builder.entity(name, std::move(put));
}

Camera perspective_camera(double yfov, double aspect) {
  Camera camera = camera_of(aspect);
  camera.fy = 0.5 * camera.height / std::tan(0.5 * yfov);
  camera.fx = 0.5 * camera.width / (aspect * std::tan(0.5 * yfov));
  return camera;
}

Camera orthographic_camera(double xmag, double ymag) {
  Camera camera = camera_of(xmag / ymag);
  camera.projection = Projection::kOrthographic;
  camera.fx = camera.width / (2 * xmag);
  camera.fy = camera.height / (2 * ymag);
  return camera;
}

}  // namespace heliograph::assets
