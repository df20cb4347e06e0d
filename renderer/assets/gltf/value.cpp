#include "renderer/assets/gltf/value.h"

#include <cmath>
#include <limits>

namespace heliograph::assets::gltf {

std::optional<Value> Value::find(const std::string& key) const {
  if (!json_->is_object()) refuse(where_, "must be an object");
  const auto at = json_->find(key);
  if (at == json_->end()) return std::nullopt;
  return Value(*at, key_where(key));
}

Value Value::at(const std::string& key) const {
  std::optional<Value> value = find(key);
  if (!value) refuse(key_where(key), "is missing");
  return *value;
}

std::vector<std::pair<std::string, Value>> Value::members() const {
  if (!json_->is_object()) refuse(where_, "must be an object");
  std::vector<std::pair<std::string, Value>> result;
  for (const auto& [key, value] : json_->items()) {
    result.emplace_back(key, Value(value, key_where(key)));
  }
  return result;
}

std::optional<Value> Value::extension(const std::string& name) const {
  const std::optional<Value> extensions = find("extensions");
  return extensions ? extensions->find(name) : std::nullopt;
}

std::size_t Value::size() const {
  if (!json_->is_array()) refuse(where_, "must be an array");
  return json_->size();
}

Value Value::operator[](std::size_t index) const {
  if (index >= size()) refuse(where_, fmt::format("has no element {}", index));
  return {(*json_)[index], fmt::format("{}[{}]", where_, index)};
}

double Value::number() const {
  if (!json_->is_number()) refuse(where_, "must be a number");
  const double value = json_->get<double>();
  if (!std::isfinite(value)) refuse(where_, "must be finite");
  return value;
}

float Value::single() const {
  const double value = number();
  if (std::abs(value) > double(std::numeric_limits<float>::max())) {
    refuse(where_, "is too large for a 32 bit float");
  }
  return float(value);
}

u64 Value::whole() const {
  constexpr double kLargest = 9007199254740992.0;  // 2^53
  const double value = number();
  if (value < 0 || value > kLargest || value != std::floor(value)) {
    refuse(where_, "must be a whole number, 0 or more");
  }
  return u64(value);
}

std::string Value::text() const {
  if (!json_->is_string()) refuse(where_, "must be a string");
  return json_->get<std::string>();
}

bool Value::flag() const {
  if (!json_->is_boolean()) refuse(where_, "must be true or false");
  return json_->get<bool>();
}

double Value::number(const std::string& key, double fallback) const {
  const std::optional<Value> value = find(key);
  return value ? value->number() : fallback;
}
u64 Value::whole(const std::string& key, u64 fallback) const {
  const std::optional<Value> value = find(key);
  return value ? value->whole() : fallback;
}
std::string Value::text(const std::string& key, const std::string& fallback) const {
  const std::optional<Value> value = find(key);
  return value ? value->text() : fallback;
}
bool Value::flag(const std::string& key, bool fallback) const {
  const std::optional<Value> value = find(key);
  return value ? value->flag() : fallback;
}

u32 Value::index(std::size_t count) const {
  const u64 value = whole();
  if (value >= count) refuse(where_, fmt::format("is {}, but there are only {}", value, count));
  return u32(value);
}

}  // namespace heliograph::assets::gltf
