// Looking up what a request refers to.
#include "server/convert/resolve.h"

#include <fmt/format.h>

#include "server/convert/fields.h"

namespace heliograph::server {
std::string object_text(Id id, const Snapshot& snapshot) {
  const std::string name = snapshot.name_of(id);
  return name.empty() ? fmt::format("{} {}", kind_name(id.kind()), id.value)
                      : fmt::format("{} '{}'", kind_name(id.kind()), name);
}

Expected<Id> resolve(const v1::Ref& message, const Snapshot& snapshot, Kind kind) {
  auto ref = to_ref(message);
  if (!ref) return std::unexpected(std::move(ref).error());
  if (const auto* name = std::get_if<std::string>(&*ref)) return snapshot.find(*name, kind);
  if (std::holds_alternative<CreatedByEdit>(*ref))
    return fail(Code::kInvalidArgument, "created_by_edit",
                "has a meaning only within a transaction; give the object's id or name");
  const Id* id = std::get_if<Id>(&*ref);
  if (!id) return fail(Code::kInvalidArgument, "id", "is 0, which is nothing; name an object");
  if (snapshot.alive(*id)) return *id;
  return fail(Code::kNotFound, "id",
              fmt::format("there is no object {} in revision {}; it was removed, or the id is of "
                          "another scene",
                          id->value, snapshot.revision));
}

Expected<EntityId> resolve_entity(const v1::Ref& ref, const Snapshot& snapshot) {
  auto id = resolve(ref, snapshot, Kind::kEntity);
  if (!id) return std::unexpected(std::move(id).error());
  if (id->kind() == Kind::kEntity) return EntityId(*id);
  return fail(Code::kInvalidArgument, "",
              fmt::format("is the {}; name an entity", object_text(*id, snapshot)));
}

Expected<EntityId> resolve_camera(const v1::Ref& ref, const Snapshot& snapshot) {
  auto id = resolve_entity(ref, snapshot);
  if (!id || snapshot.find(*id)->camera) return id;
  return fail(Code::kInvalidArgument, "",
              fmt::format("the {} has no camera; put one into it, or name another",
                          object_text(*id, snapshot)));
}

Expected<std::vector<EntityId>> resolve_entities(
    const google::protobuf::RepeatedPtrField<v1::Ref>& refs, const Snapshot& snapshot) {
  std::vector<EntityId> ids(std::size_t(refs.size()));
  for (int i = 0; i < refs.size(); ++i)
    HELIO_TAKE(ids[std::size_t(i)], resolve_entity(refs[i], snapshot), indexed("", u64(i)));
  return ids;
}

}  // namespace heliograph::server
