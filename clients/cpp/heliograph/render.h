// Options of Scene::render.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/frame.h"

namespace heliograph::client {

class Overlay;
namespace wire {
class Cancelling;
struct Draft;
}  // namespace wire

enum class PixelFilter : int { kBox = 1, kTent = 2, kGaussian = 3, kBlackmanHarris = 4 };

/// Label columns of a frame. docs/python.md lists the columns of each.
struct Labels {
  bool boxes = true;
  bool amodal = false;
  bool amodal_masks = false;
  bool keypoints = false;
  std::optional<float> canvas{};           // the image and this many times its size on each side; 1
  std::optional<float> keypoint_radius{};  // metres; 0.5 % of the mesh's diameter
  std::uint32_t max_rows = 0;              // 0: 65536
};

/// Progress of a job.
struct Progress {
  double done = 0;  // share of the work, [0, 1]
  double rays_per_second = 0;
  double eta_seconds = 0;
  double noise = 0;  // mean relative standard error; nan until known
};

/// Cancels renders from another thread: the ones that got a copy of it throw kCancelled, and the
/// daemon's device is free within 10 ms. The client stays usable. Thread: any.
class Cancellation {
 public:
  Cancellation();
  void cancel() const;
  [[nodiscard]] const std::shared_ptr<wire::Cancelling>& state() const { return state_; }

 private:
  std::shared_ptr<wire::Cancelling> state_;
};

/// Options of a render; options that are not set have the daemon's default. docs/python.md explains
/// each.
class RenderOptions {
 public:
  /// Names; "disparity:CAMERA" names its second camera, "beauty:GROUP" a light group. {"beauty"}.
  RenderOptions& planes(std::vector<std::string> v) { return set(&Fields::planes, std::move(v)); }
  /// Planes that come as half floats: frame.plane<Half>("depth"). Default: none.
  RenderOptions& half(std::vector<std::string> v) { return set(&Fields::half, std::move(v)); }
  /// Stop rule of averaged planes, any of the three: samples per pixel, seconds, relative noise.
  /// Without one, 64 samples.
  RenderOptions& spp(std::uint32_t v) { return set(&Fields::spp, v); }
  RenderOptions& seconds(double v) { return set(&Fields::seconds, v); }
  RenderOptions& noise(double v) { return set(&Fields::noise, v); }
  RenderOptions& adaptive(bool v) { return set(&Fields::adaptive, v); }
  RenderOptions& size(std::uint32_t width, std::uint32_t height) {
    fields_.width = width;
    return set(&Fields::height, height);
  }
  RenderOptions& seed(std::uint64_t v) { return set(&Fields::seed, v); }
  RenderOptions& time(double v) { return set(&Fields::time, v); }
  RenderOptions& label_time(double v) { return set(&Fields::label_time, v); }
  RenderOptions& frame_interval(double v) { return set(&Fields::frame_interval, v); }
  RenderOptions& hold(bool v) { return set(&Fields::hold, v); }
  /// Exactly this revision, or the latest that is at least that one.
  RenderOptions& revision(std::uint64_t v) { return set(&Fields::revision, v); }
  RenderOptions& min_revision(std::uint64_t v) { return set(&Fields::min_revision, v); }
  RenderOptions& overlay(const Overlay& v);
  RenderOptions& labels(const Labels& v) { return set(&Fields::labels, v); }
  RenderOptions& max_depth(std::uint32_t v) { return set(&Fields::max_depth, v); }
  RenderOptions& roulette(bool v) { return set(&Fields::roulette, v); }
  RenderOptions& roulette_depth(std::uint32_t v) { return set(&Fields::roulette_depth, v); }
  RenderOptions& clamp(double v) { return set(&Fields::clamp, v); }
  RenderOptions& clamp_indirect(double v) { return set(&Fields::clamp_indirect, v); }
  RenderOptions& regularize(bool v) { return set(&Fields::regularize, v); }
  RenderOptions& filter(PixelFilter v) { return set(&Fields::filter, v); }
  RenderOptions& transparent_background(bool v) { return set(&Fields::transparent_background, v); }
  RenderOptions& through_transmission(bool v) { return set(&Fields::through_transmission, v); }
  /// Vertex of the path that centre planes describe; 0, the first surface.
  RenderOptions& vertex(std::uint32_t v) { return set(&Fields::vertex, v); }
  /// Seconds, after which it is kDeadlineExceeded.
  RenderOptions& timeout(double v) { return set(&Fields::timeout, v); }
  RenderOptions& cancellation(const Cancellation& v) { return set(&Fields::cancellation, v); }
  /// Callbacks in the rendering thread: as the job goes on, and with a frame after each doubling of
  /// the samples. An exception of theirs cancels the job and passes through.
  RenderOptions& progress(std::function<void(const Progress&)> v) {
    fields_.progress = std::move(v);
    return *this;
  }
  RenderOptions& on_pass(std::function<void(const Frame&)> v) {
    fields_.on_pass = std::move(v);
    return *this;
  }

  struct Fields {
    std::vector<std::string> planes{"beauty"};
    std::vector<std::string> half{};
    std::optional<std::uint32_t> spp{};
    std::optional<double> seconds{};
    std::optional<double> noise{};
    bool adaptive = false;
    std::optional<std::uint32_t> width{};
    std::optional<std::uint32_t> height{};
    std::uint64_t seed = 0;
    std::optional<double> time{};
    std::optional<double> label_time{};
    std::optional<double> frame_interval{};
    bool hold = false;
    std::optional<std::uint64_t> revision{};
    std::optional<std::uint64_t> min_revision{};
    std::shared_ptr<const wire::Draft> overlay{};
    std::optional<Labels> labels{};
    std::optional<std::uint32_t> max_depth{};
    std::optional<bool> roulette{};
    std::optional<std::uint32_t> roulette_depth{};
    std::optional<double> clamp{};
    std::optional<double> clamp_indirect{};
    bool regularize = false;
    std::optional<PixelFilter> filter{};
    bool transparent_background = false;
    bool through_transmission = false;
    std::uint32_t vertex = 0;
    std::optional<double> timeout{};
    std::optional<Cancellation> cancellation{};
    std::function<void(const Progress&)> progress{};
    std::function<void(const Frame&)> on_pass{};
  };
  [[nodiscard]] const Fields& fields() const { return fields_; }

 private:
  template <class T, class V>
  RenderOptions& set(T Fields::* field, V&& value) {
    fields_.*field = std::forward<V>(value);
    return *this;
  }

  Fields fields_;
};

}  // namespace heliograph::client
