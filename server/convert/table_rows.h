// Splits tables of columns into messages of some rows each. Used by Query and Tracks.
#pragma once

#include "heliograph/v1/render.pb.h"
#include "renderer/frame/query.h"

namespace heliograph::server {

class TableRows {
 public:
  static constexpr u64 kBytes = 1u << 20;

  /// columns   of numbers, with equally many rows
  explicit TableRows(QueryResult columns);
  /// Fills the next rows, of about kBytes; false: none left. A table without rows gives one
  /// message.
  [[nodiscard]] bool next(google::protobuf::RepeatedPtrField<v1::LabelColumn>& out);

 private:
  QueryResult columns_;
  u64 rows_ = 0;
  u64 step_ = 1;  // rows per message
  u64 next_ = 0;
  bool is_begun_ = false;
};

}  // namespace heliograph::server
