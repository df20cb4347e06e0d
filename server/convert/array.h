// v1::Array to typed arrays and back: dtype, shape, byte count and finiteness are checked here.
// Called by every noun of server/convert.
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

/// One dimension an array must have: a letter for messages, and its size unless that is free.
struct Dim {
  std::string_view name;
  std::optional<u64> size;
};
using Dims = std::vector<Dim>;
inline constexpr Dim kTwo{"", 2}, kThree{"", 3}, kFour{"", 4};

/// Bytes whose dtype, shape and count are right.
struct RawArray {
  BufferPtr buffer;
  v1::DType type = v1::D_TYPE_UNSPECIFIED;
  std::vector<u64> shape;
  u64 count = 0;  // numbers

  template <class T>
  [[nodiscard]] std::span<const T> as() const {
    return {reinterpret_cast<const T*>(buffer->bytes().data()), count};
  }
};

/// What is read as f32 or f64.
inline constexpr std::array kFloatTypes{v1::D_TYPE_F32, v1::D_TYPE_F64};

/// Bytes of one number; 0 for an unknown dtype.
[[nodiscard]] u64 dtype_size(v1::DType type);
/// "(10, 3)".
[[nodiscard]] std::string shape_text(const v1::Array& array);

/// INVALID_ARGUMENT unless the array has these dimensions and one of these dtypes.
[[nodiscard]] Expected<RawArray> read_raw(const v1::Array& array, ArraySource& source,
                                          const Dims& dims, std::span<const v1::DType> types);
/// How many bytes such an array has, whatever it brings. INVALID_ARGUMENT, likewise.
[[nodiscard]] Expected<u64> bytes_of(const v1::Array& array, const Dims& dims,
                                     std::span<const v1::DType> types);

/// Index of the first number that is NaN or infinite; `count` when there is none. f16, f32, f64.
[[nodiscard]] u64 first_not_finite(const RawArray& raw);
/// INVALID_ARGUMENT at the element "[17]" or "[2][17]" whose number `index` is; an element has
/// `size` numbers.
[[nodiscard]] std::unexpected<Error> bad_element(const RawArray& raw, u64 index, u64 size,
                                                 std::string message);
[[nodiscard]] Status check_finite(const RawArray& raw, u64 element_size);

/// f32 as it is, f64 converted; finite.
[[nodiscard]] Expected<RawArray> to_f32(RawArray raw, u64 element_size);
/// The same of a message.
[[nodiscard]] Expected<RawArray> read_f32(const v1::Array& array, ArraySource& source,
                                          const Dims& dims, u64 element_size);
/// f32 or f64 as f64; finite.
[[nodiscard]] Expected<std::vector<double>> read_f64(const v1::Array& array, ArraySource& source,
                                                     const Dims& dims, u64 element_size);
/// (K,) f32 or f64 seconds, strictly increasing, at least one.
[[nodiscard]] Expected<std::vector<double>> read_times(const v1::Array& array, ArraySource& source);

/// An array of float vectors, e.g. vec3 with dims {V, 3}.
template <class T>
[[nodiscard]] Expected<ArrayOf<T>> read_floats(const v1::Array& array, ArraySource& source,
                                               const Dims& dims) {
  constexpr u64 kFloatBytes = 4;
  auto raw = read_f32(array, source, dims, sizeof(T) / kFloatBytes);
  if (!raw) return std::unexpected(std::move(raw).error());
  return ArrayOf<T>(raw->buffer);
}

/// An array of u16, u32 or u64, or of vectors of these.
template <class T>
[[nodiscard]] Expected<ArrayOf<T>> read_integers(const v1::Array& array, ArraySource& source,
                                                 const Dims& dims, v1::DType type) {
  auto raw = read_raw(array, source, dims, std::span(&type, 1));
  if (!raw) return std::unexpected(std::move(raw).error());
  return ArrayOf<T>(raw->buffer);
}

/// INVALID_ARGUMENT at the first element that holds a number of at least `end`.
[[nodiscard]] Status check_below(std::span<const u32> values, u32 end, u64 element_size,
                                 std::string_view what);

[[nodiscard]] v1::Array to_array(const BufferPtr& bytes, v1::DType type, std::span<const u64> shape,
                                 const ArraySink& sink);
/// Copies the numbers.
[[nodiscard]] v1::Array to_array(std::vector<float> values, std::span<const u64> shape,
                                 const ArraySink& sink);
[[nodiscard]] v1::Array to_array(std::vector<double> values, std::span<const u64> shape,
                                 const ArraySink& sink);

}  // namespace heliograph::server
