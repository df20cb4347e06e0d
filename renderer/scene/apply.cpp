// Carrying out a transaction: each edit in order on a copy, all or nothing. Called by Scene and for
// overlays.
#include <fmt/format.h>

#include "renderer/scene/draft.h"

namespace heliograph {
namespace {

template <class... F>
struct Overloaded : F... {
  using F::operator()...;
};

/// The path of an error inside the message of an action.
Expected<Id> at(Expected<Id> result, std::string_view message) {
  if (result || result.error().where == "target") return result;
  return std::unexpected(std::move(result).error().at(std::string(message)));
}
Expected<Id> at(Status status, std::string_view message) {
  if (status) return Id{};
  return std::unexpected(std::move(status).error().at(std::string(message)));
}

Status no_target(const Edit& edit) {
  if (std::holds_alternative<std::monostate>(edit.target)) return {};
  return fail(Code::kInvalidArgument, "target", "this action has no target; leave it out");
}

template <class Put>
Expected<Id> put_target(Draft& draft, const Edit& edit, Kind kind, const Put& patch) {
  auto target = find_target(draft, edit, kind);
  if (!target) return std::unexpected(std::move(target).error());
  auto id = put(draft, Scope(draft.next, draft.created), *target, patch);
  return at(std::move(id), kind_name(kind));
}

Expected<Id> remove_target(Draft& draft, const Edit& edit, const Remove& action) {
  if (edit.mode == Mode::kCreate)
    return fail(Code::kInvalidArgument, "mode", "a removal creates nothing");
  auto id = Scope(draft.next, draft.created).resolve(edit.target);
  if (!id) return std::unexpected(std::move(id).error().at("target"));
  if (auto status = remove(draft, *id, action.cascade); !status) {
    auto error = std::move(status).error();
    if (error.where.empty()) error.where = "remove";
    return std::unexpected(std::move(error));
  }
  return Id{};
}

/// The name under which Instantiate or Instances create.
Expected<std::string> created_name(const Draft& draft, const Edit& edit) {
  if (edit.mode == Mode::kUpdate)
    return fail(Code::kInvalidArgument, "mode", "this creates objects; UPDATE changes them");
  return new_name(draft, edit, Kind::kEntity);
}

Expected<Id> instantiate_target(Draft& draft, const Edit& edit, const Instantiate& action) {
  auto name = created_name(draft, edit);
  if (!name) return std::unexpected(std::move(name).error());
  return at(instantiate(draft, Scope(draft.next, draft.created), *name, action), "instantiate");
}

Expected<Id> place_target(Draft& draft, const Edit& edit, const Instances& action) {
  auto name = created_name(draft, edit);
  if (!name) return std::unexpected(std::move(name).error());
  auto status = place(draft, Scope(draft.next, draft.created), *name, action);
  if (!status && status.error().where == "target")
    return std::unexpected(std::move(status).error());
  return at(std::move(status), "instances");
}

Expected<Id> carry_out(Draft& draft, const Edit& edit) {
  return std::visit(
      Overloaded{
          [&](const PutEntity& a) { return put_target(draft, edit, Kind::kEntity, a); },
          [&](const PutMesh& a) { return put_target(draft, edit, Kind::kMesh, a); },
          [&](const PutMaterial& a) { return put_target(draft, edit, Kind::kMaterial, a); },
          [&](const PutTexture& a) { return put_target(draft, edit, Kind::kTexture, a); },
          [&](const PutVolume& a) { return put_target(draft, edit, Kind::kVolume, a); },
          [&](const Remove& a) { return remove_target(draft, edit, a); },
          [&](const Instantiate& a) { return instantiate_target(draft, edit, a); },
          [&](const Instances& a) { return place_target(draft, edit, a); },
          [&](const Poses& a) { return at(place(draft, a), "poses"); },
          [&](const PutSettings& a) {
            return at(put(draft, Scope(draft.next, draft.created), a), "settings");
          },
          [&](const Advance& a) { return at(advance(draft, a), "advance"); },
          [&](const Prune&) -> Expected<Id> {
            prune(draft);
            return Id{};
          },
      },
      edit.action);
}

bool takes_target(const Action& action) {
  return !(std::holds_alternative<Poses>(action) || std::holds_alternative<PutSettings>(action) ||
           std::holds_alternative<Advance>(action) || std::holds_alternative<Prune>(action));
}

}  // namespace

Expected<Prepared> apply(const Snapshot& base, const Transaction& transaction,
                         const SceneLimits& limits) {
  Draft draft{.limits = limits, .next = base};
  draft.next.revision = base.revision + 1;
  for (std::size_t k = 0; k < transaction.edits.size(); ++k) {
    const Edit& edit = transaction.edits[k];
    const std::size_t further = draft.further.size();
    Expected<Id> id;
    if (auto status = no_target(edit); !status && !takes_target(edit.action))
      id = std::unexpected(std::move(status).error());
    else
      id = carry_out(draft, edit);
    if (!id) return std::unexpected(std::move(id).error().at(fmt::format("edits[{}]", k)));
    draft.created.push_back(*id);
    draft.counts.push_back(u32(draft.further.size() - further));
  }
  HELIO_TRY(check_labels(draft, transaction));
  HELIO_TRY(check_memory(draft));
  std::vector<Id> ids = std::move(draft.created);
  ids.insert(ids.end(), draft.further.begin(), draft.further.end());
  return Prepared{.snapshot = std::make_shared<const Snapshot>(std::move(draft.next)),
                  .ids = std::move(ids),
                  .counts = std::move(draft.counts)};
}

}  // namespace heliograph
