// Poses of many entities that are there, by all threads. Called by apply().
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <numeric>
#include <ranges>

#include "renderer/base/parallel.h"
#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

constexpr u32 kRows = ChunkedArray<mat4x3>::kRows;
constexpr u32 kFew = 512;             // ids that are not worth an order
constexpr std::size_t kGrain = 4096;  // ids that are worth a thread
constexpr u32 kChunks = 16;           // as many rows

struct Found {
  std::size_t first_bad = 0;  // of the ids, that is no entity's; as many as there are: none
  bool are_ascending = true;  // by chunk
};

Found look_up(const Snapshot& scene, std::span<const Id> ids) {
  std::atomic<std::size_t> first_bad = ids.size();
  std::atomic<bool> are_ascending = true;
  parallel_ranges(ids.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    u32 last = begin > 0 ? ids[begin - 1].index() : 0;
    bool ascending = true;
    for (std::size_t k = begin; k < end; ++k) {
      if (!scene.find(EntityId(ids[k]))) {
        for (std::size_t bad = first_bad; k < bad && !first_bad.compare_exchange_weak(bad, k);) {
        }
        return;
      }
      ascending &= last / kRows <= ids[k].index() / kRows;
      last = ids[k].index();
    }
    if (!ascending) are_ascending = false;
  });
  return {first_bad, are_ascending};
}

/// The places of ids, those of one chunk one after the other and in their order.
std::vector<u32> by_chunk(std::span<const Id> ids, u32 chunks) {
  std::vector<u32> next(chunks + 1);
  for (const Id id : ids) ++next[id.index() / kRows + 1];
  std::partial_sum(next.begin(), next.end(), next.begin());
  std::vector<u32> places(ids.size());
  for (u32 k = 0; k < ids.size(); ++k) places[next[ids[k].index() / kRows]++] = k;
  return places;
}

/// Clones a chunk once, and only if something in it changes.
template <class Places>
void write_chunk(ChunkedArray<mat4x3>& poses, u32 chunk, const Poses& action, Places places) {
  const auto row_of = [&](u32 k) { return action.ids[k].index() % kRows; };
  const auto now = poses.chunk(chunk);
  auto k =
      std::ranges::find_if(places, [&](u32 i) { return now[row_of(i)] != action.matrices[i]; });
  if (k == places.end()) return;
  const auto rows = poses.write_chunk(chunk);
  for (; k != places.end(); ++k)
    if (mat4x3& row = rows[row_of(*k)]; row != action.matrices[*k]) row = action.matrices[*k];
}

/// In order: chunks of ids do not descend along the places.
template <class Places>
void write_chunks(ChunkedArray<mat4x3>& poses, const Poses& action, Places places) {
  const auto chunk_of = [&](u32 k) { return action.ids[k].index() / kRows; };
  const u32 first = chunk_of(places.front()), last = chunk_of(places.back());
  parallel_ranges(last - first + 1, kChunks, [&](u32 begin, u32 end) {
    auto from = std::ranges::lower_bound(places, first + begin, {}, chunk_of);
    for (u32 c = first + begin; c < first + end; ++c) {
      const auto to =
          std::ranges::find_if(from, places.end(), [&](u32 k) { return chunk_of(k) != c; });
      if (from != to) write_chunk(poses, c, action, std::ranges::subrange(from, to));
      from = to;
    }
  });
}

/// Drops keys, and lets jump.
void store_rows(Draft& draft, const Poses& action) {
  for (const Id id : action.ids) {
    const Entity& now = *draft.next.find(EntityId(id));
    if (!now.keys && !action.teleport) continue;
    Entity row = now;
    row.keys = nullptr;
    if (action.teleport) row.teleported = draft.next.advances;
    store(draft, EntityId(id), row);
  }
}

}  // namespace

Status place(Draft& draft, const Poses& action) {
  const std::span<const Id> ids = action.ids.span();
  if (ids.size() != action.matrices.size())
    return fail(Code::kInvalidArgument, "matrices",
                fmt::format("{} matrices for {} ids", action.matrices.size(), ids.size()));
  const auto [bad, are_ascending] = look_up(draft.next, ids);
  if (bad < ids.size())
    return fail(EntityId(ids[bad]) || !ids[bad] ? Code::kNotFound : Code::kInvalidArgument,
                fmt::format("ids[{}]", bad),
                fmt::format("{} {} is not an entity of the scene", kind_name(ids[bad].kind()),
                            ids[bad].value));
  if (draft.next.keyed > 0 || action.teleport) store_rows(draft, action);
  ChunkedArray<mat4x3>& poses = draft.next.poses;
  const u32 count = u32(ids.size());
  if (count < kFew)
    for (u32 k = 0; k < count; ++k) set_pose(draft, EntityId(ids[k]), action.matrices[k]);
  else if (are_ascending)
    write_chunks(poses, action, std::views::iota(0u, count));
  else
    write_chunks(poses, action, std::span<const u32>(by_chunk(ids, poses.chunk_count())));
  return {};
}

}  // namespace heliograph
