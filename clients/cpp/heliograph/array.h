// Dense arrays, in and out: arguments of calls, and planes, columns and read-back.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/pose.h"

namespace heliograph::client {

/// Numbers as in types.proto.
enum class DType : int {
  kU8 = 1,
  kU16 = 2,
  kU32 = 3,
  kI32 = 4,
  kU64 = 5,
  kF16 = 6,
  kF32 = 7,
  kF64 = 8,
};

std::size_t size_of(DType dtype);  // bytes of one element
std::string name_of(DType dtype);  // "f32"

/// An IEEE 754 binary16 number, for texels.
struct Half {
  std::uint16_t bits = 0;

  static Half of(double value);  // rounds to nearest even
  [[nodiscard]] float value() const;
};

using Shape = std::vector<std::size_t>;
std::string to_string(const Shape& shape);  // "(480, 640)"

/// Type of an array's elements that one C++ value makes: a dtype, and the inner dimensions that it
/// fills.
template <class T>
struct Element;
template <DType D>
struct ScalarElement {
  static constexpr DType kType = D;
  static Shape inner() { return {}; }
};
template <>
struct Element<std::uint8_t> : ScalarElement<DType::kU8> {};
template <>
struct Element<std::uint16_t> : ScalarElement<DType::kU16> {};
template <>
struct Element<std::uint32_t> : ScalarElement<DType::kU32> {};
template <>
struct Element<std::int32_t> : ScalarElement<DType::kI32> {};
template <>
struct Element<std::uint64_t> : ScalarElement<DType::kU64> {};
template <>
struct Element<Half> : ScalarElement<DType::kF16> {};
template <>
struct Element<float> : ScalarElement<DType::kF32> {};
template <>
struct Element<double> : ScalarElement<DType::kF64> {};
template <class T, std::size_t N>
struct Element<std::array<T, N>> {
  static constexpr DType kType = Element<T>::kType;
  static Shape inner() {
    Shape out = Element<T>::inner();
    out.insert(out.begin(), N);
    return out;
  }
};
template <class T, std::size_t R, std::size_t C>
struct Element<Matrix<T, R, C>> : Element<std::array<std::array<T, C>, R>> {};
template <>
struct Element<Vec3> : Element<std::array<double, 3>> {};
template <>
struct Element<Pose> : Element<Mat4> {};

/// A read-only array of T, which keeps its memory alive: valid as long as it is.
template <class T>
class View {
 public:
  View(std::shared_ptr<const void> owner, const T* data, Shape shape)
      : owner_(std::move(owner)), data_(data), shape_(std::move(shape)) {
    for (const std::size_t n : shape_) size_ *= n;
  }

  [[nodiscard]] const Shape& shape() const { return shape_; }
  [[nodiscard]] std::size_t size() const { return size_; }
  [[nodiscard]] bool empty() const { return size_ == 0; }
  [[nodiscard]] const T* data() const { return data_; }
  [[nodiscard]] const T* begin() const { return data_; }
  [[nodiscard]] const T* end() const { return data_ + size_; }
  const T& operator[](std::size_t flat) const { return data_[flat]; }

  /// view(row, column), view(row, column, channel): as many indices as dimensions.
  template <class... I>
  const T& operator()(I... indices) const {
    std::size_t flat = 0;
    std::size_t axis = 0;
    ((flat = flat * shape_[axis++] + std::size_t(indices)), ...);
    return data_[flat];
  }

 private:
  std::shared_ptr<const void> owner_;
  const T* data_;
  Shape shape_;
  std::size_t size_ = 1;
};

/// An immutable dense array in C order. Copies share the memory.
class Array {
 public:
  Array() = default;

  /// (N,) + the dimensions of T: std::vector<std::array<float, 3>> is (N, 3) f32, std::vector<Pose>
  /// is (N, 4, 4) f64. Takes the vector when it is moved in, else copies it.
  template <class T>
  Array(std::vector<T> values) {
    auto owner = std::make_shared<const std::vector<T>>(std::move(values));
    shape_ = Element<T>::inner();
    shape_.insert(shape_.begin(), owner->size());
    dtype_ = Element<T>::kType;
    data_ = reinterpret_cast<const std::byte*>(owner->data());
    owner_ = std::move(owner);
  }

  /// Array with a shape of its own, which has as many elements as `values`.
  template <class T>
  Array(std::vector<T> values, Shape shape) : Array(std::move(values)) {
    reshape(std::move(shape));
  }

  /// Memory of the caller, which must outlive every copy: an Eigen matrix, a camera's buffer.
  template <class T>
  static Array borrow(const T* data, Shape shape) {
    const Shape inner = Element<T>::inner();
    shape.insert(shape.end(), inner.begin(), inner.end());
    return {nullptr, reinterpret_cast<const std::byte*>(data), Element<T>::kType, std::move(shape)};
  }

  Array(std::shared_ptr<const void> owner, const std::byte* data, DType dtype, Shape shape)
      : owner_(std::move(owner)), data_(data), dtype_(dtype), shape_(std::move(shape)) {}

  [[nodiscard]] DType dtype() const { return dtype_; }
  [[nodiscard]] const Shape& shape() const { return shape_; }
  [[nodiscard]] std::size_t size() const;  // elements
  [[nodiscard]] std::size_t bytes() const { return size() * size_of(dtype_); }
  [[nodiscard]] const std::byte* data() const { return data_; }
  [[nodiscard]] bool empty() const { return size() == 0; }

  /// View of the values as T: view<float>() of a (N, 3) f32 array has shape (N, 3),
  /// view<std::array<float, 3>>() has shape (N,). Another dtype is kInvalidArgument.
  template <class T>
  [[nodiscard]] View<T> view() const {
    return {owner_, reinterpret_cast<const T*>(data_),
            outer(Element<T>::kType, Element<T>::inner())};
  }

 private:
  void reshape(Shape shape);
  [[nodiscard]] Shape outer(DType dtype, const Shape& inner) const;

  std::shared_ptr<const void> owner_;
  const std::byte* data_ = nullptr;
  DType dtype_ = DType::kU8;
  Shape shape_ = {0};
};

/// Named columns, one row per instance, ray or sample.
class Columns {
 public:
  struct Column {
    std::string name;
    Array values;
    std::vector<std::string> texts{};  // instead of values
  };

  Columns() = default;
  explicit Columns(std::vector<Column> columns) : columns_(std::move(columns)) {}

  [[nodiscard]] std::vector<std::string> names() const;
  [[nodiscard]] bool contains(const std::string& name) const { return find(name) != nullptr; }
  /// kNotFound lists the columns that there are.
  [[nodiscard]] const Array& operator[](const std::string& name) const { return at(name).values; }
  [[nodiscard]] const std::vector<std::string>& texts(const std::string& name) const {
    return at(name).texts;
  }
  template <class T>
  [[nodiscard]] View<T> view(const std::string& name) const {
    return at(name).values.template view<T>();
  }
  [[nodiscard]] const std::vector<Column>& all() const { return columns_; }

 private:
  [[nodiscard]] const Column* find(const std::string& name) const;
  [[nodiscard]] const Column& at(const std::string& name) const;

  std::vector<Column> columns_;
};

}  // namespace heliograph::client
