// Motion within a span of time, and where its keys bend it. Declared in motion.h.
#include <algorithm>

#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

/// True if what is keyed from `first` to `last`, and held outside, may change within a span.
bool overlaps(const TimeSpan& span, Time first, Time last) {
  return first < span.end && last > span.begin;
}

void add_bend(const TimeSpan& span, Time time, std::vector<Time>& bends) {
  if (time > span.begin && time < span.end) bends.push_back(time);
}

bool keys_within(const std::vector<Time>& times, const TimeSpan& span, std::vector<Time>& bends) {
  if (times.size() < 2 || !overlaps(span, times.front(), times.back())) return false;
  for (const Time time : times) add_bend(span, time, bends);
  return true;
}

/// True if an entity without keys is as it was before the last Advance, relative to its parent.
bool stood_still(const Snapshot& snapshot, u32 index, const Entity& then) {
  const Entity& now = snapshot.entities.at(index);
  return !then.keys && then.parent == now.parent &&
         snapshot.previous->poses[index] == snapshot.poses[index];
}

/// True if what moved in the last Advance may change within the span.
bool history_within(const Snapshot& snapshot, const TimeSpan& span, std::vector<Time>& bends) {
  if (!snapshot.previous || !overlaps(span, snapshot.previous->time, snapshot.time)) return false;
  add_bend(span, snapshot.previous->time, bends);
  add_bend(span, snapshot.time, bends);
  return true;
}

bool moves_itself(const Snapshot& snapshot, u32 index, const TimeSpan& span,
                  std::vector<Time>& bends) {
  const Entity& entity = snapshot.entities.at(index);
  if (!entity.keys) {
    const Entity* then = before_advance(snapshot, index);
    return then && !stood_still(snapshot, index, *then) && history_within(snapshot, span, bends);
  }
  const PoseKeys& keys = *entity.keys;
  if (!overlaps(span, keys.front().time, keys.back().time)) return false;
  for (const PoseKey& key : keys) add_bend(span, key.time, bends);
  return true;
}

}  // namespace

bool moves_within(const Snapshot& snapshot, u32 entity, const TimeSpan& span,
                  std::vector<Time>& bends) {
  if (span.instant() || (snapshot.keyed == 0 && !snapshot.previous)) return false;
  bool moves = moves_itself(snapshot, entity, span, bends);
  for (EntityId parent = snapshot.entities.at(entity).parent; parent;
       parent = snapshot.entities.at(parent.index()).parent)
    moves |= moves_itself(snapshot, parent.index(), span, bends);
  return moves;
}

bool deforms_within(const Snapshot& snapshot, u32 index, const TimeSpan& span,
                    std::vector<Time>& bends) {
  const Entity& entity = snapshot.entities.at(index);
  const auto* mesh = snapshot.find(entity.mesh);
  if (!mesh || span.instant()) return false;
  bool deforms = keys_within(mesh->value->vertices->times, span, bends);
  if (entity.morph_weights) deforms |= keys_within(entity.morph_weights->times, span, bends);
  if (const Mesh* old = mesh_before_advance(snapshot, index);
      old && (old->vertices != mesh->value->vertices ||
              before_advance(snapshot, index)->morph_weights != entity.morph_weights))
    deforms |= history_within(snapshot, span, bends);
  if (!entity.skin) return deforms;
  deforms |= moves_within(snapshot, index, span, bends);
  for (const EntityId joint : entity.skin->joints)
    deforms |= moves_within(snapshot, joint.index(), span, bends);
  return deforms;
}

}  // namespace heliograph
