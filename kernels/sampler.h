// Random numbers from (seed, pixel, sample, dimension), without state: a shuffled, Owen-scrambled
// Sobol' sequence, padded in pairs of dimensions. Called by path.h.
#pragma once

#include "kernels/hash.h"

namespace heliograph::kernels::inline HELIO_ISA {

KERNEL u32 reverse_bits(u32 x) {
#if defined(__CUDA_ARCH__)
  return __brev(x);
#else
  x = __builtin_bswap32(x);
  x = ((x >> 4) & 0x0f0f0f0fu) | ((x & 0x0f0f0f0fu) << 4);
  x = ((x >> 2) & 0x33333333u) | ((x & 0x33333333u) << 2);
  return ((x >> 1) & 0x55555555u) | ((x & 0x55555555u) << 1);
#endif
}

/// A hash in which each bit depends on lower bits only: between two bit reversals it is an Owen
/// scrambling.
///
/// Source: Laine and Karras 2011; this variant of the multipliers is Vegdahl's 2021, "Building a
/// Better LK Hash".
KERNEL u32 owen_hash(u32 x, u32 seed) {
  x ^= x * 0x3d20adeau;
  x += seed;
  x *= (seed >> 16) | 1;
  x ^= x * 0x05526c56u;
  return x ^ (x * 0x53a22864u);
}

/// The bit-reversed second Sobol' dimension of index i: the product of i's bits with Pascal's
/// triangle modulo 2, which is the transform "sum over all supersets" of the bits' numbers.
///
/// Source: Sobol' 1967; Ahmed 2024, "An Implementation Algorithm of 2D Sobol Sequence Fast,
/// Elegant, and Compact", section 3.
KERNEL u32 reversed_sobol1(u32 i) {
  i ^= i >> 16;
  i ^= (i & 0xff00ff00u) >> 8;
  i ^= (i & 0xf0f0f0f0u) >> 4;
  i ^= (i & 0xccccccccu) >> 2;
  return i ^ ((i & 0xaaaaaaaau) >> 1);
}

/// The random numbers of one sample of one pixel.
///
/// Source: Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4).
/// Tested: tests/unit/sampler_test.cpp.
class Sampler {
 public:
  KERNEL Sampler(u64 pixel_key, u32 sample)
      : key_(pixel_key), reversed_index_(reverse_bits(sample)) {}

  /// Two numbers in [0, 1): over the samples of a pixel each pair is a scrambled (0, 2)-sequence,
  /// independent of the other pairs.
  KERNEL vec2 get2(u32 pair) const {
    const u64 bits = seed(pair);
    const u32 index = shuffled_index(u32(bits));
    const u32 x = reverse_bits(owen_hash(index, u32(bits >> 32)));
    const u32 y = reverse_bits(owen_hash(reversed_sobol1(index), u32(hash_y(bits))));
    return vec2(unit_float(x), unit_float(y));
  }
  /// The first number of the pair alone.
  KERNEL float get1(u32 pair) const {
    const u64 bits = seed(pair);
    const u32 index = shuffled_index(u32(bits));
    return unit_float(reverse_bits(owen_hash(index, u32(bits >> 32))));
  }
  /// A seed for random choices that need no stratification.
  KERNEL u32 hash_of(u32 number) const {
    return u32(hash64(key_ + (u64(reversed_index_) << 8) + number));
  }

 private:
  KERNEL u64 seed(u32 pair) const { return hash64(key_ + pair * 0x9e3779b97f4a7c15ull); }
  KERNEL u32 shuffled_index(u32 seed) const {
    return reverse_bits(owen_hash(reversed_index_, seed));
  }
  static KERNEL u64 hash_y(u64 bits) { return (bits * 0xd6e8feb86659fd93ull) >> 32; }

  u64 key_;
  u32 reversed_index_;
};

/// What a pixel's random numbers start from.
KERNEL u64 pixel_key(u64 seed, u32 x, u32 y) { return hash64(hash64(seed) + (u64(y) << 32 | x)); }

}  // namespace heliograph::kernels::inline HELIO_ISA
