// Read: fields of objects. Called by handles and scenes.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "wire/draft.h"

namespace heliograph::client::wire {

/// Answer to a field: an array, or the object as an edit, or neither.
struct Found {
  std::optional<Array> array{};
  std::optional<v1::Edit> object{};
};

/// Reads a field: one answer per thing. Arrays above 1 MiB come in pieces.
std::vector<Found> read(const SceneCore& scene, const std::vector<Ref>& things,
                        const std::string& field);
/// Reads a field of one object.
Found read(const Handle& handle, const std::string& field);

}  // namespace heliograph::client::wire
