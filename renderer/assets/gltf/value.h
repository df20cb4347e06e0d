// A JSON value together with its place in the document, so that every refusal names its element.
// Used by the glTF loader.
#pragma once

#include <algorithm>
#include <glm/gtc/type_ptr.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <ranges>
#include <span>
#include <string>
#include <vector>

#include "renderer/assets/refuse.h"
#include "renderer/base/types.h"

namespace heliograph::assets::gltf {

/// Borrows the JSON. Every accessor refuses a value of another type.
class Value {
 public:
  Value(const nlohmann::json& json, std::string where) : json_(&json), where_(std::move(where)) {}

  [[nodiscard]] const std::string& where() const { return where_; }
  [[nodiscard]] std::string key_where(const std::string& key) const {
    return where_.empty() ? key : where_ + "." + key;
  }
  [[nodiscard]] std::string dump() const { return json_->dump(); }

  // Objects.
  [[nodiscard]] std::optional<Value> find(const std::string& key) const;
  [[nodiscard]] Value at(const std::string& key) const;
  [[nodiscard]] std::vector<std::pair<std::string, Value>> members() const;
  /// extensions.<name>
  [[nodiscard]] std::optional<Value> extension(const std::string& name) const;

  // Arrays.
  [[nodiscard]] std::size_t size() const;
  [[nodiscard]] Value operator[](std::size_t index) const;
  [[nodiscard]] auto elements() const {
    return std::views::iota(std::size_t(0), size()) |
           std::views::transform([self = *this](std::size_t i) { return self[i]; });
  }

  // Scalars: finite numbers, whole numbers in [0, 2^53], strings, booleans.
  [[nodiscard]] double number() const;
  [[nodiscard]] u64 whole() const;
  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool flag() const;

  [[nodiscard]] double number(const std::string& key, double fallback) const;
  [[nodiscard]] u64 whole(const std::string& key, u64 fallback) const;
  [[nodiscard]] std::string text(const std::string& key, const std::string& fallback) const;
  [[nodiscard]] bool flag(const std::string& key, bool fallback) const;
  /// An array of exactly as many numbers as a T, a vector or a matrix, has.
  template <class T>
  [[nodiscard]] T numbers(const std::string& key, T fallback) const {
    constexpr std::size_t kCount = sizeof(T) / sizeof(float);
    if (const std::optional<Value> array = find(key)) {
      if (array->size() != kCount)
        refuse(array->where(), fmt::format("must have {} numbers", kCount));
      std::ranges::transform(array->elements(), glm::value_ptr(fallback), &Value::single);
    }
    return fallback;
  }
  /// A number that a float can hold.
  [[nodiscard]] float single() const;

  /// This index, which must be below `count`.
  [[nodiscard]] u32 index(std::size_t count) const;

 private:
  const nlohmann::json* json_;
  std::string where_;
};

}  // namespace heliograph::assets::gltf
