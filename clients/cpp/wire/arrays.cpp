// Arrays and columns to the wire and back.
#include "wire/arrays.h"

#include <cstring>
#include <utility>

#include "heliograph/error.h"

namespace heliograph::client::wire {

void describe(const Array& array, v1::Array* out) {
  out->set_dtype(v1::DType(array.dtype()));
  out->clear_shape();
  for (const std::size_t n : array.shape()) out->add_shape(n);
}

void put_inline(const Array& array, v1::Array* out) {
  describe(array, out);
  out->set_inline_(array.data(), array.bytes());
}

Array empty_array(DType dtype, Shape shape) {
  std::size_t bytes = size_of(dtype);
  for (const std::size_t n : shape) bytes *= n;
  const std::shared_ptr<std::byte[]> memory(new std::byte[bytes]);
  return {memory, memory.get(), dtype, std::move(shape)};
}

std::byte* writable(const Array& array) { return const_cast<std::byte*>(array.data()); }

Array array_of(v1::DType dtype, Shape shape, const std::string& bytes) {
  Array out = empty_array(DType(dtype), std::move(shape));
  if (out.bytes() != bytes.size())
    throw ClientError(Code::kInternal, "the daemon sent " + std::to_string(bytes.size()) +
                                           " bytes for an array of " + to_string(out.shape()));
  std::memcpy(writable(out), bytes.data(), bytes.size());
  return out;
}

Array array_of(const v1::Array& message) {
  return array_of(message.dtype(), Shape(message.shape().begin(), message.shape().end()),
                  message.inline_());
}

Columns columns_of(const google::protobuf::RepeatedPtrField<v1::LabelColumn>& columns) {
  std::vector<Columns::Column> out;
  for (const v1::LabelColumn& column : columns) {
    Columns::Column made;
    made.name = column.name();
    if (column.strings_size() > 0 || column.shape_size() == 0)
      made.texts.assign(column.strings().begin(), column.strings().end());
    else
      made.values = array_of(column.dtype(), Shape(column.shape().begin(), column.shape().end()),
                             column.data());
    out.push_back(std::move(made));
  }
  return Columns(std::move(out));
}

Array as_f32(const Array& array, const std::string& field) {
  if (array.dtype() == DType::kF32) return array;
  if (array.dtype() != DType::kF64)
    throw ClientError(Code::kInvalidArgument,
                      field + ": holds " + name_of(array.dtype()) + "; give f32 or f64", {field});
  Array out = empty_array(DType::kF32, array.shape());
  auto* to = reinterpret_cast<float*>(writable(out));
  for (const double value : array.view<double>()) *to++ = float(value);
  return out;
}

void check_rows(const Array& array, const Shape& inner, const std::string& field) {
  const Shape& shape = array.shape();
  if (!shape.empty() && Shape(shape.begin() + 1, shape.end()) == inner) return;
  std::string text = "(N";
  for (const std::size_t n : inner) text += ", " + std::to_string(n);
  text += inner.empty() ? ",)" : ")";
  throw ClientError(Code::kInvalidArgument,
                    field + ": needs shape " + text + ", has " + to_string(shape) + "; reshape it",
                    {field});
}

Array rows_of(const Array& array, std::size_t first, std::size_t last) {
  Shape shape = array.shape();
  const std::size_t row = shape[0] == 0 ? 0 : array.bytes() / shape[0];
  shape[0] = last - first;
  return {std::make_shared<const Array>(array), array.data() + first * row, array.dtype(),
          std::move(shape)};
}

}  // namespace heliograph::client::wire
