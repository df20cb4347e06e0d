#include "renderer/placement/changes.h"

#include <algorithm>
#include <cstring>
#include <iterator>

namespace heliograph::resident {
namespace {

constexpr u32 kRows = ChunkedArray<u32>::kRows;

/// The entities of a chunk that are alive.
template <class F>
void for_each_alive(const Snapshot& snapshot, u32 chunk, F&& f) {
  const u32 end = std::min((chunk + 1) * kRows, snapshot.entities.capacity());
  for (u32 i = chunk * kRows; i < end; ++i)
    if (snapshot.entities.alive(i)) f(i);
}

/// True if nothing in a chunk of entities changed since the last Advance, and so none that has no
/// keys moved.
bool stood_still(const Snapshot& snapshot, u32 chunk) {
  return snapshot.poses.shares(chunk, snapshot.previous->poses) &&
         snapshot.entities.shares(chunk, snapshot.previous->entities);
}

/// True if what has no keys in a chunk of entities is where Snapshot::poses has it.
bool is_present(const Moment& moment, u32 chunk) {
  return !in_history(moment.snapshot, moment.span.middle()) || stood_still(moment.snapshot, chunk);
}

bool same_local_pose(const Moment& a, const Moment& b, u32 entity) {
  const mat4x3 pose_a = local_pose(a.snapshot, entity, a.span.middle());
  const mat4x3 pose_b = local_pose(b.snapshot, entity, b.span.middle());
  return std::memcmp(&pose_a, &pose_b, sizeof pose_a) == 0;
}

/// Adds the rows of a chunk that differ; of entities that are not alive they are the same.
void add_moved(const Snapshot& then, const Snapshot& now, u32 chunk, std::vector<u32>& moved) {
  const auto a = then.poses.chunk(chunk), b = now.poses.chunk(chunk);
  for (u32 i = 0; i < b.size(); ++i)
    if (std::memcmp(&a[i], &b[i], sizeof b[i]) != 0) moved.push_back(chunk * kRows + i);
}

/// Lists of numbers in an order, one after the other.
std::vector<u32> joined(const std::vector<std::vector<u32>>& lists) {
  std::vector<u32> all;
  for (const auto& list : lists) all.insert(all.end(), list.begin(), list.end());
  return all;
}

}  // namespace

bool has_plain_poses(const Moment& moment, u32 chunk) {
  return moment.snapshot.keyed == 0 && is_present(moment, chunk);
}

std::vector<u32> entities_with_other_rows(const Snapshot& before, const Snapshot& now) {
  std::vector<u32> entities;
  for (u32 c = 0; c < now.entities.chunk_count(); ++c)
    if (!now.entities.shares(c, before.entities))
      for_each_alive(now, c, [&](u32 entity) {
        if (!(now.entities.at(entity) == before.entities.at(entity))) entities.push_back(entity);
      });
  return entities;
}

std::vector<u32> changed_entities(const Moment& before, const Moment& now,
                                  const Structure& structure) {
  const Snapshot &then = before.snapshot, &snapshot = now.snapshot;
  std::vector<u32> chunks;
  for (u32 c = 0; c < snapshot.poses.chunk_count(); ++c)
    if (!snapshot.poses.shares(c, then.poses) || !snapshot.entities.shares(c, then.entities) ||
        !is_present(before, c) || !is_present(now, c))
      chunks.push_back(c);
  std::vector<std::vector<u32>> changed(chunks.size());
  parallel_for(chunks.size(), [&](std::size_t i) {
    const bool same_rows = snapshot.entities.shares(chunks[i], then.entities);
    if (same_rows && has_plain_poses(before, chunks[i]) && has_plain_poses(now, chunks[i]))
      return add_moved(then, snapshot, chunks[i], changed[i]);
    for_each_alive(snapshot, chunks[i], [&](u32 entity) {
      if (!same_local_pose(before, now, entity) ||
          (!same_rows && !(snapshot.entities.at(entity) == then.entities.at(entity))))
        changed[i].push_back(entity);
    });
  });
  std::vector<u32> all = joined(changed);
  std::vector<u32> keyed;
  for (const u32 entity : structure.keyed)
    if (!same_local_pose(before, now, entity)) keyed.push_back(entity);
  merge(all, std::move(keyed));
  return all;
}

std::vector<u32> moving_entities(const Moment& now, const Structure& structure) {
  const Snapshot& snapshot = now.snapshot;
  std::vector<u32> moving;
  if (now.span.instant()) return moving;
  const auto add = [&](u32 entity) {
    std::vector<Time> bends;
    if (moves_within(snapshot, entity, now.span, bends)) moving.push_back(entity);
  };
  std::ranges::for_each(structure.keyed, add);
  if (!snapshot.previous) return moving;
  std::vector<u32> keyed = std::move(moving);
  moving.clear();
  for (u32 c = 0; c < snapshot.poses.chunk_count(); ++c)
    if (!stood_still(snapshot, c)) for_each_alive(snapshot, c, add);
  merge(moving, std::move(keyed));
  return moving;
}

std::vector<u32> deforming_slots(const Moment& now, const Structure& structure) {
  const Snapshot& snapshot = now.snapshot;
  std::vector<u32> slots = structure.deforming;
  if (!snapshot.previous || now.span == TimeSpan{snapshot.time, snapshot.time}) return slots;
  const Snapshot& previous = *snapshot.previous;
  std::vector<u32> entities;
  for (u32 c = 0; c < snapshot.entities.chunk_count(); ++c)
    if (!snapshot.entities.shares(c, previous.entities))
      for_each_alive(snapshot, c, [&](u32 entity) { entities.push_back(entity); });
  merge(slots, slots_of(structure, entities));
  if (snapshot.meshes.same(previous.meshes)) return slots;
  std::vector<u8> edited(snapshot.meshes.capacity());
  snapshot.meshes.for_each_changed(previous.meshes, [&](u32 mesh) { edited[mesh] = 1; });
  std::vector<u32> shown;
  for (u32 i = 0; i < structure.slots.size(); ++i) {
    const MeshId mesh = snapshot.entities.at(structure.slots[i].entity).mesh;
    if (mesh && edited[mesh.index()]) shown.push_back(i);
  }
  merge(slots, std::move(shown));
  return slots;
}

std::vector<u32> slots_of(const Structure& structure, std::span<const u32> entities) {
  std::vector<u32> slots;
  for (const u32 entity : entities)
    if (const u32 slot = structure.slot_of_entity[entity]; slot != kNone) slots.push_back(slot);
  return slots;
}

void make_ascending(std::vector<u32>& numbers, u32 end) {
  constexpr u32 kFew = 32;  // of so many that may be there one: those are sorted
  if (numbers.size() < end / kFew) {
    std::ranges::sort(numbers);
    numbers.erase(std::ranges::unique(numbers).begin(), numbers.end());
    return;
  }
  std::vector<u8> are_there(end);
  for (const u32 number : numbers) are_there[number] = 1;
  numbers.clear();
  for (u32 i = 0; i < end; ++i)
    if (are_there[i]) numbers.push_back(i);
}

void merge(std::vector<u32>& list, std::vector<u32> more) {
  if (more.empty()) return;
  if (list.empty()) {
    list = std::move(more);
    return;
  }
  std::vector<u32> both;
  both.reserve(list.size() + more.size());
  std::ranges::set_union(list, more, std::back_inserter(both));
  list = std::move(both);
}

}  // namespace heliograph::resident
