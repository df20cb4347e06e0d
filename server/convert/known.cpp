// Refuses what this version does not know: a field ignored would be a silently wrong picture.
#include <fmt/format.h>
#include <google/protobuf/unknown_field_set.h>

#include "server/convert/fields.h"
#include "server/convert/transaction.h"

namespace heliograph::server {
namespace {

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
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const bool is_enum = field->cpp_type() == FieldDescriptor::CPPTYPE_ENUM;
    if (!is_enum && field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE) continue;
    if (field->is_repeated())
      HELIO_TRY(check_repeated(message, *field));
    else if (is_enum)
      HELIO_CHECK(check_enum(*field, reflection.GetEnumValue(message, field)), field->name());
    else
      HELIO_CHECK(check_known(reflection.GetMessage(message, field)), field->name());
  }
  return {};
}

}  // namespace heliograph::server
