// Arrays, half floats and columns.
#include "heliograph/array.h"

#include <cmath>
#include <cstring>

#include "heliograph/error.h"

namespace heliograph::client {

std::size_t size_of(DType dtype) {
  switch (dtype) {
    case DType::kU8:
      return 1;
    case DType::kU16:
    case DType::kF16:
      return 2;
    case DType::kU32:
    case DType::kI32:
    case DType::kF32:
      return 4;
    case DType::kU64:
    case DType::kF64:
      return 8;
  }
  throw ClientError(Code::kInternal, "a dtype that this client does not know; install a newer one");
}

std::string name_of(DType dtype) {
  switch (dtype) {
    case DType::kU8:
      return "u8";
    case DType::kU16:
      return "u16";
    case DType::kU32:
      return "u32";
    case DType::kI32:
      return "i32";
    case DType::kU64:
      return "u64";
    case DType::kF16:
      return "f16";
    case DType::kF32:
      return "f32";
    case DType::kF64:
      return "f64";
  }
  return "?";
}

std::string to_string(const Shape& shape) {
  std::string out = "(";
  for (std::size_t i = 0; i < shape.size(); ++i)
    out += (i == 0 ? "" : ", ") + std::to_string(shape[i]);
  return out + (shape.size() == 1 ? ",)" : ")");
}

Half Half::of(double value) {
  std::uint64_t bits = 0;
  std::memcpy(&bits, &value, sizeof(bits));
  const auto sign = std::uint16_t(bits >> 48 & 0x8000);
  const double magnitude = std::abs(value);
  if (std::isnan(value)) return {std::uint16_t(sign | 0x7e00)};
  if (magnitude >= 65520) return {std::uint16_t(sign | 0x7c00)};  // rounds to infinity
  if (magnitude <= 0x1p-25) return {sign};                        // rounds to 0
  const int exponent = int(bits >> 52 & 0x7ff) - 1023;
  const std::uint64_t mantissa = (bits & 0xfffffffffffff) | 0x10000000000000;
  // Bits that do not fit: 42 of a normal number, more of a subnormal one.
  const int dropped = exponent >= -14 ? 42 : 28 - exponent;
  std::uint64_t kept = mantissa >> dropped;
  const std::uint64_t rest = mantissa & ((std::uint64_t(1) << dropped) - 1);
  const std::uint64_t middle = std::uint64_t(1) << (dropped - 1);
  if (rest > middle || (rest == middle && (kept & 1) != 0)) ++kept;
  if (exponent >= -14) kept += std::uint64_t(exponent + 14) << 10;  // the leading bit adds one more
  return {std::uint16_t(sign | kept)};
}

float Half::value() const {
  const std::uint32_t sign = std::uint32_t(bits & 0x8000) << 16;
  const std::uint32_t exponent = (bits >> 10) & 31;
  const std::uint32_t mantissa = bits & 0x3ff;
  float out = 0;
  if (exponent == 0) {
    out = float(mantissa) * 0x1p-24f;
    return sign != 0 ? -out : out;
  }
  const std::uint32_t wide =
      sign | ((exponent == 31 ? 255 : exponent + 112) << 23) | (mantissa << 13);
  std::memcpy(&out, &wide, sizeof(out));
  return out;
}

std::size_t Array::size() const {
  std::size_t out = 1;
  for (const std::size_t n : shape_) out *= n;
  return out;
}

void Array::reshape(Shape shape) {
  const std::size_t before = size();
  const Shape old = std::exchange(shape_, std::move(shape));
  if (size() != before)
    throw ClientError(Code::kInvalidArgument,
                      "shape: " + to_string(shape_) + " does not hold the " + "elements of " +
                          to_string(old) + "; give one that does",
                      {"shape"});
}

Shape Array::outer(DType dtype, const Shape& inner) const {
  const bool fits = shape_.size() >= inner.size() &&
                    Shape(shape_.end() - std::ptrdiff_t(inner.size()), shape_.end()) == inner;
  if (dtype != dtype_ || !fits)
    throw ClientError(Code::kInvalidArgument, "this array is " + to_string(shape_) + " " +
                                                  name_of(dtype_) + ", not of " + name_of(dtype) +
                                                  "; name that type in view<T>() or plane<T>()");
  return {shape_.begin(), shape_.end() - std::ptrdiff_t(inner.size())};
}

std::vector<std::string> Columns::names() const {
  std::vector<std::string> out;
  for (const Column& column : columns_) out.push_back(column.name);
  return out;
}

const Columns::Column* Columns::find(const std::string& name) const {
  for (const Column& column : columns_)
    if (column.name == name) return &column;
  return nullptr;
}

const Columns::Column& Columns::at(const std::string& name) const {
  if (const Column* found = find(name)) return *found;
  ErrorDetails details;
  details.nearest = names();
  std::string have;
  for (const std::string& known : details.nearest) have += (have.empty() ? "" : ", ") + known;
  throw ClientError(Code::kNotFound,
                    "no column \"" + name + "\" among " + (have.empty() ? "none" : have) +
                        "; labels are asked for with RenderOptions::labels()",
                    std::move(details));
}

}  // namespace heliograph::client
