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
constexpr u32 kFew = 512;   // ids that are not worth an order
constexpr u32 kChunks = 4;  // as many rows as are worth a thread

bool is_there(const Snapshot& scene, Id id) {
  const EntityId entity(id);
  return entity && scene.entities.has(entity.version(), entity.index());
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

/// Writes the rows of one chunk, if something in it changes: all of them at once, or into a clone.
/// Returns whether the ids are of entities.
template <class Places>
bool write_chunk(Snapshot& scene, u32 chunk, const Poses& action, Places places) {
  const auto now = scene.poses.chunk(chunk);
  const auto row_of = [&](u32 k) { return action.ids[k].index() % kRows; };
  const u32 first = places.front();
  bool are_there = true, are_all = places.size() == now.size();
  for (u32 row = 0; const u32 k : places) {
    are_there &= is_there(scene, action.ids[k]);
    are_all &= k == first + row && row_of(k) == row;
    ++row;
  }
  if (!are_there) return false;
  auto k =
      std::ranges::find_if(places, [&](u32 i) { return now[row_of(i)] != action.matrices[i]; });
  if (k == places.end()) return true;
  if (are_all) {
    const auto rows = action.matrices.span().subspan(first, now.size());
    const BufferPtr& buffer = action.matrices.buffer();
    if (buffer->kind() == Buffer::Kind::kPooled)
      scene.poses.put_chunk(chunk, rows, buffer);
    else
      scene.poses.put_chunk(chunk, rows);
    return true;
  }
  const auto rows = scene.poses.write_chunk(chunk);
  for (; k != places.end(); ++k)
    if (mat4x3& row = rows[row_of(*k)]; row != action.matrices[*k]) row = action.matrices[*k];
  return true;
}

/// In order: chunks of ids do not descend along the places. Whether the ids are of entities.
template <class Places>
bool write_chunks(Snapshot& scene, const Poses& action, Places places) {
  const auto chunk_of = [&](u32 k) { return action.ids[k].index() / kRows; };
  const u32 first = chunk_of(places.front()), last = chunk_of(places.back());
  std::atomic<bool> are_there = true;
  parallel_ranges(last - first + 1, kChunks, [&](u32 begin, u32 end) {
    auto from = std::ranges::lower_bound(places, first + begin, {}, chunk_of);
    for (u32 c = first + begin; c < first + end; ++c) {
      const auto to =
          std::ranges::find_if(from, places.end(), [&](u32 k) { return chunk_of(k) != c; });
      if (from != to && !write_chunk(scene, c, action, std::ranges::subrange(from, to)))
        are_there = false;
      from = to;
    }
  });
  return are_there;
}

bool write(Snapshot& scene, const Poses& action) {
  const std::span<const Id> ids = action.ids.span();
  const u32 capacity = scene.entities.capacity();
  std::atomic<bool> are_within = true, are_ascending = true;
  parallel_ranges(u32(ids.size()), kChunks * kRows, [&](u32 begin, u32 end) {
    bool within = true, ascending = true;
    for (u32 k = begin; k < end; ++k) {
      within &= ids[k].index() < capacity;
      ascending &= ids[k > 0 ? k - 1 : 0].index() / kRows <= ids[k].index() / kRows;
    }
    if (!within) are_within = false;
    if (!ascending) are_ascending = false;
  });
  if (!are_within) return false;
  if (are_ascending) return write_chunks(scene, action, std::views::iota(0u, u32(ids.size())));
  const auto places = by_chunk(ids, scene.poses.chunk_count());
  return write_chunks(scene, action, std::span<const u32>(places));
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
  const auto there = [&](Id id) { return is_there(draft.next, id); };
  const bool has_rows = draft.next.keyed > 0 || action.teleport;
  const bool are_few = ids.size() < kFew;
  bool are_there = !(are_few || has_rows) || std::ranges::all_of(ids, there);
  if (are_there && has_rows) store_rows(draft, action);
  if (are_there && are_few)
    for (u32 k = 0; k < ids.size(); ++k) set_pose(draft, EntityId(ids[k]), action.matrices[k]);
  else if (are_there)
    are_there = write(draft.next, action);
  if (are_there) return {};
  const auto bad = std::ranges::find_if_not(ids, there);
  return fail(
      EntityId(*bad) || !*bad ? Code::kNotFound : Code::kInvalidArgument,
      fmt::format("ids[{}]", bad - ids.begin()),
      fmt::format("{} {} is not an entity of the scene", kind_name(bad->kind()), bad->value));
}

}  // namespace heliograph
