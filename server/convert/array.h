// v1::Array to typed arrays and back; checks dtype, shape, byte count and finiteness. Called by
// every noun of server/convert.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "heliograph/v1/types.pb.h"
#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "server/convert/transaction.h"

namespace heliograph::server {

/// A required dimension: a letter for messages, and its size unless that is free.
struct Dim {
  std::string_view name;
  std::optional<u64> size;
};
using Dims = std::vector<Dim>;
inline constexpr Dim kTwo{"", 2}, kThree{"", 3}, kFour{"", 4};

/// Bytes with checked dtype, shape and count.
struct RawArray {
  BufferPtr buffer;
  v1::DType type = v1::D_TYPE_UNSPECIFIED;
  std::vector<u64> shape;
  u64 count = 0;  // of numbers

  template <class T>
  [[nodiscard]] std::span<const T> as() const {
    return {reinterpret_cast<const T*>(buffer->bytes().data()), count};
  }
};

/// Dtypes that are read as f32 or f64.
inline constexpr std::array kFloatTypes{v1::D_TYPE_F32, v1::D_TYPE_F64};

/// Returns the bytes of one number; 0 for an unknown dtype.
[[nodiscard]] u64 dtype_size(v1::DType type);
/// Returns the shape as text, such as "(10, 3)".
[[nodiscard]] std::string shape_text(const v1::Array& array);

/// Reads an array with these dimensions and one of these dtypes; INVALID_ARGUMENT otherwise.
[[nodiscard]] Expected<RawArray> read_raw(const v1::Array& array, ArraySource& source,
                                          const Dims& dims, std::span<const v1::DType> types);
/// Returns the bytes that such an array must have, whatever its source has. INVALID_ARGUMENT as
/// read_raw().
[[nodiscard]] Expected<u64> bytes_of(const v1::Array& array, const Dims& dims,
                                     std::span<const v1::DType> types);

/// Returns the index of the first number that is NaN or infinite; `count`: none. f16, f32, f64.
[[nodiscard]] u64 first_not_finite(const RawArray& raw);
/// Returns INVALID_ARGUMENT at the element, "[17]" or "[2][17]", that contains number `index`; an
/// element has `size` numbers.
[[nodiscard]] std::unexpected<Error> bad_element(const RawArray& raw, u64 index, u64 size,
                                                 std::string message);
[[nodiscard]] Status check_finite(const RawArray& raw, u64 element_size);

/// Converts f64 to f32, and checks that all numbers are finite.
[[nodiscard]] Expected<RawArray> to_f32(RawArray raw, u64 element_size);
/// Reads an array as finite f32.
[[nodiscard]] Expected<RawArray> read_f32(const v1::Array& array, ArraySource& source,
                                          const Dims& dims, u64 element_size);
/// Reads f32 or f64 as finite f64.
[[nodiscard]] Expected<std::vector<double>> read_f64(const v1::Array& array, ArraySource& source,
                                                     const Dims& dims, u64 element_size);
/// Reads times, (K,) f32 or f64 in seconds, K >= 1, strictly increasing.
[[nodiscard]] Expected<std::vector<double>> read_times(const v1::Array& array, ArraySource& source);

/// Reads an array of float vectors, such as vec3 with dims {V, 3}.
template <class T>
[[nodiscard]] Expected<ArrayOf<T>> read_floats(const v1::Array& array, ArraySource& source,
                                               const Dims& dims) {
  constexpr u64 kFloatBytes = 4;
  auto raw = read_f32(array, source, dims, sizeof(T) / kFloatBytes);
  if (!raw) return std::unexpected(std::move(raw).error());
  return ArrayOf<T>(raw->buffer);
}

/// Reads an array of u16, u32 or u64, or of vectors of these.
template <class T>
[[nodiscard]] Expected<ArrayOf<T>> read_integers(const v1::Array& array, ArraySource& source,
                                                 const Dims& dims, v1::DType type) {
  auto raw = read_raw(array, source, dims, std::span(&type, 1));
  if (!raw) return std::unexpected(std::move(raw).error());
  return ArrayOf<T>(raw->buffer);
}

/// Checks that all numbers are below `end`. INVALID_ARGUMENT at the first element with another one.
[[nodiscard]] Status check_below(std::span<const u32> values, u32 end, u64 element_size,
                                 std::string_view what);

[[nodiscard]] v1::Array to_array(const BufferPtr& bytes, v1::DType type, std::span<const u64> shape,
                                 const ArraySink& sink);
/// Makes an array from a copy of the numbers.
[[nodiscard]] v1::Array to_array(std::vector<float> values, std::span<const u64> shape,
                                 const ArraySink& sink);
[[nodiscard]] v1::Array to_array(std::vector<double> values, std::span<const u64> shape,
                                 const ArraySink& sink);

}  // namespace heliograph::server
