// Walks entities so that each comes after its parent. Called by motion.cpp and labels.cpp.
#pragma once

#include <vector>

#include "renderer/scene/snapshot.h"

namespace heliograph {

/// Calls f(index, entity) once for every live entity, its parent first.
template <class F>
void for_each_parents_first(const Snapshot& snapshot, F&& f) {
  std::vector<bool> done(snapshot.entities.capacity(), false);
  std::vector<u32> chain;
  snapshot.entities.for_each([&](u32 index, const Entity&) {
    for (u32 i = index; !done[i];) {
      chain.push_back(i);
      const EntityId parent = snapshot.entities.at(i).parent;
      if (!parent) break;
      i = parent.index();
    }
    for (; !chain.empty(); chain.pop_back()) {
      const u32 i = chain.back();
      f(i, snapshot.entities.at(i));
      done[i] = true;
    }
  });
}

}  // namespace heliograph
