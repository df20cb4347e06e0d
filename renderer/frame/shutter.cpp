// Spans of time and their rows.
#include "renderer/frame/shutter.h"

namespace heliograph {
namespace {

/// How much later than the first pixel others are seen, on an axis of `all` seconds.
kernels::ShutterView later(const Camera& camera, u32 height, double all) {
  if (camera.rays) return {.open = 0, .length = 0, .row = 0, .seconds = float(1 / all)};
  const double step = height > 1 ? camera.shutter.rolling / double(height - 1) : 0;
  return {.open = 0, .length = 0, .row = float(step / all), .seconds = 0};
}

}  // namespace

TimeSpan shutter_span(const Shutter& shutter, Time time) {
  return {time + shutter.open, time + shutter.close + shutter.rolling};
}

TimeSpan label_span(const Shutter& shutter, Time time) { return {time, time + shutter.rolling}; }

kernels::ShutterView shutter_view(const Camera& camera, u32 height) {
  const Shutter& shutter = camera.shutter;
  const double length = shutter.close - shutter.open, all = length + shutter.rolling;
  if (!(all > 0)) return {};
  kernels::ShutterView view = later(camera, height, all);
  view.length = float(length / all);
  return view;
}

kernels::ShutterView label_view(const Camera& camera, u32 height) {
  return camera.shutter.rolling > 0 ? later(camera, height, camera.shutter.rolling)
                                    : kernels::ShutterView{};
}

}  // namespace heliograph
