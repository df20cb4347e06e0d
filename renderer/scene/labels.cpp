// Labels, classes and parts of every entity in one pass. Declared in labels.h.
#include "renderer/scene/labels.h"

#include <algorithm>
#include <map>
#include <utility>

namespace heliograph {

namespace {

/// What an entity passes on to its children.
struct Inherited {
  u32 instance = 0;
  u32 category = 0;
  u32 top = ~0u;  // topmost labelled entity of the instance above, or the entity itself
  bool visible = true;
};

Inherited inherit(const Entity& entity, u32 index, const Inherited& above) {
  Inherited out = above;
  out.visible = above.visible && entity.visible;
  if (entity.label.category != 0) out.category = entity.label.category;
  if (entity.label.set && entity.label.value != above.instance) {
    out.instance = entity.label.value;
    out.top = out.instance == 0 ? ~0u : index;
  }
  return out;
}

/// What every entity inherits, parents first.
std::vector<Inherited> inherit_all(const Snapshot& snapshot) {
  std::vector<Inherited> out(snapshot.entities.capacity());
  std::vector<bool> done(out.size(), false);
  std::vector<u32> chain;
  snapshot.entities.for_each([&](u32 index, const Entity&) {
    chain.clear();
    for (u32 i = index; !done[i];) {
      chain.push_back(i);
      const EntityId parent = snapshot.entities.at(i).parent;
      if (!parent) break;
      i = parent.index();
    }
    for (; !chain.empty(); chain.pop_back()) {
      const u32 i = chain.back();
      const Entity& entity = snapshot.entities.at(i);
      out[i] = inherit(entity, i, entity.parent ? out[entity.parent.index()] : Inherited{});
      done[i] = true;
    }
  });
  return out;
}

/// Hands out part numbers of one instance: explicit ones as they are, the others in between.
class PartNumbers {
 public:
  void reserve(u32 first, u32 count) { taken_.emplace_back(first, first + count); }
  u32 next(u32 count) {
    std::ranges::sort(taken_);
    for (const auto& [from, to] : taken_)
      if (free_ < to && from < free_ + count) free_ = to;
    return std::exchange(free_, free_ + count);
  }

 private:
  std::vector<std::pair<u32, u32>> taken_;
  u32 free_ = 1;
};

u32 part_count(const Snapshot& snapshot, const Entity& entity) {
  const auto* mesh = snapshot.find(entity.mesh);
  return mesh ? mesh->value->topology->part_count : 1;
}

void number_parts(const Snapshot& snapshot, const Instance& instance,
                  std::vector<EntityLabel>& labels) {
  PartNumbers numbers;
  for (const u32 index : instance.entities)
    if (const Entity& e = snapshot.entities.at(index); e.label.part != 0) {
      labels[index].part = e.label.part;
      numbers.reserve(e.label.part, part_count(snapshot, e));
    }
  for (const u32 index : instance.entities)
    if (labels[index].part == 0)
      labels[index].part = numbers.next(part_count(snapshot, snapshot.entities.at(index)));
}

}  // namespace

Labelling label_entities(const Snapshot& snapshot) {
  const std::vector<Inherited> inherited = inherit_all(snapshot);
  Labelling out;
  out.entities.resize(inherited.size());
  std::map<u32, Instance> instances;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    const Inherited& mine = inherited[index];
    out.entities[index] = {mine.instance, mine.category, 0, ~0u};
    if (mine.instance == 0) return;
    const auto [found, added] = instances.try_emplace(mine.instance);
    Instance& instance = found->second;
    if (added) instance = {mine.instance, inherited[mine.top].category, mine.top, {}};
    if (entity.mesh && mine.visible) instance.entities.push_back(index);
  });
  for (auto& [label, instance] : instances) {
    number_parts(snapshot, instance, out.entities);
    out.instances.push_back(std::move(instance));
  }
  snapshot.entities.for_each([&](u32 index, const Entity&) {
    EntityLabel& label = out.entities[index];
    if (label.instance == 0) return;
    const Instance& instance =
        *std::ranges::lower_bound(out.instances, label.instance, {}, &Instance::label);
    label.root = instance.root;
    label.category = instance.category;
  });
  return out;
}

}  // namespace heliograph
