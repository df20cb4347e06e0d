// Bookkeeping of scenes that are kept.
#include "renderer/resident/kept_scenes.h"

#include <algorithm>
#include <tuple>
#include <utility>

#include "renderer/resident/scene.h"

namespace heliograph::resident {
namespace {

constexpr std::size_t kOfOneScene = 8;           // states: revisions, and times of each
constexpr u64 kBytesOfAnyState = u64(64) << 10;  // of a scene without anything in it, measured

/// Amount of its entities that a snapshot shares with another.
u32 shared_chunks(const Snapshot& a, const Snapshot& b) {
  u32 shared = 0;
  for (u32 c = 0; c < b.poses.chunk_count(); ++c)
    shared += u32(a.entities.shares(c, b.entities)) + u32(a.poses.shares(c, b.poses));
  return shared;
}

auto likeness(const SceneState& state, const Snapshot& snapshot, const TimeSpan& span) {
  const Snapshot& before = state.snapshot();
  return std::tuple(same_poses(state, snapshot, span), shared_chunks(before, snapshot),
                    same_materials(before, snapshot), before.dome == snapshot.dome);
}

}  // namespace

KeptScenes::State KeptScenes::nearest_of_scene(const Snapshot& snapshot,
                                               const TimeSpan& span) const {
  const auto found = scenes_.find(snapshot.scene);
  if (found == scenes_.end()) return nullptr;
  const auto& states = found->second.states;
  return std::ranges::max_element(
             states.rbegin(), states.rend(), {},
             [&](const Kept& kept) { return likeness(*kept.state, snapshot, span); })
      ->state;
}

KeptScenes::State KeptScenes::nearest(const Snapshot& snapshot, const TimeSpan& span) const {
  if (auto own = nearest_of_scene(snapshot, span)) return own;
  const auto like = [&](const auto& entry) {
    const OfScene& of = entry.second;
    return std::pair(likeness(*of.states.back().state, snapshot, span), of.used);
  };
  const auto best = std::ranges::max_element(scenes_, {}, like);
  return best == scenes_.end() ? nullptr : best->second.states.back().state;
}

KeptScenes::Kept* KeptScenes::find(const State& state) {
  const auto scene = scenes_.find(state->snapshot().scene);
  if (scene == scenes_.end()) return nullptr;
  const auto found = std::ranges::find(scene->second.states, state, &Kept::state);
  if (found == scene->second.states.end()) return nullptr;
  scene->second.used = ++uses_;
  return &*found;
}

bool KeptScenes::has(const ResidentScene& scene) const {
  const auto of = scenes_.find(scene.snapshot().scene);
  return of != scenes_.end() && std::ranges::any_of(of->second.states, [&](const Kept& kept) {
           return kept.scene.lock().get() == &scene;
         });
}

void KeptScenes::count(OfScene& of) {
  bytes_ -= of.bytes;
  of.bytes = 0;
  const SceneState* before = nullptr;
  for (const Kept& kept : of.states) {
    of.bytes += kBytesOfAnyState + kept.state->bytes_beside(before);
    before = kept.state.get();
  }
  bytes_ += of.bytes;
}

KeptScenes::Dropped KeptScenes::noted(Dropped dropped) {
  if (copies_ > 0)
    for (const Kept& kept : dropped) let_go_.push_back(kept.scene);
  return dropped;
}

std::vector<std::shared_ptr<const ResidentScene>> KeptScenes::let_go() {
  std::vector<std::shared_ptr<const ResidentScene>> all;
  for (const auto& each : std::exchange(let_go_, {}))
    if (auto scene = each.lock()) all.push_back(std::move(scene));
  return all;
}

KeptScenes::Dropped KeptScenes::add(Kept kept) {
  const Snapshot& newest = kept.state->snapshot();
  const Key key = newest.scene;
  if (dropped_.erase(key) > 0) ++made_again_;
  OfScene& of = scenes_[key];
  Dropped dropped;
  const bool is_of_a_scene = !key.expired();
  std::erase_if(of.states, [&](Kept& old) {
    const bool is_past = is_of_a_scene && !same_assets(old.state->snapshot(), newest);
    if (!is_past || is_used(old)) return false;
    dropped.push_back(std::move(old));
    return true;
  });
  if (of.states.size() >= kOfOneScene) {
    dropped.push_back(std::move(of.states.front()));
    of.states.erase(of.states.begin());
  }
  of.states.push_back(std::move(kept));
  of.used = ++uses_;
  count(of);
  return noted(std::move(dropped));
}

KeptScenes::Dropped KeptScenes::drop_dead() {
  const Key of_none;
  const auto is_dead = [&](const Key& key) {
    return key.expired() && (key.owner_before(of_none) || of_none.owner_before(key));
  };
  Dropped dropped;
  std::erase_if(scenes_, [&](auto& entry) {
    if (!is_dead(entry.first)) return false;
    bytes_ -= entry.second.bytes;
    std::ranges::move(entry.second.states, std::back_inserter(dropped));
    return true;
  });
  std::erase_if(dropped_, is_dead);
  return noted(std::move(dropped));
}

KeptScenes::Dropped KeptScenes::drop_oldest() {
  const auto may_go = [&](const auto& entry) {
    const auto life = entry.first.lock();
    return entry.second.used != uses_ && !(life && life->is_pinned) &&
           std::ranges::none_of(entry.second.states,
                                [&](const Kept& kept) { return is_used(kept); });
  };
  auto oldest = scenes_.end();
  for (auto each = scenes_.begin(); each != scenes_.end(); ++each)
    if ((oldest == scenes_.end() || each->second.used < oldest->second.used) && may_go(*each))
      oldest = each;
  if (oldest == scenes_.end()) return {};
  bytes_ -= oldest->second.bytes;
  Dropped dropped = std::move(oldest->second.states);
  dropped_.insert(oldest->first);
  scenes_.erase(oldest);
  return noted(std::move(dropped));
}

}  // namespace heliograph::resident
