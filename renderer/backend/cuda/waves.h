// The waves of a range of a film's samples. While the last paths of one wave's batch are on their
// way, those of the other keep the GPU busy.
#pragma once

#include <vector>

#include "renderer/backend/cuda/wave.h"

namespace heliograph::cuda {

/// One, or several side by side, each with some of the tiles. Thread: the device's.
class Waves {
 public:
  Waves(Context& context, const Programs& programs, const WaveShots& shots, const WorkRange& range);
  [[nodiscard]] Status allocate();
  /// Works until the range is done, the slice's end, or the interrupt. Returns whether it is done.
  [[nodiscard]] Expected<bool> advance(const Slice& slice, const Interrupt& interrupt);

 private:
  [[nodiscard]] Status run(const Slice& slice, const Interrupt& interrupt);

  Context& context_;
  std::vector<Wave> waves_;
};

}  // namespace heliograph::cuda
