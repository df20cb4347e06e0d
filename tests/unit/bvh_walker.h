// Whether a tree holds what it was made from. Shared by the tests of its builders.
#pragma once

#include <bit>
#include <cfloat>
#include <cmath>
#include <cstring>

#include "renderer/bvh/build.h"
#include "tests/unit/bvh_scene.h"

namespace heliograph::test {

using bvh::Box;

inline std::vector<Box> random_boxes(Random& random, u32 count, float reach, float size) {
  std::vector<Box> boxes(count);
  for (Box& box : boxes) {
    const vec3 at = random_vec3(random, reach);
    box.extend(at);
    box.extend(at + random_vec3(random, size));
  }
  return boxes;
}

/// What a tree says of its items.
struct Walked {
  std::vector<u32> found;  // how often, by number of the box
  u32 depth = 0;
  bool holds = true;  // every item lies in the boxes of all nodes above it
};

inline Box child_box(const kernels::BvhNode& node, u32 slot) {
  Box box;
  for (int k = 0; k < 3; ++k) {
    const double cell = std::ldexp(1.0, int(node.exponent[k]) - 127);
    // A float that does not cut off what a double has.
    const double low = double(node.origin[k]) + cell * node.low[k][slot];
    const double high = double(node.origin[k]) + cell * node.high[k][slot];
    box.lower[k] = std::nextafter(float(low), FLT_MAX);
    box.upper[k] = std::nextafter(float(std::min(high, double(FLT_MAX))), -FLT_MAX);
    if (double(box.lower[k]) > low) box.lower[k] = std::nextafter(box.lower[k], -FLT_MAX);
    if (double(box.upper[k]) < high) box.upper[k] = std::nextafter(box.upper[k], FLT_MAX);
  }
  return box;
}

inline bool within(const Box& inner, const Box& outer) {
  for (int k = 0; k < 3; ++k)
    if (inner.lower[k] < outer.lower[k] || inner.upper[k] > outer.upper[k]) return false;
  return true;
}

class Walker {
 public:
  Walker(const bvh::Tree& tree, std::span<const Box> boxes) : tree_(tree), boxes_(boxes) {
    walked_.found.assign(boxes.size(), 0);
    node(0, 1);
  }
  [[nodiscard]] const Walked& walked() const { return walked_; }

 private:
  void node(u32 number, u32 depth) {
    const kernels::BvhNode& n = tree_.nodes.at(number);
    walked_.depth = std::max(walked_.depth, depth);
    u32 inner = 0, items = 0;
    for (u32 slot = 0; slot < kernels::kBvhChildren; ++slot) {
      if (n.meta[slot] == 0) continue;
      above_.push_back(child_box(n, slot));
      if (n.inner >> slot & 1) {
        CHECK(n.meta[slot] == 32 + 24 + slot);
        node(n.first_child + inner++, depth + 1);
      } else {
        const u32 count = u32(std::popcount(u32(n.meta[slot] >> 5)));
        CHECK((n.meta[slot] & 31) == items);
        for (u32 i = 0; i < count; ++i) item(n.first_item + items + i);
        items += count;
      }
      above_.pop_back();
    }
  }
  void item(u32 i) {
    const u32 number = tree_.items.at(i);
    ++walked_.found.at(number);
    for (const Box& box : above_) walked_.holds &= within(boxes_[number], box);
  }

  const bvh::Tree& tree_;
  std::span<const Box> boxes_;
  std::vector<Box> above_;
  Walked walked_;
};

/// Every box that is not empty is found once, and in all boxes above it.
inline void check_sound(const bvh::Tree& tree, std::span<const Box> boxes) {
  const Walker walker(tree, boxes);
  const Walked& walked = walker.walked();
  CHECK(walked.holds);
  CHECK(walked.depth <= kernels::kBvhDepth);
  u32 wrong = 0;
  for (std::size_t i = 0; i < boxes.size(); ++i)
    wrong += walked.found[i] != (boxes[i].empty() ? 0u : 1u);
  CHECK(wrong == 0);
}

inline bool same_trees(const bvh::Tree& a, const bvh::Tree& b) {
  return a.items == b.items && a.nodes.size() == b.nodes.size() &&
         std::memcmp(a.nodes.data(), b.nodes.data(), a.nodes.size() * sizeof(kernels::BvhNode)) ==
             0;
}

}  // namespace heliograph::test
