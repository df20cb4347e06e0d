// Arrays and columns to the wire and back. Used by edits, queries and reads.
#pragma once

#include <string>

#include "heliograph/array.h"
#include "heliograph/ref.h"
#include "heliograph/v1/service.pb.h"

namespace heliograph::client::wire {

constexpr std::size_t kInlineBytes = 1 << 20;

/// dtype and shape, without the bytes.
void describe(const Array& array, v1::Array* out);
/// Puts the array with its bytes into a message.
void put_inline(const Array& array, v1::Array* out);
/// A copy of the inline bytes.
Array array_of(const v1::Array& message);
Array array_of(v1::DType dtype, Shape shape, const std::string& bytes);
/// Memory that is not initialised, to be filled before it is shared.
Array empty_array(DType dtype, Shape shape);
std::byte* writable(const Array& array);

Columns columns_of(const google::protobuf::RepeatedPtrField<v1::LabelColumn>& columns);

/// f32 of f32 or f64; any other dtype is kInvalidArgument at `field`.
Array as_f32(const Array& array, const std::string& field);
/// kInvalidArgument at `field` unless the shape is (N,) + inner.
void check_rows(const Array& array, const Shape& inner, const std::string& field);
/// Rows [first, last).
Array rows_of(const Array& array, std::size_t first, std::size_t last);

template <class M>
M matrix_of(const Array& array) {
  M out;
  const auto values = as_f32(array, "matrix").template view<float>();
  for (std::size_t i = 0; i < values.size(); ++i)
    out.rows[i / out.rows[0].size()][i % out.rows[0].size()] = values[i];
  return out;
}

}  // namespace heliograph::client::wire
