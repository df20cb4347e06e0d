// Placing a decoded asset: its library once a scene, its entities each time. Called by apply().
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

constexpr auto kNames = Scope::Names::kRefused;

struct IsPut {
  Draft& draft;
  const Scope& scope;
  const Target& target;

  Expected<Id> operator()(const PutEntity& patch) const { return put(draft, scope, target, patch); }
  Expected<Id> operator()(const PutMesh& patch) const { return put(draft, scope, target, patch); }
  Expected<Id> operator()(const PutMaterial& patch) const {
    return put(draft, scope, target, patch);
  }
  Expected<Id> operator()(const PutTexture& patch) const {
    return put(draft, scope, target, patch);
  }
  Expected<Id> operator()(const PutVolume& patch) const { return put(draft, scope, target, patch); }
  template <class T>
  Expected<Id> operator()(const T&) const {
    return fail(Code::kInvalidArgument, "", "an asset consists of puts only");
  }
};

Kind kind_of(const Action& action) {
  if (std::holds_alternative<PutEntity>(action)) return Kind::kEntity;
  if (std::holds_alternative<PutMesh>(action)) return Kind::kMesh;
  if (std::holds_alternative<PutMaterial>(action)) return Kind::kMaterial;
  if (std::holds_alternative<PutTexture>(action)) return Kind::kTexture;
  if (std::holds_alternative<PutVolume>(action)) return Kind::kVolume;
  return Kind::kNone;
}

std::string own_name(const Edit& edit) {
  const auto* name = std::get_if<std::string>(&edit.target);
  return name ? *name : std::string();
}

/// "prefix/name" while it is free; "" when either is missing.
std::string name_beneath(const Draft& draft, const std::string& prefix, const Edit& edit) {
  const std::string name = own_name(edit);
  if (prefix.empty() || name.empty()) return {};
  return free_name(draft, prefix + "/" + name);
}

/// Puts one edit of an asset; errors point into the asset.
Expected<Id> put_part(Draft& draft, std::span<const Id> created, const Target& target,
                      const Edit& edit) {
  const Scope scope(draft.next, created, kNames);
  return std::visit(IsPut{draft, scope, target}, edit.action);
}

std::unexpected<Error> in_asset(Error error, std::string_view list, std::size_t k) {
  return std::unexpected(std::move(error).at(fmt::format("asset.{}[{}]", list, k)));
}

// ---------------------------------------------------------------- the library

/// The asset's shared objects: those an earlier instance made, as long as they are alive.
Expected<Library> library(Draft& draft, const Asset& asset) {
  const std::shared_ptr<const Library>* kept =
      asset.hash.empty() ? nullptr : draft.next.libraries.find(asset.hash);
  const Library known = kept ? **kept : Library();
  Library ids;
  for (std::size_t k = 0; k < asset.library.size(); ++k) {
    const Edit& edit = asset.library[k];
    if (k < known.size() && known[k].kind() == kind_of(edit.action) && draft.next.alive(known[k])) {
      ids.push_back(known[k]);
      continue;
    }
    const Target target{.id = {}, .name = name_beneath(draft, asset.name, edit)};
    auto id = put_part(draft, ids, target, edit);
    if (!id) return in_asset(std::move(id).error(), "library", k);
    ids.push_back(*id);
  }
  if (!asset.hash.empty() && ids != known)
    draft.next.libraries.set(asset.hash, std::make_shared<const Library>(ids));
  return ids;
}

/// The library as this copy's entities see it: with the materials that the caller overrides.
Expected<Library> with_overrides(const Scope& scope, const Instantiate& action, Library ids) {
  const Asset& asset = *action.asset;
  for (const auto& [name, ref] : action.materials) {
    const std::string field = fmt::format("materials['{}']", name);
    MaterialId material;
    HELIO_TRY(scope.bind(ref, field, material));
    bool found = false;
    std::vector<std::string> names;
    for (std::size_t k = 0; k < asset.library.size(); ++k) {
      if (kind_of(asset.library[k].action) != Kind::kMaterial) continue;
      names.push_back(own_name(asset.library[k]));
      if (names.back() != name) continue;
      ids[k] = material;
      found = true;
    }
    if (found) continue;
    Error error{.code = Code::kNotFound,
                .message = fmt::format("the asset's materials are '{}'", fmt::join(names, "', '")),
                .where = field};
    error.nearest = std::move(names);
    return std::unexpected(std::move(error));
  }
  return ids;
}

