#include "renderer/placement/volume_tree.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace heliograph::resident {
namespace {

using kernels::BvhBox;
using kernels::u32;
using kernels::VolumeNode;

class Builder {
 public:
  explicit Builder(std::span<const BvhBox> boxes) : boxes_(boxes), order_(boxes.size()) {
    std::iota(order_.begin(), order_.end(), 0);
    nodes_.reserve(2 * boxes.size());
  }
  std::vector<VolumeNode> make() && {
    nodes_.emplace_back();
    fill(0, order_);
    return std::move(nodes_);
  }

 private:
  void fill(u32 at, std::span<u32> volumes) {
    BvhBox box = kernels::no_box(), centers = kernels::no_box();
    for (const u32 i : volumes) {
      box.extend(boxes_[i]);
      if (!boxes_[i].empty()) centers.extend(boxes_[i].center());
    }
    const bool is_leaf = volumes.size() == 1;
    const u32 first = is_leaf ? volumes.front() : u32(nodes_.size());
    nodes_[at] = {box.lower, first, box.upper, is_leaf};
    if (is_leaf) return;
    const std::size_t half = volumes.size() / 2;
    split(volumes, half, centers.upper - centers.lower);
    nodes_.resize(nodes_.size() + 2);
    fill(first, volumes.first(half));
    fill(first + 1, volumes.subspan(half));
  }

  /// By the centres' widest axis; empty boxes come last.
  void split(std::span<u32> volumes, std::size_t half, kernels::vec3 extent) {
    const int axis =
        extent.x >= extent.y ? (extent.x >= extent.z ? 0 : 2) : (extent.y >= extent.z ? 1 : 2);
    const auto key = [&](u32 i) {
      const BvhBox& box = boxes_[i];
      return std::pair(box.empty() ? INFINITY : box.center()[axis], i);
    };
    std::ranges::nth_element(volumes, volumes.begin() + std::ptrdiff_t(half), {}, key);
  }

  std::span<const BvhBox> boxes_;
  std::vector<u32> order_;
  std::vector<VolumeNode> nodes_;
};

}  // namespace

std::vector<VolumeNode> make_volume_tree(std::span<const BvhBox> boxes) {
  return boxes.empty() ? std::vector<VolumeNode>() : Builder(boxes).make();
}

}  // namespace heliograph::resident
