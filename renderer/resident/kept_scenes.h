// Which scenes are kept to start from, and for who asks again. Called by SceneStore.
#pragma once

#include <map>
#include <set>

#include "renderer/resident/scene_state.h"

namespace heliograph::resident {

class ResidentScene;

/// States of scenes, by the Scene that they are of: a few of each, in the order in which Scenes
/// were used last. Thread: one at a time.
class KeptScenes {
 public:
  using State = std::shared_ptr<const SceneState>;
  struct Kept {
    State state;
    std::weak_ptr<const ResidentScene> scene;  // of it, if it is used
  };
  /// Scenes that were kept. They may take a millisecond to free.
  using Dropped = std::vector<Kept>;

  /// copies   that a device keeps of each scene, none of which is a use
  explicit KeptScenes(long copies = 0) : copies_(copies) {}

  /// The state of the same Scene that shares most with a snapshot; of those the latest. Null: there
  /// is none.
  [[nodiscard]] State nearest_of_scene(const Snapshot& snapshot, const TimeSpan& span) const;
  /// The same; of another Scene where there is none.
  [[nodiscard]] State nearest(const Snapshot& snapshot, const TimeSpan& span) const;
  /// Null: it is not kept. Its Scene counts as used.
  [[nodiscard]] Kept* find(const State& state);
  /// True if it is kept.
  [[nodiscard]] bool has(const ResidentScene& scene) const;
  /// Keeps one as the latest of its Scene. Older ones go that show what the Scene has no more, or
  /// that are too many.
  [[nodiscard]] Dropped add(Kept kept);
  /// Drops what is of Scenes that are gone.
  [[nodiscard]] Dropped drop_dead();
  /// Drops all of the Scene that was used least lately, where nobody uses a scene of it: but for
  /// the latest used. Empty: there is none.
  [[nodiscard]] Dropped drop_oldest();

  /// Scenes that were dropped since the last call while somebody, or a copy, held them; none where
  /// a device keeps no copies.
  [[nodiscard]] std::vector<std::shared_ptr<const ResidentScene>> let_go();

  [[nodiscard]] u64 bytes() const { return bytes_; }
  /// Scenes that were added again after drop_oldest().
  [[nodiscard]] u64 made_again() const { return made_again_; }

 private:
  using Key = std::weak_ptr<const SceneLife>;
  struct OfScene {
    std::vector<Kept> states;  // the last is the latest
    u64 bytes = 0;
    u64 used = 0;  // when: a number that grows
  };
  void count(OfScene& of);
  [[nodiscard]] bool is_used(const Kept& kept) const { return kept.scene.use_count() > copies_; }

  /// Notes what was dropped, whose copies let_go() will name.
  [[nodiscard]] Dropped noted(Dropped dropped);

  const long copies_;
  std::vector<std::weak_ptr<const ResidentScene>> let_go_;
  std::map<Key, OfScene, std::owner_less<>> scenes_;
  std::set<Key, std::owner_less<>> dropped_;  // by drop_oldest()
  u64 bytes_ = 0;
  u64 uses_ = 0;
  u64 made_again_ = 0;
};

}  // namespace heliograph::resident
