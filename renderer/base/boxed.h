// A value that may be absent, on the heap.
#pragma once

#include <concepts>
#include <memory>
#include <type_traits>
#include <utility>

namespace heliograph {

/// std::optional with its value on the heap: 8 bytes where there is none. For large fields that few
/// have. A copy copies the value. Call * and -> where there is one.
template <class T>
class Boxed {
 public:
  Boxed() = default;
  template <class U>
    requires(!std::same_as<std::remove_cvref_t<U>, Boxed> && std::constructible_from<T, U>)
  Boxed(U&& value) : value_(std::make_unique<T>(std::forward<U>(value))) {}  // NOLINT
  Boxed(const Boxed& other) : value_(other ? std::make_unique<T>(*other) : nullptr) {}
  Boxed(Boxed&&) noexcept = default;
  Boxed& operator=(Boxed other) noexcept {
    value_ = std::move(other.value_);
    return *this;
  }
  ~Boxed() = default;

  template <class... Args>
  T& emplace(Args&&... args) {
    value_ = std::make_unique<T>(std::forward<Args>(args)...);
    return *value_;
  }
  void reset() { value_.reset(); }
  [[nodiscard]] bool has_value() const { return value_ != nullptr; }
  [[nodiscard]] explicit operator bool() const { return has_value(); }
  [[nodiscard]] T& operator*() { return *value_; }
  [[nodiscard]] const T& operator*() const { return *value_; }
  [[nodiscard]] T* operator->() { return value_.get(); }
  [[nodiscard]] const T* operator->() const { return value_.get(); }

 private:
  std::unique_ptr<T> value_;
};

}  // namespace heliograph
