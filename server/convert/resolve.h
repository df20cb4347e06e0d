// Resolves references of a request in a snapshot, and enums that requests share. Called by render,
// query and read.
#pragma once

#include "heliograph/v1/types.pb.h"
#include "renderer/scene/snapshot.h"

namespace heliograph::server {

/// Returns the live object that a Ref names; kNone: a name may be of any kind, entities first.
/// NOT_FOUND with the nearest names; INVALID_ARGUMENT for an empty Ref, and for created_by_edit,
/// which has no meaning outside a transaction.
[[nodiscard]] Expected<Id> resolve(const v1::Ref& ref, const Snapshot& snapshot,
                                   Kind kind = Kind::kNone);
/// The same; INVALID_ARGUMENT unless it is an entity.
[[nodiscard]] Expected<EntityId> resolve_entity(const v1::Ref& ref, const Snapshot& snapshot);
/// The same; INVALID_ARGUMENT unless the entity has a camera.
[[nodiscard]] Expected<EntityId> resolve_camera(const v1::Ref& ref, const Snapshot& snapshot);
[[nodiscard]] Expected<std::vector<EntityId>> resolve_entities(
    const google::protobuf::RepeatedPtrField<v1::Ref>& refs, const Snapshot& snapshot);

/// Returns "mesh 'chair'", or "mesh 3" without a name.
[[nodiscard]] std::string object_text(Id id, const Snapshot& snapshot);

}  // namespace heliograph::server
