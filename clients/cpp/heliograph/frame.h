// Frame: the planes and labels of one camera at one time. Made by Scene::render.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/array.h"
#include "heliograph/pose.h"

namespace heliograph::client {

/// Output image. docs/planes.md lists all planes with their units and frames.
struct Plane {
  std::string name;  // "depth"; "disparity:right", "beauty:key" with their argument
  std::string unit;  // "m"
  Array pixels;      // (H, W) or (H, W, C)
};

/// Description of a frame besides its pixels.
struct FrameInfo {
  std::uint64_t scene = 0;
  std::uint64_t revision = 0;
  std::string camera;
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  double time = 0;        // seconds
  double label_time = 0;  // seconds, of labels and planes of fold `centre`
  double shutter_open =
      0;  // seconds relative to time; row y of H is seen rolling * y / (H - 1) later
  double shutter_close = 0;
  double rolling = 0;
  std::uint64_t seed = 0;
  std::uint32_t samples = 0;
  double noise = 0;  // mean relative standard error that was reached; nan: not measured
  bool is_final = true;
  std::string backend;
  std::string cpu_features;
  double render_seconds = 0;
  std::uint64_t rays = 0;
  std::string manifest;  // JSON that Scene::rerender makes the same bytes of
  std::vector<std::string> warnings{};
  std::map<std::uint32_t, std::string> categories{};  // class id to name
  Mat3 K{};                                           // at the rendered size
  Mat4 camera_from_world_cv{};                        // OpenCV camera: x right, y down, z forward
};

/// Planes and labels of one camera at one revision and one time, from one job. Immutable; copies
/// share the pixels, which stay valid as long as a frame, an array or a view of them does. Thread:
/// any.
class Frame {
 public:
  Frame() = default;
  Frame(FrameInfo info, std::vector<Plane> planes, Columns labels);

  [[nodiscard]] const FrameInfo& info() const { return data_->info; }
  [[nodiscard]] std::uint32_t width() const { return data_->info.width; }
  [[nodiscard]] std::uint32_t height() const { return data_->info.height; }
  [[nodiscard]] std::uint64_t revision() const { return data_->info.revision; }

  [[nodiscard]] const std::vector<Plane>& planes() const { return data_->planes; }
  [[nodiscard]] bool contains(const std::string& plane) const;
  /// kNotFound lists the planes that there are. "disparity" without its camera, where there is one.
  [[nodiscard]] const Array& operator[](const std::string& plane) const;
  /// frame.plane<float>("depth")(row, column); frame.plane<std::array<float, 3>>("normal")(y,
  /// x)[2].
  template <class T>
  [[nodiscard]] View<T> plane(const std::string& name) const {
    return (*this)[name].template view<T>();
  }

  /// Columns over the instances, ordered by label; docs/python.md lists them.
  [[nodiscard]] const Columns& labels() const { return data_->labels; }
  /// Label to name. Needs labels.
  [[nodiscard]] std::map<std::uint32_t, std::string> instances() const;
  /// (H, W) u8, 1 on the whole silhouette of an instance, also where it is hidden. Needs
  /// amodal_masks.
  [[nodiscard]] Array amodal_mask(std::uint32_t label) const;

  /// (H, W, 3) u8, the beauty as a picture: sRGB (IEC 61966-2-1), after 2^exposure.
  [[nodiscard]] Array image(double exposure = 0) const;
  /// Writes image() as a binary PPM file.
  void save(const std::string& path, double exposure = 0) const;

 private:
  struct Data {
    FrameInfo info;
    std::vector<Plane> planes;
    Columns labels;
  };
  std::shared_ptr<const Data> data_ = std::make_shared<const Data>();
};

}  // namespace heliograph::client
