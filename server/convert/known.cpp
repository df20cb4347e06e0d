// Refuses what this version does not know: a field ignored would be a silently wrong picture.
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

Status check_enum(const FieldDescriptor& field, int value) {
  if (field.enum_type()->FindValueByNumber(value)) return {};
  return fail(Code::kUnimplemented, "",
              fmt::format("value {} of {} is not known to this version; update the daemon", value,
                          field.enum_type()->full_name()));
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

/// The fields of a message that hold messages and enums.
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

}  // namespace

Status check_own_fields(const Message& message) {
  const auto& unknown = message.GetReflection()->GetUnknownFields(message);
  if (unknown.empty()) return {};
  return fail(Code::kUnimplemented, "",
              fmt::format("field {} of {} is not known to this version; update the daemon or "
                          "leave the field out",
                          unknown.field(0).number(), message.GetTypeName()));
}

Status check_known(const Message& message) {
  HELIO_TRY(check_own_fields(message));
  const Reflection& reflection = *message.GetReflection();
  for (const FieldDescriptor* field : fields_to_check(message)) {
    if (field->is_repeated()) {
      HELIO_TRY(check_repeated(message, *field));
      continue;
    }
    if (!reflection.HasField(message, field)) continue;
    if (field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM)
      HELIO_CHECK(check_enum(*field, reflection.GetEnumValue(message, field)), field->name());
    else
      HELIO_CHECK(check_known(reflection.GetMessage(message, field)), field->name());
  }
  return {};
}

}  // namespace heliograph::server
