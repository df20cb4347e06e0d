// Tables of columns on their way to the wire, some rows a message. Used by Query and Tracks.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/query.h"

namespace heliograph::server {

class TableRows {
 public:
  static constexpr u64 kBytes = 1u << 20;

  /// Columns of numbers, with equally many rows each.
  explicit TableRows(QueryResult columns);
  /// The next rows, of about kBytes; false: there are none. A table without rows has one message.
  [[nodiscard]] bool next(google::protobuf::RepeatedPtrField<v1::LabelColumn>& out);

 private:
  QueryResult columns_;
  u64 rows_ = 0;
  u64 step_ = 1;  // rows of a message
  u64 next_ = 0;
  bool is_begun_ = false;
};

}  // namespace heliograph::server
