// Resolving references and names, and counting who uses what. Called by all actions of apply().
#include <fmt/format.h>

#include "renderer/scene/draft.h"

namespace heliograph {

std::string describe_object(const Snapshot& snapshot, Id id) {
  const std::string name = snapshot.name_of(id);
  return name.empty() ? fmt::format("{} {}", kind_name(id.kind()), id.value)
                      : fmt::format("{} '{}'", kind_name(id.kind()), name);
}

// ---------------------------------------------------------------- references

namespace {

Expected<Id> created_by(std::span<const Id> created, u32 edit) {
  if (edit >= created.size())
    return fail(Code::kInvalidArgument, "created_by_edit",
                fmt::format("edit {} is not an earlier edit of this transaction", edit));
  if (!created[edit])
    return fail(Code::kInvalidArgument, "created_by_edit",
                fmt::format("edit {} has no object of its own; name the one that is meant", edit));
  return created[edit];
}

std::unexpected<Error> stale(Id id) {
  return fail(Code::kNotFound, "",
              fmt::format("{} {} is not in the scene: it was removed, or never was",
                          kind_name(id.kind()), id.value));
}

}  // namespace

Expected<Id> Scope::resolve(const Ref& ref, Kind kind) const {
  Expected<Id> id;
  if (const auto* by_id = std::get_if<Id>(&ref)) id = *by_id;
  if (const auto* name = std::get_if<std::string>(&ref)) id = scene_.find(*name, kind);
  if (const auto* by_edit = std::get_if<CreatedByEdit>(&ref))
    id = created_by(created_, by_edit->edit);
  if (!id || !*id) return id;
  if (names_ == Names::kRefused && !std::holds_alternative<CreatedByEdit>(ref))
    return fail(Code::kInvalidArgument, "", "an asset refers to its own edits only");
  if (!scene_.alive(*id)) return stale(*id);
  return id;
}

Expected<Id> Scope::resolve_kind(const Ref& ref, Kind kind) const {
  auto id = resolve(ref, kind);
  if (id && *id && id->kind() != kind)
    return fail(
        Code::kInvalidArgument, "",
        fmt::format("{} is not of the kind {}", describe_object(scene_, *id), kind_name(kind)));
  return id;
}

Expected<Target> find_target(const Draft& draft, const Edit& edit, Kind kind) {
  const auto* name = std::get_if<std::string>(&edit.target);
  if (std::holds_alternative<std::monostate>(edit.target)) {
    if (edit.mode != Mode::kUpdate) return Target{};
    return fail(Code::kInvalidArgument, "target", "mode UPDATE needs a target");
  }
  if (name && (edit.mode == Mode::kCreate || !draft.next.names.find(*name, kind))) {
    if (edit.mode != Mode::kUpdate) {
      auto fresh = new_name(draft, edit, kind);
      if (!fresh) return std::unexpected(std::move(fresh).error());
      return Target{.id = {}, .name = std::move(*fresh)};
    }
  }
  auto id = Scope(draft.next, draft.created).resolve(edit.target, kind);
  if (!id) return std::unexpected(std::move(id).error().at("target"));
  if (!*id)
    return fail(Code::kInvalidArgument, "target",
                "id 0 is nothing; leave the target out to create an object without a name");
  const std::string object = describe_object(draft.next, *id);
  if (edit.mode == Mode::kCreate)
    return fail(Code::kAlreadyExists, "target", fmt::format("{} already exists", object));
  if (id->kind() != kind)
    return fail(Code::kInvalidArgument, "target",
                fmt::format("{} is not of the kind {}", object, kind_name(kind)));
  return Target{.id = *id, .name = {}};
}

Expected<std::string> new_name(const Draft& draft, const Edit& edit, Kind kind) {
  if (std::holds_alternative<std::monostate>(edit.target)) return std::string();
  const auto* name = std::get_if<std::string>(&edit.target);
  if (!name)
    return fail(Code::kInvalidArgument, "target", "this creates objects: give a new name, no id");
  if (name->empty())
    return fail(Code::kInvalidArgument, "target",
                "a name has at least one character; leave it out for an object without a name");
  if (name->size() > kMostNameBytes)
    return fail(
        Code::kInvalidArgument, "target",
        fmt::format("a name of {} bytes; name it in at most {}", name->size(), kMostNameBytes));
  if (const Id* id = draft.next.names.find(*name, kind))
    return fail(Code::kAlreadyExists, "target",
                fmt::format("{} already exists", describe_object(draft.next, *id)));
  return *name;
}

std::string free_name(const Draft& draft, const std::string& name) {
  std::string candidate = name;
  for (u32 k = 2; draft.next.names.find(candidate); ++k) candidate = fmt::format("{}~{}", name, k);
  return candidate;
}

// ---------------------------------------------------------------- counts

namespace {

void add_uses(Snapshot& scene, Id id, u32 change) {
  switch (id.kind()) {
    case Kind::kMesh:
      scene.meshes.write(id.index()).uses += change;
      break;
    case Kind::kMaterial:
      scene.materials.write(id.index()).uses += change;
      break;
    case Kind::kTexture:
      scene.textures.write(id.index()).uses += change;
      break;
    case Kind::kVolume:
      scene.volumes.write(id.index()).uses += change;
      break;
    case Kind::kEntity:
    case Kind::kNone:
      break;
  }
}

void move_use(Snapshot& scene, Id before, Id after) {
  if (before == after) return;
  add_uses(scene, before, -1u);
  add_uses(scene, after, 1);
}

void add_uses_of_all(Snapshot& scene, const Entity& entity, u32 change) {
  if (entity.materials)
    for (const MaterialId id : *entity.materials) add_uses(scene, id, change);
}

void add_skins(Snapshot& scene, const Entity& entity, u32 change) {
  if (entity.skin)
    for (const EntityId joint : entity.skin->joints)
      scene.entities.write(joint.index()).skins += change;
}

TextureId texture_of(const Entity& entity) {
  return entity.light ? entity.light->texture.texture : TextureId();
}
TextureId profile_of(const Entity& entity) {
  return entity.light ? entity.light->profile : TextureId();
}

u32 own_label(const Entity& entity) { return entity.label.set ? entity.label.value : 0; }

void add_label(Snapshot& scene, u32 value, u32 change) {
  if (value == 0) return;
  const u32* present = scene.labels.find(value);
  const u32 entities = (present ? *present : 0) + change;
  if (entities == 0)
    scene.labels.erase(value);
  else
    scene.labels.set(value, entities);
}

/// A label is doubtful when it comes to an entity without a group, leaves one, or when the subtree
/// leaves an ancestor that states it.
void doubt_labels(Draft& draft, const Entity& before, const Entity& after) {
  const auto doubt = [&](u32 value) {
    const u32* entities = value ? draft.next.labels.find(value) : nullptr;
    if (entities && *entities > 1) draft.doubtful_labels.emplace_back(value, draft.edit());
  };
  if (before.label != after.label) {
    if (!after.label.group) doubt(own_label(after));
    if (own_label(before) != own_label(after)) doubt(own_label(before));
  }
  if (before.parent == after.parent) return;
  const Entity* ancestor = draft.next.find(before.parent);
  for (; ancestor; ancestor = draft.next.find(ancestor->parent)) doubt(own_label(*ancestor));
}

}  // namespace

void count(Draft& draft, const Entity& before, const Entity& after) {
  Snapshot& scene = draft.next;
  if (before.parent != after.parent) {
    if (before.parent) --scene.entities.write(before.parent.index()).children;
    if (after.parent) ++scene.entities.write(after.parent.index()).children;
  }
  move_use(scene, before.mesh, after.mesh);
  move_use(scene, before.volume, after.volume);
  move_use(scene, texture_of(before), texture_of(after));
  move_use(scene, profile_of(before), profile_of(after));
  if (before.materials != after.materials) {
    add_uses_of_all(scene, before, -1u);
    add_uses_of_all(scene, after, 1);
  }
  if (before.skin != after.skin) {
    add_skins(scene, before, -1u);
    add_skins(scene, after, 1);
  }
  scene.array_bound += bytes_of(after) - bytes_of(before);
  scene.keyed += u32(after.keys != nullptr) - u32(before.keys != nullptr);
  if (own_label(before) != own_label(after)) {
    add_label(scene, own_label(before), -1u);
    add_label(scene, own_label(after), 1);
  }
  doubt_labels(draft, before, after);
}

void count(Draft& draft, const Material& before, const Material& after) {
  for (std::size_t p = 0; p < kMaterialParameters; ++p)
    move_use(draft.next, before.parameters[p].texture.texture, after.parameters[p].texture.texture);
#define HELIO_MAP(name) move_use(draft.next, before.name.texture, after.name.texture);
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
}

void count(Draft& draft, const Dome& before, const Dome& after) {
  move_use(draft.next, before.texture, after.texture);
}

}  // namespace heliograph
