// Spans of time and their rows.
#include "renderer/frame/shutter.h"

namespace heliograph {
namespace {

/// Seconds by which a row is later than the one above.
double row_step(const Shutter& shutter, u32 height) {
  return height > 1 ? shutter.rolling / double(height - 1) : 0;
}

}  // namespace

TimeSpan shutter_span(const Shutter& shutter, Time time) {
  return {time + shutter.open, time + shutter.close + shutter.rolling};
}

TimeSpan label_span(const Shutter& shutter, Time time) { return {time, time + shutter.rolling}; }

kernels::ShutterView shutter_view(const Shutter& shutter, u32 height) {
  const double length = shutter.close - shutter.open, all = length + shutter.rolling;
  if (!(all > 0)) return {};
  return {0, float(length / all), float(row_step(shutter, height) / all)};
}

kernels::ShutterView label_view(const Shutter& shutter, u32 height) {
  if (!(shutter.rolling > 0)) return {};
  return {0, 0, float(row_step(shutter, height) / shutter.rolling)};
}

}  // namespace heliograph
