// Integer hashes: seeds of random numbers and of stochastic holes.
#pragma once

#include "kernels/core/platform.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// A bijection of 32-bit words with little bias.
///
/// Source: Wellons 2018, "Prospecting for Hash Functions" ("lowbias32").
KERNEL u32 hash32(u32 x) {
  x ^= x >> 16;
  x *= 0x7feb352du;
  x ^= x >> 15;
  x *= 0x846ca68bu;
  return x ^ (x >> 16);
}

/// The finaliser of SplitMix64.
///
/// Source: Steele, Lea and Flood 2014, "Fast Splittable Pseudorandom Number Generators".
KERNEL u64 hash64(u64 x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9ull;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebull;
  return x ^ (x >> 31);
}

/// The word's upper 24 bits as a number in [0, 1).
KERNEL float unit_float(u32 x) { return float(x >> 8) * 0x1p-24f; }

/// Independent numbers in [0, 1), as many as it takes.
struct HashStream {
  u32 state;
  KERNEL float next() { return unit_float(hash32(state += 0x9e3779b9u)); }
};

}  // namespace heliograph::kernels::inline HELIO_ISA
