// See scene_charges.h. kEntityBytes is measured: growth of the process by 100,000 entities, per
// entity.
#include "server/scene/scene_charges.h"

#include <algorithm>

namespace heliograph::server {
namespace {

constexpr u64 kEntityBytes = 640;   // with a short name and a few short attributes
constexpr u64 kSharedBytes = 1024;  // of a mesh, a material, a texture, a volume; with its name
constexpr u64 kFewBytes = 128;      // names and attributes that kEntityBytes covers

u64 bytes_of(const Attributes& attributes) {
  u64 bytes = 0;
  for (const auto& [name, value] : attributes) bytes += name.size() + value.size();
  return bytes;
}

/// Returns the bytes of an entity's parts without a fixed size; 0 where kEntityBytes covers them.
u64 bytes_of(const Entity& entity) {
  u64 bytes = 0;
  if (entity.name) bytes += entity.name->size();
  if (entity.attributes) bytes += bytes_of(*entity.attributes);
  if (entity.keys) bytes += entity.keys->size() * sizeof(PoseKey);
  if (entity.materials) bytes += entity.materials->size() * sizeof(MaterialId);
  if (entity.skin) bytes += entity.skin->joints.size() * (sizeof(EntityId) + sizeof(mat4x3));
  if (entity.morph_weights)
    bytes += entity.morph_weights->times.size() * sizeof(Time) +
             entity.morph_weights->weights.size() * sizeof(float);
  return bytes > kFewBytes ? bytes : 0;
}

/// Returns true when a patch may change bytes_of() its entity.
bool has_size(const PutEntity& patch) {
  return patch.attributes || patch.pose || patch.materials || patch.skin || patch.morph_weights;
}

/// Returns the bytes of row chunks that `now` no longer shares: the earlier revision keeps them.
template <class Rows>
u64 replaced(const Rows& before, const Rows& now, u64 rows, u64 row_bytes) {
  constexpr u64 kRows = ChunkedArray<Entity>::kRows;
  u64 bytes = 0;
  for (u32 c = 0; c < before.chunk_count(); ++c)
    if (!before.shares(c, now)) bytes += std::min(kRows, rows - c * kRows) * row_bytes;
  return bytes;
}

u64 replaced(const Snapshot& before, const Snapshot& now) {
  return replaced(before.entities, now.entities, before.entities.capacity(), sizeof(Entity)) +
         replaced(before.poses, now.poses, before.poses.size(), sizeof(mat4x3));
}

u64 shared_objects(const Snapshot& head) {
  return u64(head.meshes.count()) + head.materials.count() + head.textures.count() +
         head.volumes.count();
}

}  // namespace

Expected<SceneCharges> SceneCharges::take(const Ledger& ledger, const Snapshot& first) {
  auto scene = Charge::take(ledger.scenes, 1);
  if (!scene) return std::unexpected(std::move(scene).error());
  auto entities = Charge::take(ledger.entities, first.entities.count());
  if (!entities) return std::unexpected(std::move(entities).error());
  SceneCharges charges(std::move(*scene), std::move(*entities), Charge::none(ledger.bytes));
  first.entities.for_each([&](u32 slot, const Entity& entity) {
    charges.set_size(first.entity_id(slot).value, bytes_of(entity));
  });
  HELIO_TRY(charges.bytes_.resize(charges.bytes(first)));
  return charges;
}

SceneCharges::Change SceneCharges::change_of(const Transaction& transaction,
                                             const Prepared& prepared) {
  Change change;
  const auto measure = [&](Id id) {
    if (const Entity* entity = prepared.snapshot->find(EntityId(id)))
      change.sizes.emplace_back(id.value, bytes_of(*entity));
  };
  std::size_t further = transaction.edits.size();
  for (std::size_t i = 0; i < transaction.edits.size(); ++i) {
    const Edit& edit = transaction.edits[i];
    const u32 count = prepared.counts[i];
    if (const auto* put = std::get_if<PutEntity>(&edit.action)) {
      const auto* name = std::get_if<std::string>(&edit.target);
      if (has_size(*put) || (name && name->size() > kFewBytes)) measure(prepared.ids[i]);
    } else if (const auto* many = std::get_if<Instances>(&edit.action)) {
      for (u32 k = 0; has_size(many->prototype) && k < count; ++k)
        measure(prepared.ids[further + k]);
    } else if (std::holds_alternative<Instantiate>(edit.action)) {
      for (u32 k = 0; k < count; ++k)
        if (prepared.ids[further + k].kind() == Kind::kEntity) measure(prepared.ids[further + k]);
    }
    change.has_removed |= std::holds_alternative<Remove>(edit.action);
    further += count;
  }
  std::ranges::sort(change.sizes);  // entries of one entity are equal
  const auto doubles = std::ranges::unique(change.sizes);
  change.sizes.erase(doubles.begin(), doubles.end());
  return change;
}

u64 SceneCharges::bytes(const Snapshot& head) const {
  return kEntityBytes * head.entities.count() + kSharedBytes * shared_objects(head) + size_ +
         kept_bytes_;
}

void SceneCharges::set_size(u64 entity, u64 size) {
  const auto found = sizes_.find(entity);
  if (found == sizes_.end() && size == 0) return;
  if (found != sizes_.end()) size_ -= found->second;
  size_ += size;
  if (size == 0)
    sizes_.erase(found);
  else
    sizes_[entity] = size;
}

/// Forgets removed entities; returns their bytes.
u64 SceneCharges::forget_removed(const Snapshot& head) {
  const u64 before = size_;
  std::erase_if(sizes_, [&](const auto& entry) {
    if (head.find(EntityId(Id{entry.first})) != nullptr) return false;
    size_ -= entry.second;
    return true;
  });
  return before - size_;
}

Status SceneCharges::add(const Snapshot& before, const Transaction& transaction,
                         const Prepared& prepared) {
  const Snapshot& head = *prepared.snapshot;
  const Change change = change_of(transaction, prepared);
  const u64 entities = entities_.amount(), count = head.entities.count();
  u64 kept = replaced(before, head), after = size_;
  if (count < entities) kept += kEntityBytes * (entities - count);
  for (const auto& [entity, size] : change.sizes) {
    const auto found = sizes_.find(entity);
    const u64 old = found == sizes_.end() ? 0 : found->second;
    after += size - old;
    kept += old;
  }
  HELIO_TRY(entities_.resize(count));
  if (auto room = bytes_.resize(bytes(head) - size_ + after + kept); !room) {
    [[maybe_unused]] const auto was_there = entities_.resize(entities);
    return room;
  }
  for (const auto& [entity, size] : change.sizes) set_size(entity, size);
  if (change.has_removed) kept += forget_removed(head);
  kept_.push_back({.by = head.revision, .bytes = kept});
  kept_bytes_ += kept;
  return {};
}

void SceneCharges::drop(Revision first, const Snapshot& last) {
  while (!kept_.empty() && kept_.back().by >= first) {
    kept_bytes_ -= kept_.back().bytes;
    kept_.pop_back();
  }
  forget_removed(last);
  // Less than was charged: gives some back, or charges entities that came back.
  [[maybe_unused]] const auto entities = entities_.resize(last.entities.count());
  [[maybe_unused]] const auto room = bytes_.resize(bytes(last));
}

void SceneCharges::forget(Revision last) {
  const u64 before = kept_bytes_;
  while (!kept_.empty() && kept_.front().by <= last + 1) {
    kept_bytes_ -= kept_.front().bytes;
    kept_.pop_front();
  }
  [[maybe_unused]] const auto room = bytes_.resize(bytes_.amount() - (before - kept_bytes_));
}

}  // namespace heliograph::server
