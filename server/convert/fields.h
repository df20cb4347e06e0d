// Shared steps of all nouns: take a field or return its error under the field's name, check ranges,
// enum tables, lists of fields to clear.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <span>
#include <string>
#include <string_view>

#include "heliograph/v1/types.pb.h"
#include "renderer/base/error.h"
#include "renderer/base/types.h"
#include "renderer/scene/transaction.h"

/// Moves the value of an Expected into `target`, or returns its error under the name `field`.
#define HELIO_TAKE(target, expression, field)                                           \
  do {                                                                                  \
    auto helio_value = (expression);                                                    \
    if (!helio_value) return std::unexpected(std::move(helio_value).error().at(field)); \
    target = std::move(*helio_value);                                                   \
  } while (false)

/// Returns the error of a Status under the name `field`, if it has one.
#define HELIO_CHECK(expression, field)                                   \
  do {                                                                   \
    if (auto helio_status = (expression); !helio_status)                 \
      return std::unexpected(std::move(helio_status).error().at(field)); \
  } while (false)

namespace heliograph::server {

/// A closed interval. An f32 may lie outside by the rounding of its end.
struct Range {
  double low;
  double high;
};
inline constexpr Range kAnyFinite{-3.4e38, 3.4e38};
inline constexpr Range kNotNegative{0, 3.4e38};

/// Returns the number, or INVALID_ARGUMENT with the value and the range.
[[nodiscard]] Expected<double> in_range(double value, Range range);
[[nodiscard]] Expected<vec3> to_vec3(const v1::Vec3& message, Range range);
[[nodiscard]] v1::Vec3 to_proto(const vec3& v);

[[nodiscard]] Expected<Ref> to_ref(const v1::Ref& message);
[[nodiscard]] v1::Ref to_proto(const Ref& ref);
[[nodiscard]] Expected<std::vector<Ref>> to_refs(
    const google::protobuf::RepeatedPtrField<v1::Ref>& messages);

/// Returns "field[3]".
[[nodiscard]] std::string indexed(std::string_view field, u64 index);
/// Checks the name of a light group, at most 256 bytes. INVALID_ARGUMENT.
[[nodiscard]] Expected<std::string> to_group(std::string_view name);
/// Checks that a hash has 32 bytes. INVALID_ARGUMENT.
[[nodiscard]] Status check_hash(std::string_view hash);
/// Returns lower-case hexadecimal digits, for messages.
[[nodiscard]] std::string hex(std::string_view bytes);

/// Table from a proto enum's numbers to domain values; 0 (unspecified) holds the default.
/// check_known() has refused unknown numbers.
template <class E, std::size_t N>
[[nodiscard]] E from_enum(const std::array<E, N>& table, int value) {
  return table[std::size_t(std::clamp(value, 0, int(N) - 1))];
}
/// Returns the number, never 0, of a value.
template <class P, class E, std::size_t N>
[[nodiscard]] P to_enum(const std::array<E, N>& table, E value) {
  return P(std::find(table.begin() + 1, table.end(), value) - table.begin());
}

/// Name of a field of a patch, and how to clear it.
template <class Patch>
struct Clear {
  std::string_view name;
  void (*reset)(Patch&);
};

[[nodiscard]] std::unexpected<Error> unknown_clear(u64 index, const std::string& name,
                                                   std::span<const std::string_view> valid);

/// Clears every field that `names` lists. INVALID_ARGUMENT, which lists the valid names, for an
/// unknown one.
template <class Patch, std::size_t N>
[[nodiscard]] Status clear_fields(const google::protobuf::RepeatedPtrField<std::string>& names,
                                  const std::array<Clear<Patch>, N>& table, Patch& patch) {
  for (int i = 0; i < names.size(); ++i) {
    const auto entry = std::ranges::find(table, names[i], &Clear<Patch>::name);
    if (entry == table.end()) {
      std::array<std::string_view, N> valid;
      std::ranges::transform(table, valid.begin(), &Clear<Patch>::name);
      return unknown_clear(u64(i), names[i], valid);
    }
    entry->reset(patch);
  }
  return {};
}

}  // namespace heliograph::server
