// Boxes of children to a compressed node: which slots they take, and their boxes in bytes. Called
// by builders of trees.
#pragma once

#include <cfloat>

#include "kernels/bvh/bvh_box.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Subtree that becomes a child of a wide node.
struct BvhChild {
  BvhBox box;
  u32 source;  // its number where it comes from; kNone: an empty slot
  u32 items;   // of a leaf; 0: a node
};

/// Bytes along one axis of a node.
class BvhGrid {
 public:
  KERNEL BvhGrid(float lower, float upper) {
    const double extent = double(upper) - double(lower);
    margin_ = extent * 0x1p-20;
    const double low = double(lower) - margin_;
    const double start = low < -double(FLT_MAX) ? -double(FLT_MAX) : low;
    origin = float(start);
    if (double(origin) > start) origin = nextafterf(origin, -FLT_MAX);
    const double reach = double(upper) + margin_ - double(origin);
    if (!(reach > 0)) return;
    exponent = ::ilogb(reach / 255);
    if (exponent < -126) exponent = -126;
    while (::ceil(::ldexp(reach, -exponent)) > 255) ++exponent;
    cells_ = ::ldexp(1.0, -exponent);
  }
  [[nodiscard]] KERNEL u8 low(float x) const {
    return byte(::floor((double(x) - margin_ - double(origin)) * cells_));
  }
  [[nodiscard]] KERNEL u8 high(float x) const {
    return byte(::ceil((double(x) + margin_ - double(origin)) * cells_));
  }

  float origin = 0;
  int exponent = -126;

 private:
  KERNEL static u8 byte(double at) { return at > 0 ? (at < 255 ? u8(at) : u8(255)) : u8(0); }
  double margin_ = 0;  // by which boxes grow, so that rounding while they are met loses nothing
  double cells_ = 0x1p126;  // a unit of length has so many
};

/// Orders children by their slots: a ray that goes up along all axes meets slot 0 first, one that
/// goes down along x slot 4, along y slot 2, along z slot 1.
///
/// Source: Ylitie, Karras and Laine 2017, section 3.2, with a greedy choice in place of an auction.
KERNEL void order_children(BvhChild (&children)[kBvhChildren], u32 count, const BvhBox& parent) {
  const vec3 center = parent.center();
  BvhChild slots[kBvhChildren];
  vec3 to[kBvhChildren];
  HELIO_UNROLL
  for (u32 c = 0; c < kBvhChildren; ++c)
    to[c] = c < count ? children[c].box.center() - center : vec3(0);
  for (BvhChild& slot : slots) slot = {no_box(), kNone, 0};
  struct Wish {
    u32 slot;  // kNone: the child has one
    float gain;
  } wishes[kBvhChildren];
  u32 taken = 0;
  const auto wish_of = [&](vec3 at) {  // the first of those that gain most
    Wish wish{kNone, 0};
    HELIO_UNROLL
    for (u32 s = 0; s < kBvhChildren; ++s) {
      const float gain = (s & 4 ? at.x : -at.x) + (s & 2 ? at.y : -at.y) + (s & 1 ? at.z : -at.z);
      if ((taken >> s & 1) == 0 && (wish.slot == kNone || gain > wish.gain)) wish = {s, gain};
    }
    return wish;
  };
  HELIO_UNROLL
  for (u32 c = 0; c < kBvhChildren; ++c) wishes[c] = c < count ? wish_of(to[c]) : Wish{kNone, 0};
  for (u32 round = 0; round < count; ++round) {
    u32 child = kNone;
    Wish best{kNone, 0};
    HELIO_UNROLL
    for (u32 c = 0; c < kBvhChildren; ++c)
      if (wishes[c].slot != kNone && (child == kNone || wishes[c].gain > best.gain)) {
        child = c;
        best = wishes[c];
      }
    slots[best.slot] = children[child];
    taken |= 1u << best.slot;
    HELIO_UNROLL
    for (u32 c = 0; c < kBvhChildren; ++c) {
      if (c == child) wishes[c].slot = kNone;
      if (wishes[c].slot == best.slot) wishes[c] = wish_of(to[c]);
    }
  }
  for (u32 s = 0; s < kBvhChildren; ++s) children[s] = slots[s];
}

/// A node of children in their slots. Its numbers of nodes and items are the caller's to fill in.
KERNEL BvhNode pack_node(const BvhChild (&slots)[kBvhChildren], const BvhBox& box) {
  BvhNode node{};
  u32 items = 0;
  for (u32 s = 0; s < kBvhChildren; ++s) {
    if (slots[s].source == kNone) continue;
    if (slots[s].items == 0) {
      node.meta[s] = u8(1u << 5 | (24 + s));
      node.inner |= u8(1u << s);
    } else {
      node.meta[s] = u8(((1u << slots[s].items) - 1) << 5 | items);
      items += slots[s].items;
    }
  }
  HELIO_UNROLL
  for (int k = 0; k < 3; ++k) {
    const BvhGrid grid(box.lower[k], box.upper[k]);
    node.origin[k] = grid.origin;
    node.exponent[k] = u8(grid.exponent + 127);
    HELIO_UNROLL
    for (u32 s = 0; s < kBvhChildren; ++s) {
      if (slots[s].source == kNone) continue;
      node.low[k][s] = grid.low(slots[s].box.lower[k]);
      node.high[k][s] = grid.high(slots[s].box.upper[k]);
    }
  }
  return node;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
