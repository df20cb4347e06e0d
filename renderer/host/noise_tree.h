// A quadtree over pixels, or over other such trees, in which variance that few samples brought is
// shared. Used by the noise of a film.
#pragma once

#include <vector>

#include "renderer/base/types.h"

namespace heliograph::host {

/// Samples from which on a number that they yield is known.
inline constexpr double kKnownFrom = 8;

/// Sums over the pixels of a cell.
struct NoiseCell {
  double variance = 0;
  double spread = 0;  // squares of the variances, each over the hits that make it
  double weight = 0;  // how much of what is shared they get
  double dark = 0;    // how many pixels' light is not known
  bool known = true;  // light and variance of all of them
  // Shares of what is not known that no cell below has taken:
  double pending_variance = 0;
  double pending_light = 0;
};

/// A pixel's part of what the cells over it share.
struct NoiseShare {
  double variance = 0;  // over its weight
  double light = 0;     // if its own is not known
  double own = 1;       // the part of its own, where that is not known, that has not been shared
};

/// Leaves are in row-major order. Where a cell has but one hit of its strength, it may as well be
/// that of one pixel: it goes on to the cell above. The more hits there are that are as strong, the
/// larger a part of their variance is shared among the cell's pixels, and all of it from
/// kKnownFrom on.
class NoiseTree {
 public:
  NoiseTree(u32 width, u32 height);

  [[nodiscard]] NoiseCell& leaf(u32 x, u32 y) { return levels_[0].at(x, y).cell; }
  /// Sums the leaves up and lets each cell above them share what it can.
  void gather();
  [[nodiscard]] const NoiseCell& root() const { return levels_.back().nodes[0].cell; }
  /// Adds up for each leaf what the cells over it, and those `above` the root, have shared.
  void share(const NoiseShare& above);
  [[nodiscard]] const NoiseShare& share_of(u32 x, u32 y) { return levels_[0].at(x, y).share; }

 private:
  struct Node {
    NoiseCell cell;
    NoiseShare share;
  };
  struct Level {
    u32 width, height;
    std::vector<Node> nodes;
    [[nodiscard]] Node& at(u32 x, u32 y) { return nodes[u64(y) * width + x]; }
  };
  std::vector<Level> levels_;
};

}  // namespace heliograph::host
