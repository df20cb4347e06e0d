// Finds numbers that are infinite or NaN among many, without a branch for each.
#pragma once

#include <algorithm>
#include <bit>
#include <span>

#include "renderer/base/types.h"

namespace heliograph {

/// The bits of halves (10 of mantissa) or floats (23), which are ordered as the magnitudes are.
template <class Word, u32 kMantissaBits>
struct FloatBits {
  static constexpr Word kMagnitude = Word(~Word(0)) >> 1;
  static constexpr Word kInfinity = Word(Word(~Word(0)) << kMantissaBits) & kMagnitude;

  template <class Number>
  [[nodiscard]] static bool all_finite(std::span<Number> numbers) {
    Word largest = 0;
    for (const Number number : numbers)
      largest = std::max(largest, Word(std::bit_cast<Word>(number) & kMagnitude));
    return largest < kInfinity;
  }
};

[[nodiscard]] inline bool all_finite(std::span<const float> numbers) {
  return FloatBits<u32, 23>::all_finite(numbers);
}

}  // namespace heliograph
