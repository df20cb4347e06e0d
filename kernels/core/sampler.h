// Random numbers from (seed, pixel, sample, dimension), without state: a shuffled, Owen-scrambled
// Sobol' sequence, padded in pairs of dimensions. Called by path.h.
#pragma once

#include "kernels/core/hash.h"

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

/// Seeds that scramble a pair of dimensions.
struct PairSeeds {
  u32 shuffle, x, y;
};
KERNEL PairSeeds pair_seeds(u64 pixel_key, u32 pair) {
  const u64 bits = hash64(pixel_key + pair * 0x9e3779b97f4a7c15ull);
  return {u32(bits), u32(bits >> 32), u32((bits * 0xd6e8feb86659fd93ull) >> 32)};
}
KERNEL u32 shuffled_index(const PairSeeds& seeds, u32 reversed_index) {
  return reverse_bits(owen_hash(reversed_index, seeds.shuffle));
}
KERNEL float first_of(const PairSeeds& seeds, u32 index) {
  return unit_float(reverse_bits(owen_hash(index, seeds.x)));
}
KERNEL float second_of(const PairSeeds& seeds, u32 index) {
  return unit_float(reverse_bits(owen_hash(reversed_sobol1(index), seeds.y)));
}

/// Successive pairs of a sampler that were drawn with those of others, see draw().
struct DrawnPairs {
  static constexpr u32 kMost = 4;
  u32 first;
  u32 count = 0;
  vec2 of[kMost];
};

/// The random numbers of one sample of one pixel.
///
/// Source: Burley 2020, "Practical Hash-based Owen Scrambling", JCGT 9(4).
/// Tested: tests/unit/sampler_test.cpp.
class Sampler {
 public:
  /// drawn   some of its pairs, which outlive it; null: none
  KERNEL Sampler(u64 pixel_key, u32 sample, const DrawnPairs* drawn = nullptr)
      : key_(pixel_key), drawn_(drawn), reversed_index_(reverse_bits(sample)) {}

  /// Two numbers in [0, 1): over the samples of a pixel each pair is a scrambled (0, 2)-sequence,
  /// independent of the other pairs.
  KERNEL vec2 get2(u32 pair) const {
    if (is_drawn(pair)) return drawn_->of[pair - drawn_->first];
    const PairSeeds seeds = pair_seeds(key_, pair);
    const u32 index = shuffled_index(seeds, reversed_index_);
    return vec2(first_of(seeds, index), second_of(seeds, index));
  }
  /// The first number of the pair alone.
  KERNEL float get1(u32 pair) const {
    if (is_drawn(pair)) return drawn_->of[pair - drawn_->first].x;
    const PairSeeds seeds = pair_seeds(key_, pair);
    return first_of(seeds, shuffled_index(seeds, reversed_index_));
  }
  /// A seed for random choices that need no stratification.
  KERNEL u32 hash_of(u32 number) const {
    return u32(hash64(key_ + (u64(reversed_index_) << 8) + number));
  }

 private:
  [[nodiscard]] KERNEL bool is_drawn(u32 pair) const {
    return drawn_ && pair - drawn_->first < drawn_->count;
  }

  u64 key_;
  const DrawnPairs* drawn_;
  u32 reversed_index_;
};

/// Samplers side by side, whose pairs a CPU draws in the lanes of its vectors.
struct SamplerLanes {
  u64 pixel_key[kLanes];
  u32 sample[kLanes];
  u32 first[kLanes];  // pair
  DrawnPairs* to[kLanes];
};
/// Draws pairs [first, first + count) of each.
KERNEL void draw(const SamplerLanes& lanes, u32 count) {
  u32 reversed[kLanes];
  for (u32 i = 0; i < kLanes; ++i) reversed[i] = reverse_bits(lanes.sample[i]);
  for (u32 k = 0; k < count; ++k) {
    u32 shuffle[kLanes], seed_x[kLanes], seed_y[kLanes];
    for (u32 i = 0; i < kLanes; ++i) {
      const PairSeeds seeds = pair_seeds(lanes.pixel_key[i], lanes.first[i] + k);
      shuffle[i] = seeds.shuffle, seed_x[i] = seeds.x, seed_y[i] = seeds.y;
    }
    float x[kLanes], y[kLanes];
    for (u32 i = 0; i < kLanes; ++i) {
      const PairSeeds seeds{shuffle[i], seed_x[i], seed_y[i]};
      const u32 index = shuffled_index(seeds, reversed[i]);
      x[i] = first_of(seeds, index);
      y[i] = second_of(seeds, index);
    }
    for (u32 i = 0; i < kLanes; ++i) lanes.to[i]->of[k] = vec2(x[i], y[i]);
  }
  for (u32 i = 0; i < kLanes; ++i) {
    lanes.to[i]->first = lanes.first[i];
    lanes.to[i]->count = count;
  }
}

/// Key that a pixel's random numbers start from.
KERNEL u64 pixel_key(u64 seed, u32 x, u32 y) { return hash64(hash64(seed) + (u64(y) << 32 | x)); }

}  // namespace heliograph::kernels::inline HELIO_ISA
