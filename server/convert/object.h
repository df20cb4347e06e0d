// Describes a live object of a snapshot as the edit that would make it. Called by read.
#pragma once

#include "heliograph/v1/material.pb.h"
#include "renderer/scene/snapshot.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

/// Returns every field of a live object, defaults included; references are ids.
[[nodiscard]] Action describe_object(const Snapshot& snapshot, Id id);
/// Returns the dome, or the defaults where there is none.
[[nodiscard]] PutDome describe_dome(const Snapshot& snapshot);

/// A new material, with the values of all parameters.
[[nodiscard]] v1::Material default_material();

}  // namespace heliograph::server
