// Parameters to a Material, by the names of its fields.
#include "wire/convert.h"

namespace heliograph::client::wire {
namespace {

using Field = google::protobuf::FieldDescriptor;

/// Puts one parameter into its field.
struct Put {
  const Draft& draft;
  const std::string& name;
  const Field* field;
  v1::Material* out;

  template <class Message>
  [[nodiscard]] Message* message() const {
    return static_cast<Message*>(out->GetReflection()->MutableMessage(out, field));
  }

  void operator()(std::monostate) const { out->add_clear(name); }
  void operator()(bool value) const { out->GetReflection()->SetBool(out, field, value); }
  void operator()(double value) const { out->GetReflection()->SetFloat(out, field, float(value)); }
  void operator()(std::int32_t value) const { out->GetReflection()->SetInt32(out, field, value); }
  void operator()(AlphaMode mode) const {
    out->GetReflection()->SetEnumValue(out, field, int(mode));
  }
  void operator()(const TextureUse& use) const {
    put_texture_use(use, draft, name, message<v1::TextureUse>());
  }
  // A constant unbinds the texture.
  void operator()(const ScalarParameter& parameter) const {
    auto* to = message<v1::ScalarParameter>();
    to->mutable_texture();
    if (const auto* use = std::get_if<TextureUse>(&parameter)) {
      put_texture_use(*use, draft, name, to->mutable_texture());
      to->set_value(float(use->factor.r));
    } else {
      to->set_value(float(std::get<double>(parameter)));
    }
  }
  void operator()(const ColorParameter& parameter) const {
    auto* to = message<v1::ColorParameter>();
    to->mutable_texture();
    if (const auto* use = std::get_if<TextureUse>(&parameter)) {
      put_texture_use(*use, draft, name, to->mutable_texture());
      *to->mutable_value() = to_proto(use->factor);
    } else {
      *to->mutable_value() = to_proto(std::get<Color>(parameter));
    }
  }
};

}  // namespace

void put_material(const Parameters& parameters, const Draft& draft, v1::Material* out) {
  for (const auto& [name, value] : parameters.values()) {
    const Field* field = v1::Material::descriptor()->FindFieldByName(name);
    if (field == nullptr)
      throw ClientError(Code::kInvalidArgument,
                        name + ": a material has no such parameter; docs/materials.md lists them",
                        {name});
    std::visit(Put{draft, name, field, out}, value);
  }
}

}  // namespace heliograph::client::wire
