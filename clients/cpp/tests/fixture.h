// A private daemon for the tests of one program, and scenes in it.
#pragma once

#include <heliograph/heliograph.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <vector>

#include "tests/unit/catch.h"

namespace heliograph::client {

/// The daemon that all tests of this program share; $HELIOGRAPHD names it.
inline Client& client() {
  static Client shared = launch();
  return shared;
}

/// A ball in front of a camera, under a grey dome.
struct Ball {
  Scene scene = client().create_scene();
  Mesh mesh;
  Material material;
  Entity ball;
  Entity camera;

  explicit Ball(std::uint32_t width = 64, std::uint32_t height = 48) {
    Transaction edit = scene.edit();
    Dome dome;
    dome.color = 1;
    edit.dome(dome);
    mesh = edit.mesh("ball/mesh", shapes::sphere(0.5, 16));
    material = edit.material("paint", Parameters().base_color({0.8, 0.2, 0.1}));
    ball = edit.entity("ball", Components().mesh(mesh).material(material).category("ball"));
    camera = edit.entity("camera", Components()
                                       .camera(Camera::from_fov(degrees(50), width, height))
                                       .transform(look_at({0, -3, 0}, {0, 0, 0})));
    edit.commit();
  }
};

inline bool contains(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}
inline bool contains(const std::vector<std::string>& list, const std::string& item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

/// The error that `call` throws; none is a failure.
template <class Call>
ClientError error_of(const Call& call) {
  try {
    call();
  } catch (const ClientError& error) {
    return error;
  }
  FAIL("nothing was refused");
  throw std::logic_error("unreachable");
}

}  // namespace heliograph::client
