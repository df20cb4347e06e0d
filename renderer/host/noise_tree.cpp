#include "renderer/host/noise_tree.h"

#include <algorithm>

namespace heliograph::host {
namespace {

void add(NoiseCell& to, const NoiseCell& cell) {
  to.variance += cell.variance;
  to.spread += cell.spread;
  to.weight += cell.weight;
  to.dark += cell.dark;
  to.known &= cell.known;
  to.pending_variance += cell.pending_variance;
  to.pending_light += cell.pending_light;
}

/// Number of samples that would make a cell's variance, each with the same and all others nothing.
double hits_of(const NoiseCell& cell) {
  return cell.spread > 0 ? cell.variance * cell.variance / cell.spread : 0;
}

NoiseShare shared_by(NoiseCell& cell) {
  const double root = std::clamp((hits_of(cell) - 1) / (kKnownFrom - 1), 0.0, 1.0);
  const double part = root * root;
  NoiseShare share{.own = 1 - part};
  if (cell.weight > 0) share.variance = part * cell.pending_variance / cell.weight;
  if (cell.dark > 0) share.light = part * cell.pending_light / cell.dark;
  cell.pending_variance *= share.own;
  cell.pending_light *= share.own;
  return share;
}

void add(NoiseShare& to, const NoiseShare& above) {
  to.variance += above.variance;
  to.light += above.light;
  to.own *= above.own;
}

}  // namespace

NoiseTree::NoiseTree(u32 width, u32 height) {
  levels_.push_back({width, height, std::vector<Node>(u64(width) * height)});
  while (width > 1 || height > 1) {
    width = (width + 1) / 2;
    height = (height + 1) / 2;
    levels_.push_back({width, height, std::vector<Node>(u64(width) * height)});
  }
}

void NoiseTree::gather() {
  for (u32 level = 1; level < levels_.size(); ++level) {
    Level& below = levels_[level - 1];
    for (u32 y = 0; y < below.height; ++y)
      for (u32 x = 0; x < below.width; ++x)
        add(levels_[level].at(x / 2, y / 2).cell, below.at(x, y).cell);
    for (Node& node : levels_[level].nodes) node.share = shared_by(node.cell);
  }
}

void NoiseTree::share(const NoiseShare& above) {
  add(levels_.back().nodes[0].share, above);
  for (u32 level = u32(levels_.size()) - 1; level > 0; --level) {
    Level& below = levels_[level - 1];
    for (u32 y = 0; y < below.height; ++y)
      for (u32 x = 0; x < below.width; ++x)
        add(below.at(x, y).share, levels_[level].at(x / 2, y / 2).share);
  }
}

}  // namespace heliograph::host
