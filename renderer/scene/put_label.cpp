// Labels while editing: explicit, automatic, categories, and one label for one subtree. Called by
// the actions that put entities, and at the end of apply().
#include <fmt/format.h>

#include <algorithm>
#include <map>

#include "renderer/scene/draft.h"

namespace heliograph {

void register_category(Draft& draft, const std::string& name, u32& id) {
  id = 0;
  if (name.empty()) return;
  auto& categories = draft.next.categories;
  if (categories) {
    const auto found = std::ranges::find(*categories, name);
    id = u32(found - categories->begin()) + 1;
    if (found != categories->end()) return;
  }
  auto longer = categories ? *categories : std::vector<std::string>();
  longer.push_back(name);
  id = u32(longer.size());
  categories = std::make_shared<const std::vector<std::string>>(std::move(longer));
}

void set_auto_label(Draft& draft, Entity& entity) {
  u32& next = draft.next.next_label;
  while (next == 0 || draft.next.labels.find(next)) ++next;
  entity.label.set = true;
  entity.label.value = next++;
}

void set_label(Draft& draft, Entity& entity, const LabelPatch& patch) {
  Label& label = entity.label;
  if (patch.category) register_category(draft, *patch.category, label.category);
  if (patch.kind == LabelPatch::Kind::kInherit && patch.category) {
    if (patch.part) label.part = patch.part;
    return;
  }
  const bool alone = label.set && label.value != 0 && !label.group;
  label.group = patch.group;
  label.part = patch.part;
  switch (patch.kind) {
    case LabelPatch::Kind::kInherit:
      label = {.part = patch.part};
      break;
    case LabelPatch::Kind::kValue:
      label.set = true;
      label.value = patch.value;
      break;
    case LabelPatch::Kind::kAuto:
      if (!alone) set_auto_label(draft, entity);
      break;
  }
}

bool labelled_above(const Snapshot& snapshot, EntityId parent) {
  for (const Entity* above = snapshot.find(parent); above; above = snapshot.find(above->parent))
    if (above->label.set) return true;
  return false;
}

namespace {

bool says(const Entity& entity, u32 value) {
  return entity.label.set && entity.label.value == value;
}

bool topmost(const Snapshot& scene, const Entity& entity) {
  const Entity* above = scene.find(entity.parent);
  for (; above; above = scene.find(above->parent))
    if (says(*above, entity.label.value)) return false;
  return true;
}

std::string_view label_field(const Action& action) {
  if (std::holds_alternative<Instances>(action)) return "instances.prototype.label";
  if (std::holds_alternative<Instantiate>(action)) return "instantiate.label";
  return "entity.label";
}

}  // namespace

Status check_labels(const Draft& draft, const Transaction& transaction) {
  struct Use {
    u32 edit = 0;
    EntityId alone;  // a topmost entity that does not set `group`
  };
  std::map<u32, Use> uses;
  for (const auto& [value, edit] : draft.doubtful_labels) {
    const u32* entities = draft.next.labels.find(value);
    if (entities && *entities > 1) uses[value].edit = edit;
  }
  if (uses.empty()) return {};
  Status status;
  draft.next.entities.for_each([&](u32 index, const Entity& entity) {
    if (!status || !entity.label.set || entity.label.group) return;
    const auto use = uses.find(entity.label.value);
    if (use == uses.end() || !topmost(draft.next, entity)) return;
    const EntityId first = std::exchange(use->second.alone, draft.next.entity_id(index));
    if (!first) return;
    const u32 edit = use->second.edit;
    status = fail(Code::kInvalidArgument,
                  fmt::format("edits[{}].{}", edit, label_field(transaction.edits[edit].action)),
                  fmt::format("{} and {} both have label {}; use another label, or group",
                              describe_object(draft.next, first),
                              describe_object(draft.next, use->second.alone), use->first));
  });
  return status;
}

}  // namespace heliograph
