// Labels, classes and parts of every entity, each in one pass. Declared in labels.h.
#include "renderer/scene/labels.h"

#include <algorithm>
#include <utility>

#include "renderer/scene/light_shapes.h"
#include "renderer/scene/parents_first.h"

namespace heliograph {
namespace {

constexpr u32 kNone = ~0u;

/// Values that an entity passes on to its children.
struct Inherited {
  u32 row = kNone;  // of its instance
  u32 category = 0;
  u32 depth = 0;
  bool visible = true;
};

Inherited inherit(const Entity& entity, u32 own_row, const Inherited& above) {
  Inherited out = above;
  ++out.depth;
  out.visible = above.visible && entity.visible;
  if (entity.label.set) out.row = own_row;
  const bool opts_out = entity.label.set && entity.label.value == 0;
  if (entity.label.category != 0 || opts_out) out.category = entity.label.category;
  return out;
}

/// Values that every entity inherits, parents first.
std::vector<Inherited> inherit_all(const Snapshot& snapshot, const std::vector<u32>& own_row) {
  std::vector<Inherited> out(snapshot.entities.capacity());
  for_each_parents_first(snapshot, [&](u32 index, const Entity& entity) {
    out[index] =
        inherit(entity, own_row[index], entity.parent ? out[entity.parent.index()] : Inherited{});
  });
  return out;
}

/// (label, index) of the entities that state their label themselves, ordered.
std::vector<std::pair<u32, u32>> labelled_entities(const Snapshot& snapshot) {
  std::vector<std::pair<u32, u32>> out;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    if (entity.label.set && entity.label.value != 0) out.emplace_back(entity.label.value, index);
  });
  std::ranges::sort(out);
  return out;
}

/// Hands out part numbers of one instance: explicit ones as they are, the others in between.
class PartNumbers {
 public:
  void reserve(u32 number) { taken_.push_back(number); }
  void sort() { std::ranges::sort(taken_); }
  u32 next(u32 count) {
    for (; at_ < taken_.size() && taken_[at_] < free_ + count; ++at_) free_ = taken_[at_] + 1;
    return std::exchange(free_, free_ + count);
  }

 private:
  std::vector<u32> taken_;
  std::size_t at_ = 0;
  u32 free_ = 1;
};

/// A labelled entity's mesh or volume, and the number that it states for all of it; 0: automatic.
struct MeshParts {
  u32 index = 0;
  u32 row = 0;
  u32 count = 0;
  u32 given = 0;
};

/// Numbers every labelled mesh, also hidden ones, so that hiding one renumbers no other.
void number_parts(const std::vector<MeshParts>& meshes, Labelling& labelling) {
  std::vector<PartNumbers> rows(labelling.instances.size());
  for (const MeshParts& mesh : meshes)
    if (mesh.given != 0) rows[mesh.row].reserve(mesh.given);
  for (PartNumbers& row : rows) row.sort();
  for (const MeshParts& mesh : meshes)
    labelling.entities[mesh.index].part =
        mesh.given != 0 ? mesh.given : rows[mesh.row].next(mesh.count);
}

}  // namespace

Labelling label_entities(const Snapshot& snapshot) {
  const auto labelled = labelled_entities(snapshot);
  Labelling out;
  std::vector<u32> own_row(snapshot.entities.capacity(), kNone);
  for (const auto& [label, index] : labelled) {
    if (out.instances.empty() || out.instances.back().label != label)
      out.instances.push_back({.label = label, .category = 0, .root = index, .entities = {}});
    own_row[index] = u32(out.instances.size() - 1);
  }
  const std::vector<Inherited> inherited = inherit_all(snapshot, own_row);
  for (const auto& [label, index] : labelled) {
    Instance& instance = out.instances[own_row[index]];
    if (inherited[index].depth < inherited[instance.root].depth) instance.root = index;
  }
  for (Instance& instance : out.instances) instance.category = inherited[instance.root].category;
  out.entities.resize(inherited.size());
  std::vector<MeshParts> meshes;
  snapshot.entities.for_each([&](u32 index, const Entity& entity) {
    const Inherited& mine = inherited[index];
    EntityLabel& label = out.entities[index];
    label.category = mine.category;
    if (mine.row == kNone) return;
    Instance& instance = out.instances[mine.row];
    label = {instance.label, instance.category, 0, instance.root};
    const Mesh* mesh = shown_mesh(snapshot, entity);
    if (!mesh && !entity.volume) return;
    const u32 parts = mesh ? mesh->topology->part_count : 1;
    meshes.push_back({index, mine.row, parts, entity.label.part});
    if (mine.visible) instance.entities.push_back(index);
  });
  number_parts(meshes, out);
  return out;
}

}  // namespace heliograph
