// Reads one field of one object. Called by read.cpp.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/snapshot.h"
#include "server/convert/bounds.h"

namespace heliograph::server {

/// An object, or an array and its bytes.
struct Answer {
  std::optional<v1::Edit> object;
  v1::Array array;
  BufferPtr bytes;
};

/// The fields of one snapshot's objects. Thread: one at a time.
class FieldReader {
 public:
  explicit FieldReader(const Snapshot& snapshot) : snapshot_(snapshot) {}

  /// Returns every name that read() accepts.
  [[nodiscard]] static std::vector<std::string> names();
  /// Reads a field; nullopt: the object has none. INVALID_ARGUMENT: its kind never has it.
  [[nodiscard]] Expected<std::optional<Answer>> read(Id id, const std::string& name);

 private:
  [[nodiscard]] Expected<std::optional<Answer>> read_entity(Id id, const std::string& name);
  [[nodiscard]] Expected<std::optional<Answer>> read_noun(Id id, const std::string& name);

  const Snapshot& snapshot_;
  std::optional<WorldBoxes> boxes_;
};

}  // namespace heliograph::server
