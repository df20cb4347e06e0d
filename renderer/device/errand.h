// Work that a job waits for away from its device. Told by backends, done by workers.h.
#pragma once

#include <array>
#include <functional>
#include <vector>

#include "renderer/frame/interrupt.h"

namespace heliograph {

struct Errand {
  /// The interrupt comes when nobody waits any more.
  using Run = std::function<void(const Interrupt&)>;

  std::array<u64, 7> key{};  // errands of the same key are done once; zeros: it is like no other
  double seconds = 0;        // of a core, about
  Run run;
};

/// Work on a scene before a device shows it.
struct Preparation {
  std::vector<Errand> pieces;  // derived data of its assets
  double seconds = 0;          // of a core, about: all else
};

}  // namespace heliograph
