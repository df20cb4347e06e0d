#include "renderer/schedule/preparer.h"

#include "renderer/base/guard.h"

namespace heliograph {
namespace {

constexpr double kQuick = 1e-3;  // seconds that a device may wait: a tenth of a slice

double seconds_of(const Preparation& needed) {
  double sum = needed.seconds;
  for (const Errand& piece : needed.pieces) sum += piece.seconds;
  return sum;
}

}  // namespace

/// First the pieces that others may want, too, then all else. What is quick in all is left to
/// take(): on busy cores it would wait longer for a worker than it takes.
std::vector<Errand> Preparer::next() {
  if (!seconds_) {
    Preparation needed = backend_.preparation(scene_);
    seconds_ = needed.seconds;
    if (seconds_of(needed) < kQuick) return {};
    if (!needed.pieces.empty()) return std::move(needed.pieces);
  } else if (!made_) {  // a piece that is gone again, for want of room, is made with the rest
    for (const Errand& piece : backend_.preparation(scene_).pieces) *seconds_ += piece.seconds;
  }
  if (made_ || *seconds_ < kQuick) return {};
  std::vector<Errand> rest;
  rest.push_back({.seconds = *seconds_, .run = [this](const Interrupt&) {
                    made_ = guard([&]() -> Expected<DeviceScenes> {
                      return backend_.prepare({&scene_, 1}, interrupt_);
                    });
                  }});
  return rest;
}

Expected<std::shared_ptr<const DeviceScene>> Preparer::take() {
  if (!made_) made_ = run_on(backend_, [&] { return backend_.prepare({&scene_, 1}, interrupt_); });
  if (!*made_) return std::unexpected(std::move(*made_).error());
  return (*made_)->front();
}

}  // namespace heliograph
