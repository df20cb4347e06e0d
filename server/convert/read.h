// Read: any component or array of a snapshot, in pieces. Called by Read.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/v1/service.pb.h"
#include "renderer/scene/snapshot.h"
#include "server/convert/read_fields.h"

namespace heliograph::server {

/// The replies to one ReadRequest, made one at a time. docs/protocol.md lists the fields.
///
/// Reads an immutable snapshot. Fields that an object does not have are left out. Thread: one at a
/// time.
class Reading {
 public:
  /// Checks a request. INVALID_ARGUMENT (a field that does not exist), NOT_FOUND, UNIMPLEMENTED.
  [[nodiscard]] static Expected<Reading> create(const v1::ReadRequest& request,
                                                std::shared_ptr<const Snapshot> snapshot);

  /// Fills the next reply; false when there is none. INVALID_ARGUMENT: a field that the object's
  /// kind does not have.
  [[nodiscard]] Expected<bool> next(v1::ReadReply& reply);

 private:
  Reading(const v1::ReadRequest& request, std::shared_ptr<const Snapshot> snapshot)
      : snapshot_(std::move(snapshot)),
        reader_(*snapshot_),
        fields_(request.fields().begin(), request.fields().end()) {}
  [[nodiscard]] Status read_answer();  // reads the next existing field
  void fill(v1::ReadReply& reply);     // from answer_

  std::shared_ptr<const Snapshot> snapshot_;
  FieldReader reader_;
  std::vector<std::string> fields_;
  std::vector<Id> ids_;
  std::size_t next_ = 0;  // index into the product of ids_ and fields_
  std::optional<Answer> answer_;
  u32 ref_ = 0, field_ = 0;  // of answer_
  u64 offset_ = 0;           // sent bytes of answer_
};

}  // namespace heliograph::server
