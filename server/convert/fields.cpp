// Scalars, vectors, references and names, checked. Called by every noun of server/convert.
#include "server/convert/fields.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace heliograph::server {

Expected<double> in_range(double value, Range range) {
  if (!std::isfinite(value))
    return fail(Code::kInvalidArgument, "", fmt::format("is {}; give a finite number", value));
  const double low = std::min(range.low, double(float(range.low)));
  const double high = std::max(range.high, double(float(range.high)));
  if (value >= low && value <= high) return value;
  const bool bounded = range.high < kNotNegative.high;
  return fail(Code::kInvalidArgument, "",
              bounded
                  ? fmt::format("is {}; give a number in [{}, {}]", value, range.low, range.high)
                  : fmt::format("is {}; give a number of at least {}", value, range.low));
}

Expected<vec3> to_vec3(const v1::Vec3& message, Range range) {
  HELIO_CHECK(in_range(message.x(), range), "x");
  HELIO_CHECK(in_range(message.y(), range), "y");
  HELIO_CHECK(in_range(message.z(), range), "z");
  return vec3(message.x(), message.y(), message.z());
}

v1::Vec3 to_proto(const vec3& v) {
  v1::Vec3 message;
  message.set_x(v.x);
  message.set_y(v.y);
  message.set_z(v.z);
  return message;
}

Expected<Ref> to_ref(const v1::Ref& message) {
  switch (message.target_case()) {
    case v1::Ref::kId:
      if (message.id() == 0) return Ref{};
      return Ref{Id{message.id()}};
    case v1::Ref::kName:
      if (message.name().empty())
        return fail(Code::kInvalidArgument, "name", "is empty; give a name, or id 0 for nothing");
      if (message.name().size() > kMostNameBytes)
        return fail(Code::kInvalidArgument, "name",
                    fmt::format("has {} bytes; names have at most {}", message.name().size(),
                                kMostNameBytes));
      return Ref{message.name()};
    case v1::Ref::kCreatedByEdit:
      return Ref{CreatedByEdit{message.created_by_edit()}};
    case v1::Ref::TARGET_NOT_SET:
      break;
  }
  return fail(Code::kInvalidArgument, "",
              "names nothing; set id (0 for nothing), name or created_by_edit");
}

v1::Ref to_proto(const Ref& ref) {
  v1::Ref message;
  if (const Id* id = std::get_if<Id>(&ref))
    message.set_id(id->value);
  else if (const auto* name = std::get_if<std::string>(&ref))
    message.set_name(*name);
  else if (const auto* created = std::get_if<CreatedByEdit>(&ref))
    message.set_created_by_edit(created->edit);
  else
    message.set_id(0);
  return message;
}

Expected<std::vector<Ref>> to_refs(const google::protobuf::RepeatedPtrField<v1::Ref>& messages) {
  std::vector<Ref> refs(std::size_t(messages.size()));
  for (int i = 0; i < messages.size(); ++i)
    HELIO_TAKE(refs[std::size_t(i)], to_ref(messages[i]), indexed("", u64(i)));
  return refs;
}

std::string indexed(std::string_view field, u64 index) {
  return fmt::format("{}[{}]", field, index);
}

Expected<std::string> to_group(std::string_view name) {
  constexpr std::size_t kLongest = 256;
  if (name.size() <= kLongest) return std::string(name);
  return fail(Code::kInvalidArgument, "",
              fmt::format("has {} bytes; name it in at most {}", name.size(), kLongest));
}

Status check_hash(std::string_view hash) {
  if (hash.size() == 32) return {};
  return fail(Code::kInvalidArgument, "",
              fmt::format("has {} bytes; a SHA-256 has 32", hash.size()));
}

std::string hex(std::string_view bytes) {
  std::string text;
  for (const char c : bytes) text += fmt::format("{:02x}", u8(c));
  return text;
}

std::unexpected<Error> unknown_clear(u64 index, const std::string& name,
                                     std::span<const std::string_view> valid) {
  return fail(Code::kInvalidArgument, indexed("clear", index),
              fmt::format("'{}' is no field that can be cleared; these are: {}", name,
                          fmt::join(valid, ", ")));
}

}  // namespace heliograph::server
