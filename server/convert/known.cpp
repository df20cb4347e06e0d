// Refuses fields and enum values that this version does not know: ignoring one would silently give
// a wrong picture.
#include <fmt/format.h>
#include <google/protobuf/unknown_field_set.h>

#include <unordered_map>

#include "server/convert/fields.h"
#include "server/convert/transaction.h"

namespace heliograph::server {
namespace {

using google::protobuf::Descriptor;
using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using google::protobuf::Reflection;

std::unexpected<Error> unknown(std::string message) {
  return std::unexpected(Error{.code = Code::kUnimplemented,
                               .message = std::move(message),
                               .where = "",
                               .reason = "UNKNOWN_TO_DAEMON"});
}

Status check_enum(const FieldDescriptor& field, int value) {
  if (field.enum_type()->FindValueByNumber(value)) return {};
  return unknown(fmt::format("value {} of {} is not known to this version; update the daemon",
                             value, field.enum_type()->full_name()));
}

Status check_repeated(const Message& message, const FieldDescriptor& field) {
  const Reflection& reflection = *message.GetReflection();
  const int count = reflection.FieldSize(message, &field);
  for (int i = 0; i < count; ++i) {
    const std::string name = indexed(field.name(), u64(i));
    if (field.cpp_type() == FieldDescriptor::CPPTYPE_ENUM)
      HELIO_CHECK(check_enum(field, reflection.GetRepeatedEnumValue(message, &field, i)), name);
    else
      HELIO_CHECK(check_known(reflection.GetRepeatedMessage(message, &field, i)), name);
  }
  return {};
}

/// Fields of a message that hold messages or enums.
const std::vector<const FieldDescriptor*>& fields_to_check(const Message& message) {
  static thread_local std::unordered_map<const Descriptor*, std::vector<const FieldDescriptor*>>
      known;
  const Descriptor* type = message.GetDescriptor();
  const auto [found, is_new] = known.try_emplace(type);
  for (int i = 0; is_new && i < type->field_count(); ++i)
    if (const auto holds = type->field(i)->cpp_type();
        holds == FieldDescriptor::CPPTYPE_ENUM || holds == FieldDescriptor::CPPTYPE_MESSAGE)
      found->second.push_back(type->field(i));
  return found->second;
}

Status check_unknown(const Message& message) {
  const auto& fields = message.GetReflection()->GetUnknownFields(message);
  if (fields.empty()) return {};
  return unknown(
      fmt::format("field {} of {} is not known to this version; update the daemon or "
                  "leave the field out",
                  fields.field(0).number(), message.GetTypeName()));
}

Status check_field(const Message& message, const FieldDescriptor& field) {
  if (field.is_repeated()) return check_repeated(message, field);
  const Reflection& reflection = *message.GetReflection();
  if (!reflection.HasField(message, &field)) return {};
  if (field.cpp_type() == FieldDescriptor::CPPTYPE_ENUM)
    HELIO_CHECK(check_enum(field, reflection.GetEnumValue(message, &field)), field.name());
  else
    HELIO_CHECK(check_known(reflection.GetMessage(message, &field)), field.name());
  return {};
}

}  // namespace

Status check_own_fields(const Message& message) {
  HELIO_TRY(check_unknown(message));
  for (const FieldDescriptor* field : fields_to_check(message))
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM) HELIO_TRY(check_field(message, *field));
  return {};
}

Status check_known(const Message& message) {
  HELIO_TRY(check_unknown(message));
  for (const FieldDescriptor* field : fields_to_check(message))
    HELIO_TRY(check_field(message, *field));
  return {};
}

}  // namespace heliograph::server
