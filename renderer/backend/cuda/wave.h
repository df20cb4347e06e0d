// Samples of a film as the GPU works on them: batches of items, rounds of programs.
#pragma once

#include <vector>

#include "renderer/backend/cuda/context.h"
#include "renderer/backend/cuda/launch.h"
#include "renderer/backend/cuda/layout.h"
#include "renderer/device/backend.h"

namespace heliograph::cuda {

/// The programs, with grids that fill the device.
struct Programs {
  struct Program {
    FunctionHandle function = nullptr;
    u32 threads = 0;  // of a block
    u32 most_blocks = 0;
  };
  /// The steps of a wave.
  struct Steps {
    Program begin, trace, arrive, fold;
  };
  Steps one, many;              // of one picture, of many
  Steps one_plain, many_plain;  // of shots that is_plain(), and of plain rays
  Program probe, probe_later, resolve, noise;
  [[nodiscard]] static Expected<Programs> find(const Context& context);
  /// So many threads as there are, or as the device runs at once.
  [[nodiscard]] static LaunchSize size(const Program& program, u64 threads);
};

/// Pictures that a wave takes samples of: of one size, with the same planes and as many groups.
struct WaveShots {
  std::span<const WaveShot> host;    // at least one
  const WaveShot* device = nullptr;  // the same; null: there is one
  FilmCounters* counters = nullptr;  // of their film, on the device
};

/// Items of the first batches of a range's waves together.
inline constexpr u32 kItemsAtFirst = 1 << 23;

/// One of the waves of a range.
struct WavePart {
  u32 index, count;
  /// The wave's tiles.
  [[nodiscard]] WorkRange of(WorkRange range) const;
};

/// Owns: the memory of the paths on their way. Thread: the device's.
class Wave {
 public:
  Wave(Context& context, const Programs& programs, const WaveShots& shots, const WorkRange& range,
       const WavePart& part);
  /// Less where there is less: the result is the same.
  [[nodiscard]] Status allocate();
  /// Starts some rounds, of a batch that is on its way or of a new one.
  [[nodiscard]] Status start();
  /// Waits for what was started, if anything was.
  [[nodiscard]] Status finish();
  [[nodiscard]] bool is_done() const { return next_tile_ >= range_.tile_count; }

 private:
  /// memory   bytes, about
  [[nodiscard]] Status allocate(u64 memory);
  void lay(Layout& layout, u64 items);
  [[nodiscard]] Status begin_batch();
  [[nodiscard]] Status round();
  [[nodiscard]] Status fold();
  [[nodiscard]] Status fill(WaveRound* at, u64 bytes);
  [[nodiscard]] Status launch(const Programs::Program& program, u64 threads);
  [[nodiscard]] Status trace();

  Context& context_;
  const Programs::Steps steps_;
  const WorkRange range_;
  const WavePart part_;
  const Lane lane_;
  bool any_media_ = false;
  DeviceMemory memory_;
  WaveLaunch launch_{};
  u32 batch_tiles_ = 0, batch_samples_ = 0;  // of a whole batch
  u32 most_samples_ = 0;                     // for which there is memory
  u32 next_tile_ = 0, next_sample_ = 0;      // of the range
  bool in_batch_ = false, is_started_ = false;
  TimePoint batch_began_;
};

}  // namespace heliograph::cuda