// ---------------------------------------------------------------- the entities

/// Creates the entities; `ids` holds the library and is continued by them.
Status create_entities(Draft& draft, const Asset& asset, const std::string& root, Library& ids) {
  const std::size_t first = ids.size();
  for (std::size_t k = 0; k < asset.entities.size(); ++k) {
    const auto* patch = std::get_if<PutEntity>(&asset.entities[k].action);
    if (!patch)
      return in_asset({.code = Code::kInvalidArgument, .message = "not an entity", .where = {}},
                      "entities", k);
    const Target target{.id = {},
                        .name = k == 0 ? root : name_beneath(draft, root, asset.entities[k])};
    Edit edit{.target = {}, .action = *patch};
    auto& beneath = std::get<PutEntity>(edit.action);
    if (k == 0) {
      beneath.parent = std::nullopt;
      if (!beneath.label) beneath.label = LabelPatch{.kind = LabelPatch::Kind::kAuto};
    } else if (!beneath.parent) {
      beneath.parent = CreatedByEdit{u32(first)};
    }
    auto id = put_part(draft, ids, target, edit);
    if (!id) return in_asset(std::move(id).error(), "entities", k);
    ids.push_back(*id);
  }
  return {};
}

Status bind_animation(Draft& draft, const Instantiate& action, std::span<const Id> entities) {
  if (!action.animation) return {};
  const auto& animations = action.asset->animations;
  if (*action.animation >= animations.size())
    return fail(Code::kInvalidArgument, "animation",
                fmt::format("the asset has {} animations, counted from 0", animations.size()));
  const Scope scope(draft.next, {}, kNames);
  for (const Asset::Channel& channel : animations[*action.animation].channels) {
    if (channel.entity >= entities.size())
      return fail(Code::kInvalidArgument, "asset.animations", "a channel moves no entity of it");
    PutEntity patch;
    if (const auto* pose = std::get_if<PosePatch>(&channel.keys)) patch.pose = *pose;
    if (const auto* weights = std::get_if<MorphWeights>(&channel.keys))
      patch.morph_weights.emplace(*weights);
    auto id = put(draft, scope, Target{.id = entities[channel.entity], .name = {}}, patch);
    if (!id) return std::unexpected(std::move(id).error().at("asset.animations"));
  }
  return {};
}

/// Applies the caller's values to the root; its label is automatic unless a value is given.
Status override_root(Draft& draft, const Scope& scope, const Instantiate& action, Id root) {
  PutEntity patch{.parent = action.parent, .pose = action.pose, .label = action.label};
  auto id = put(draft, scope, Target{.id = root, .name = {}}, patch);
  if (!id) return std::unexpected(std::move(id).error());
  Entity entity = *draft.next.find(EntityId(root));
  if (!entity.label.set) set_auto_label(draft, entity);
  store(draft, EntityId(root), entity);
  return {};
}

}  // namespace

Expected<Id> instantiate(Draft& draft, const Scope& scope, const std::string& name,
                         const Instantiate& action) {
  if (!action.asset || action.asset->entities.empty())
    return fail(Code::kInvalidArgument, "asset", "the asset has no entities");
  const Asset& asset = *action.asset;
  auto shared = library(draft, asset);
  if (!shared) return std::unexpected(std::move(shared).error());
  auto ids = with_overrides(scope, action, *shared);
  if (!ids) return std::unexpected(std::move(ids).error());
  HELIO_TRY(create_entities(draft, asset, name, *ids));
  const auto entities = std::span(*ids).subspan(shared->size());
  HELIO_TRY(bind_animation(draft, action, entities));
  HELIO_TRY(override_root(draft, scope, action, entities[0]));
  draft.further.insert(draft.further.end(), entities.begin() + 1, entities.end());
  draft.further.insert(draft.further.end(), shared->begin(), shared->end());
  return entities[0];
}

}  // namespace heliograph
