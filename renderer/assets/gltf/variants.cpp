#include "renderer/assets/gltf/variants.h"

#include <algorithm>

#include "renderer/assets/picture_layers.h"

namespace heliograph::assets::gltf {
namespace {

constexpr const char* kExtension = "KHR_materials_variants";

std::vector<std::string> names_of(const Document& document) {
  std::vector<std::string> names;
  const auto extension = document.root().extension(kExtension);
  if (!extension) return names;
  for (const Value& variant : extension->at("variants").elements())
    names.push_back(variant.at("name").text());
  return names;
}

bool serves(const Value& mapping, u32 variant) {
  return std::ranges::any_of(mapping.at("variants").elements(),
                             [&](const Value& served) { return served.whole() == variant; });
}

}  // namespace

std::optional<u32> choose_variant(const Document& document, Builder& builder) {
  const std::vector<std::string> names = names_of(document);
  const std::string& wanted = builder.options.variant;
  if (wanted.empty()) {
    if (!names.empty()) {
      builder.warn(fmt::format("{}: the default is shown, not {}; choose with variant=", kExtension,
                               listed(names)));
    }
    return std::nullopt;
  }
  const auto found = std::ranges::find(names, wanted);
  if (found == names.end()) {
    refuse_option("variant",
                  fmt::format("the file has no {}; it has {}", clean_name(wanted, "?"),
                              names.empty() ? "none" : listed(names)),
                  Code::kNotFound);
  }
  return u32(found - names.begin());
}

std::optional<Value> material_of(const Value& primitive, std::optional<u32> variant) {
  const auto extension = variant ? primitive.extension(kExtension) : std::nullopt;
  if (extension)
    for (const Value& mapping : extension->at("mappings").elements())
      if (serves(mapping, *variant)) return mapping.at("material");
  return primitive.find("material");
}

std::vector<Value> materials_of(const Value& primitive) {
  std::vector<Value> all;
  if (const auto own = primitive.find("material")) all.push_back(*own);
  if (const auto extension = primitive.extension(kExtension))
    for (const Value& mapping : extension->at("mappings").elements())
      all.push_back(mapping.at("material"));
  return all;
}

}  // namespace heliograph::assets::gltf
