// See table_rows.h.
#include "server/convert/table_rows.h"

#include <algorithm>

#include "server/convert/frame.h"

namespace heliograph::server {

TableRows::TableRows(QueryResult columns) : columns_(std::move(columns)) {
  if (columns_.empty()) return;
  rows_ = columns_.front().shape.front();
  u64 bytes = 0;
  for (const Column& column : columns_) bytes += column.data.size();
  if (rows_ > 0) step_ = std::clamp<u64>(kBytes / std::max<u64>(bytes / rows_, 1), 1, rows_);
}

bool TableRows::next(google::protobuf::RepeatedPtrField<v1::LabelColumn>& out) {
  if (is_begun_ && next_ >= rows_) return false;
  is_begun_ = true;
  const u64 count = std::min(step_, rows_ - next_);
  for (const Column& column : columns_) {
    const u64 row = rows_ == 0 ? 0 : column.data.size() / rows_;
    v1::LabelColumn& part = *out.Add();
    part.set_name(column.name);
    part.set_dtype(to_proto(column.dtype));
    part.mutable_shape()->Add(column.shape.begin(), column.shape.end());
    part.set_shape(0, count);
    part.set_data(column.data.data() + next_ * row, count * row);
  }
  next_ += count;
  return true;
}

}  // namespace heliograph::server
