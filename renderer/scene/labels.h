// Which instance, class and part every entity belongs to: a pure function of the snapshot.
#pragma once

#include <vector>

#include "renderer/scene/snapshot.h"

namespace heliograph {

struct EntityLabel {
  u32 instance = 0;  // 0: none
  u32 category = 0;  // class id
  u32 part = 0;    // number within the instance of its first mesh part, from 1; 0 where unlabelled
  u32 root = ~0u;  // index of the topmost labelled entity of the instance
};

/// One label's row.
struct Instance {
  u32 label = 0;
  u32 category = 0;
  u32 root = 0;               // entity index
  std::vector<u32> entities;  // with a mesh and visible, by index
};

struct Labelling {
  std::vector<EntityLabel> entities;  // by entity index
  std::vector<Instance> instances;    // ordered by label; every labelled one has a row
};

/// All entities of one label have the category of the topmost; one that opted out has its own.
/// An entity that states its part is that part whole, whatever its mesh's parts; of another each
/// mesh part takes the next number that no entity states. Entities are numbered in index order.
[[nodiscard]] Labelling label_entities(const Snapshot& snapshot);

}  // namespace heliograph
