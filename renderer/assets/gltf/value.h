// A JSON value together with its place in the document, so that every refusal names its element.
// Used by the glTF loader.
#pragma once

#include <array>
#include <nlohmann/json.hpp>
#include <optional>
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

  // Scalars: finite numbers, whole numbers in [0, 2^53], strings, booleans.
  [[nodiscard]] double number() const;
  [[nodiscard]] u64 whole() const;
  [[nodiscard]] std::string text() const;
  [[nodiscard]] bool flag() const;

  [[nodiscard]] double number(const std::string& key, double fallback) const;
  [[nodiscard]] u64 whole(const std::string& key, u64 fallback) const;
  [[nodiscard]] std::string text(const std::string& key, const std::string& fallback) const;
  [[nodiscard]] bool flag(const std::string& key, bool fallback) const;
  /// An array of exactly N numbers.
  template <std::size_t N>
  [[nodiscard]] std::array<float, N> numbers(const std::string& key,
                                             const std::array<float, N>& fallback) const {
    const std::optional<Value> array = find(key);
    if (!array) return fallback;
    if (array->size() != N) refuse(array->where(), fmt::format("must have {} numbers", N));
    std::array<float, N> result;
    for (std::size_t i = 0; i < N; ++i) result[i] = (*array)[i].single();
    return result;
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
