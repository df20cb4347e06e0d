#pragma once

#include <cmath>

#include "renderer/base/types.h"

namespace heliograph::resident {

struct Box {
  vec3 lower{INFINITY};
  vec3 upper{-INFINITY};
  void extend(vec3 p) {
    lower = glm::min(lower, p);
    upper = glm::max(upper, p);
  }
  void extend(const Box& box) {
    lower = glm::min(lower, box.lower);
    upper = glm::max(upper, box.upper);
  }
  [[nodiscard]] bool empty() const { return !(lower.x <= upper.x); }
  [[nodiscard]] u64 bytes() const { return 256; }  // with its place in a cache
};

}  // namespace heliograph::resident
