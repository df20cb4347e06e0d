// Reading and checking v1::Array. The checks are plain loops over blocks, so that they vectorise.
#include "server/convert/array.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>

#include "server/convert/fields.h"

namespace heliograph::server {
namespace {

constexpr std::array<u64, v1::DType_ARRAYSIZE> kSizes{0, 1, 2, 4, 4, 8, 2, 4, 8};
constexpr std::size_t kBlock = 4096;

std::string dtype_text(v1::DType type) {
  std::string name = v1::DType_Name(type);
  name = name.substr(std::min(name.size(), std::size_t(7)));
  std::ranges::transform(name, name.begin(), [](unsigned char c) { return char(std::tolower(c)); });
  return name;
}

std::string dims_text(const Dims& dims) {
  std::vector<std::string> parts;
  for (const Dim& dim : dims) {
    if (!dim.size)
      parts.emplace_back(dim.name);
    else if (dim.name.empty())
      parts.push_back(std::to_string(*dim.size));
    else
      parts.push_back(fmt::format("{} = {}", dim.name, *dim.size));
  }
  return fmt::format("({}{})", fmt::join(parts, ", "), parts.size() == 1 ? "," : "");
}

bool matches(const v1::Array& array, const Dims& dims) {
  if (std::size_t(array.shape_size()) != dims.size()) return false;
  for (std::size_t i = 0; i < dims.size(); ++i)
    if (dims[i].size && *dims[i].size != array.shape(int(i))) return false;
  return true;
}

/// Returns the bytes of the whole array; nullopt when they exceed 64 bits.
std::optional<u64> byte_count(const v1::Array& array) {
  u64 bytes = dtype_size(array.dtype());
  for (const u64 n : array.shape())
    if (__builtin_mul_overflow(bytes, n, &bytes)) return std::nullopt;
  return bytes;
}

/// Returns the index of the first number with all exponent bits set.
template <class Bits>
u64 first_special(std::span<const Bits> values, Bits exponent) {
  for (std::size_t begin = 0; begin < values.size(); begin += kBlock) {
    const auto block = values.subspan(begin, std::min(kBlock, values.size() - begin));
    Bits special = 0;
    for (const Bits bits : block) special |= Bits((bits & exponent) == exponent);
    if (!special) continue;
    for (std::size_t i = 0; i < block.size(); ++i)
      if ((block[i] & exponent) == exponent) return begin + i;
  }
  return values.size();
}

}  // namespace

u64 dtype_size(v1::DType type) { return v1::DType_IsValid(type) ? kSizes[std::size_t(type)] : 0; }

std::string shape_text(const v1::Array& array) {
  return fmt::format("({}{})", fmt::join(array.shape(), ", "), array.shape_size() == 1 ? "," : "");
}

Expected<u64> bytes_of(const v1::Array& array, const Dims& dims, std::span<const v1::DType> types) {
  if (std::ranges::find(types, array.dtype()) == types.end()) {
    std::vector<std::string> names;
    std::ranges::transform(types, std::back_inserter(names), dtype_text);
    return fail(Code::kInvalidArgument, "dtype",
                fmt::format("is {}; send {}", dtype_text(array.dtype()), fmt::join(names, " or ")));
  }
  if (!matches(array, dims))
    return fail(Code::kInvalidArgument, "shape",
                fmt::format("is {}; send {}", shape_text(array), dims_text(dims)));
  const auto bytes = byte_count(array);
  if (!bytes)
    return fail(Code::kInvalidArgument, "shape",
                fmt::format("{} does not fit 64 bits", shape_text(array)));
  return *bytes;
}

Expected<RawArray> read_raw(const v1::Array& array, ArraySource& source, const Dims& dims,
                            std::span<const v1::DType> types) {
  const auto bytes = bytes_of(array, dims, types);
  if (!bytes) return std::unexpected(bytes.error());
  RawArray raw{.type = array.dtype(), .shape = {array.shape().begin(), array.shape().end()}};
  auto buffer = source.bytes(array);
  if (!buffer) return std::unexpected(std::move(buffer).error());
  if ((*buffer)->bytes().size() != *bytes)
    return fail(Code::kInvalidArgument, "",
                fmt::format("shape {} of {} needs {} bytes, {} came", shape_text(array),
                            dtype_text(raw.type), *bytes, (*buffer)->bytes().size()));
  raw.buffer = std::move(*buffer);
  raw.count = *bytes / dtype_size(raw.type);
  return raw;
}

u64 first_not_finite(const RawArray& raw) {
  if (raw.type == v1::D_TYPE_F16) return first_special<u16>(raw.as<u16>(), 0x7c00);
  if (raw.type == v1::D_TYPE_F32) return first_special<u32>(raw.as<u32>(), 0x7f800000);
  return first_special<u64>(raw.as<u64>(), 0x7ff0000000000000);
}

std::unexpected<Error> bad_element(const RawArray& raw, u64 index, u64 size, std::string message) {
  u64 element = index / size;
  std::string path;
  u64 inner = 1;
  for (std::size_t d = raw.shape.size(); d-- > 0;) {
    if (inner < size) {
      inner *= raw.shape[d];
      continue;
    }
    path = indexed("", element % raw.shape[d]) + path;
    element /= raw.shape[d];
  }
  return fail(Code::kInvalidArgument, path, std::move(message));
}

Status check_finite(const RawArray& raw, u64 element_size) {
  const u64 bad = first_not_finite(raw);
  if (bad == raw.count) return {};
  return bad_element(raw, bad, element_size, "is NaN or infinite; every number must be finite");
}

Expected<RawArray> to_f32(RawArray raw, u64 element_size) {
  HELIO_TRY(check_finite(raw, element_size));
  if (raw.type == v1::D_TYPE_F32) return raw;
  const auto values = raw.as<double>();
  RawArray out{.type = v1::D_TYPE_F32, .shape = raw.shape, .count = raw.count};
  auto floats = std::make_shared<std::vector<float>>(values.begin(), values.end());
  out.buffer = std::make_shared<const Buffer>(floats, std::as_bytes(std::span(*floats)));
  if (const u64 bad = first_not_finite(out); bad != out.count)
    return bad_element(out, bad, element_size, fmt::format("{} does not fit f32", values[bad]));
  return out;
}

Expected<RawArray> read_f32(const v1::Array& array, ArraySource& source, const Dims& dims,
                            u64 element_size) {
  const auto bytes = bytes_of(array, dims, kFloatTypes);
  if (!bytes) return std::unexpected(bytes.error());
  if (array.dtype() == v1::D_TYPE_F32) {
    auto taken = source.take(array, *bytes, Numbers::kFloats);
    if (!taken) return std::unexpected(std::move(taken).error());
    if (*taken)
      return RawArray{*std::move(taken),
                      array.dtype(),
                      {array.shape().begin(), array.shape().end()},
                      *bytes / dtype_size(array.dtype())};
  }
  auto raw = read_raw(array, source, dims, kFloatTypes);
  if (!raw) return raw;
  return to_f32(std::move(*raw), element_size);
}

Expected<std::vector<double>> read_f64(const v1::Array& array, ArraySource& source,
                                       const Dims& dims, u64 element_size) {
  auto raw = read_raw(array, source, dims, kFloatTypes);
  if (!raw) return std::unexpected(std::move(raw).error());
  HELIO_TRY(check_finite(*raw, element_size));
  if (raw->type == v1::D_TYPE_F64) {
    const auto values = raw->as<double>();
    return std::vector<double>(values.begin(), values.end());
  }
  const auto values = raw->as<float>();
  return std::vector<double>(values.begin(), values.end());
}

Expected<std::vector<double>> read_times(const v1::Array& array, ArraySource& source) {
  auto times = read_f64(array, source, {{"K", {}}}, 1);
  if (!times) return times;
  if (times->empty()) return fail(Code::kInvalidArgument, "", "is empty; give at least one time");
  for (std::size_t i = 1; i < times->size(); ++i)
    if ((*times)[i] <= (*times)[i - 1])
      return fail(Code::kInvalidArgument, indexed("", i),
                  fmt::format("{} s follows {} s; times must increase strictly", (*times)[i],
                              (*times)[i - 1]));
  return times;
}

Status check_below(std::span<const u32> values, u32 end, u64 element_size, std::string_view what) {
  u32 largest = 0;
  for (const u32 value : values) largest = std::max(largest, value);
  if (values.empty() || largest < end) return {};
  const auto bad = std::ranges::find_if(values, [&](u32 value) { return value >= end; });
  return fail(Code::kInvalidArgument, indexed("", u64(bad - values.begin()) / element_size),
              fmt::format("holds {}, but there are only {} {}", *bad, end, what));
}

v1::Array to_array(const BufferPtr& bytes, v1::DType type, std::span<const u64> shape,
                   const ArraySink& sink) {
  v1::Array array;
  array.set_dtype(type);
  array.mutable_shape()->Add(shape.begin(), shape.end());
  sink(bytes ? bytes : std::make_shared<const Buffer>(nullptr, std::span<const std::byte>{}),
       array);
  return array;
}

v1::Array to_array(std::vector<float> values, std::span<const u64> shape, const ArraySink& sink) {
  return to_array(ArrayOf<float>(std::move(values)).buffer(), v1::D_TYPE_F32, shape, sink);
}

v1::Array to_array(std::vector<double> values, std::span<const u64> shape, const ArraySink& sink) {
  return to_array(ArrayOf<double>(std::move(values)).buffer(), v1::D_TYPE_F64, shape, sink);
}

}  // namespace heliograph::server
