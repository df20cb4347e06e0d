// Structured mutation of any message, by its descriptor: a new field is among what is changed. Used
// by convert_fuzz_test and the libFuzzer target.
#pragma once

#include <google/protobuf/message.h>

#include <array>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::fuzz {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;
using Random = std::mt19937_64;

constexpr std::array<double, 12> kNumbers{0,
                                          -0.0,
                                          1,
                                          -1,
                                          0.5,
                                          2,
                                          1e-30,
                                          1e30,
                                          1e300,
                                          -1e300,
                                          std::numeric_limits<double>::infinity(),
                                          std::numeric_limits<double>::quiet_NaN()};
constexpr std::array<u64, 8> kIntegers{0, 1, 2, 3, 255, 65536, 0xffffffffu, ~0ull};

inline double number(Random& random) { return kNumbers[random() % kNumbers.size()]; }
inline u64 integer(Random& random) { return kIntegers[random() % kIntegers.size()]; }

inline std::string bytes(Random& random) {
  std::string out(random() % 65, '\0');
  for (char& c : out) c = char(random() % 4 ? 0 : random());
  return out;
}

inline void mutate(Message& message, Random& random);

/// Gives a field that is no message a new value, appended where it repeats.
inline void set_scalar(Message& message, const FieldDescriptor* field, Random& random) {
  const auto* r = message.GetReflection();
  const bool many = field->is_repeated();
  switch (field->cpp_type()) {
#define HELIO_SET(TYPE, Name, value)                                                    \
  case FieldDescriptor::CPPTYPE_##TYPE:                                                 \
    many ? r->Add##Name(&message, field, value) : r->Set##Name(&message, field, value); \
    return;
    HELIO_SET(INT32, Int32, i32(integer(random)))
    HELIO_SET(INT64, Int64, i64(integer(random)))
    HELIO_SET(UINT32, UInt32, u32(integer(random)))
    HELIO_SET(UINT64, UInt64, integer(random))
    HELIO_SET(DOUBLE, Double, number(random))
    HELIO_SET(FLOAT, Float, float(number(random)))
    HELIO_SET(BOOL, Bool, bool(random() % 2))
    HELIO_SET(ENUM, EnumValue, int(random() % 9))
    HELIO_SET(STRING, String,
              field->type() == FieldDescriptor::TYPE_BYTES ? bytes(random) : std::string("name"))
#undef HELIO_SET
    case FieldDescriptor::CPPTYPE_MESSAGE:
      return;
  }
}

/// Changes, adds or takes away one field somewhere beneath `message`.
inline void mutate(Message& message, Random& random) {
  const auto* descriptor = message.GetDescriptor();
  const auto* r = message.GetReflection();
  if (descriptor->field_count() == 0) return;
  const auto* field = descriptor->field(int(random() % u64(descriptor->field_count())));
  std::vector<const FieldDescriptor*> set;
  r->ListFields(message, &set);
  if (!set.empty() && random() % 4) field = set[random() % set.size()];
  const u64 dice = random() % 16;
  if (dice == 0) return r->ClearField(&message, field);
  if (dice == 1) {
    r->MutableUnknownFields(&message)->AddVarint(int(1 + random() % 200), random());
    return;
  }
  if (field->is_map()) return;
  if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE)
    return set_scalar(message, field, random);
  if (!field->is_repeated()) return mutate(*r->MutableMessage(&message, field), random);
  const int count = r->FieldSize(message, field);
  Message* element = count == 0 || dice < 4
                         ? r->AddMessage(&message, field)
                         : r->MutableRepeatedMessage(&message, field, int(random() % u64(count)));
  mutate(*element, random);
}

}  // namespace heliograph::fuzz
