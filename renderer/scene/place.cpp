// Copies of a prototype. Called by apply().
#include <fmt/format.h>

#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

std::string instance_name(const std::string& name, std::size_t k) {
  return name.empty() ? std::string() : fmt::format("{}/{}", name, k);
}

/// One more entity like `prototype`; a label of its own unless the value was given.
Expected<EntityId> copy(Draft& draft, const std::string& name, Entity row, bool fresh_label) {
  if (fresh_label) set_auto_label(draft, row);
  row.children = 0;
  row.skins = 0;
  return create_entity(draft, name, row);
}

}  // namespace

Status place(Draft& draft, const Scope& scope, const std::string& name, const Instances& action) {
  const PutEntity& prototype = action.prototype;
  if (prototype.pose)
    return fail(Code::kInvalidArgument, "prototype.pose", "the matrices are the poses");
  if (action.matrices.empty()) return {};
  const bool given = prototype.label && prototype.label->kind == LabelPatch::Kind::kValue;
  EntityId first;
  for (std::size_t k = 0; k < action.matrices.size(); ++k) {
    const Edit named{.mode = Mode::kCreate,
                     .target = name.empty() ? Ref() : Ref(instance_name(name, k)),
                     .action = {}};
    auto fresh = new_name(draft, named, Kind::kEntity);
    if (!fresh) return std::unexpected(std::move(fresh).error());
    EntityId id;
    if (k == 0) {
      auto created = put(draft, scope, Target{.id = {}, .name = *fresh}, prototype);
      if (!created) return std::unexpected(std::move(created).error().at("prototype"));
      id = first = EntityId(*created);
    } else {
      const Entity& row = *draft.next.find(first);
      auto created = copy(draft, *fresh, row, row.label.set && !given);
      if (!created) return std::unexpected(std::move(created).error());
      id = *created;
    }
    set_pose(draft, id, action.matrices[k]);
    draft.further.push_back(id);
  }
  return {};
}

}  // namespace heliograph
