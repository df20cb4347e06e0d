// Which entities of a structure differ between two snapshots, and which move while the shutter is
// open: found by the chunks that tables share, so that what did not change is not looked at.
#pragma once

#include <algorithm>
#include <span>

#include "renderer/base/parallel.h"
#include "renderer/frame/motion_keys.h"
#include "renderer/placement/structure.h"

namespace heliograph::resident {

/// A snapshot in a span of time.
struct Moment {
  const Snapshot& snapshot;
  TimeSpan span;
};

// All lists are ascending.

/// The entities whose rows differ, or whose local poses in the middle of the spans do.
[[nodiscard]] std::vector<u32> changed_entities(const Moment& before, const Moment& now,
                                                const Structure& structure);
/// The same of rows alone.
[[nodiscard]] std::vector<u32> entities_with_other_rows(const Snapshot& before,
                                                        const Snapshot& now);
/// True if local poses in a chunk of entities are what Snapshot::poses has.
[[nodiscard]] bool has_plain_poses(const Moment& moment, u32 chunk);
/// The entities that may move within the span, but for those that an ancestor moves.
[[nodiscard]] std::vector<u32> moving_entities(const Moment& now, const Structure& structure);
/// The slots for which deform_within() may have vertices.
[[nodiscard]] std::vector<u32> deforming_slots(const Moment& now, const Structure& structure);

/// The slots that entities have.
[[nodiscard]] std::vector<u32> slots_of(const Structure& structure, std::span<const u32> entities);
/// Adds numbers to an ascending list.
void merge(std::vector<u32>& list, std::vector<u32> more);
/// Sorts numbers below `end`, and drops those that are there already.
void make_ascending(std::vector<u32>& numbers, u32 end);

/// f(chunk, rows in it) for the chunks of a ChunkedArray that ascending rows lie in, by all
/// threads. No row is there twice.
template <class F>
void for_each_chunk(std::span<const u32> rows, const F& f) {
  constexpr u32 kRows = ChunkedArray<u32>::kRows;
  std::vector<std::span<const u32>> chunks;
  while (!rows.empty()) {
    const auto chunk = rows.first(std::min<std::size_t>(rows.size(), kRows));
    const auto end = std::ranges::upper_bound(chunk, rows.front() / kRows, {},
                                              [](u32 row) { return row / kRows; });
    chunks.push_back(rows.first(std::size_t(end - chunk.begin())));
    rows = rows.subspan(chunks.back().size());
  }
  parallel_for(chunks.size(), [&](std::size_t i) { f(chunks[i].front() / kRows, chunks[i]); });
}

}  // namespace heliograph::resident
