#include "renderer/backend/cuda/waves.h"

#include <algorithm>

namespace heliograph::cuda {
namespace {

/// Number of waves for a range. A second one is not worth it for what one wave begins at once.
u32 waves_for(const WorkRange& range) {
  const u64 items = u64(range.tile_count) * kernels::kTilePixels * range.sample_count;
  return range.tile_count >= kMostWaves && items > kItemsAtFirst ? kMostWaves : 1;
}

}  // namespace

Waves::Waves(Context& context, const Programs& programs, const WaveShots& shots,
             const WorkRange& range)
    : context_(context) {
  const u32 count = waves_for(range);
  waves_.reserve(count);
  for (u32 i = 0; i < count; ++i)
    waves_.emplace_back(context, programs, shots, range, WavePart{i, count});
}

Status Waves::allocate() {
  for (Wave& wave : waves_) HELIO_TRY(wave.allocate());
  return {};
}

Expected<bool> Waves::advance(const Slice& slice, const Interrupt& interrupt) {
  if (waves_.size() > 1) HELIO_TRY(context_.fork());
  const Status ran = run(slice, interrupt);
  if (waves_.size() > 1) HELIO_TRY(context_.join());
  if (!ran) return std::unexpected(ran.error());
  return std::ranges::all_of(waves_, &Wave::is_done);
}

Status Waves::run(const Slice& slice, const Interrupt& interrupt) {
  HELIO_TRY(interrupt.status());
  for (Wave& wave : waves_) HELIO_TRY(wave.start());
  for (bool any = true; any;) {
    any = false;
    for (Wave& wave : waves_) {
      HELIO_TRY(wave.finish());
      if (wave.is_done() || slice.is_over()) continue;
      HELIO_TRY(interrupt.status());
      HELIO_TRY(wave.start());
      any = true;
    }
  }
  return {};
}

}  // namespace heliograph::cuda
