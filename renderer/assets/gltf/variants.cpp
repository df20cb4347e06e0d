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
  const Value variants = extension->at("variants");
  for (std::size_t i = 0; i < variants.size(); ++i) names.push_back(variants[i].at("name").text());
  return names;
}

bool serves(const Value& mapping, u32 variant) {
  const Value variants = mapping.at("variants");
  for (std::size_t i = 0; i < variants.size(); ++i) {
    if (variants[i].whole() == variant) return true;
  }
  return false;
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
  if (extension) {
    const Value mappings = extension->at("mappings");
    for (std::size_t i = 0; i < mappings.size(); ++i) {
      if (serves(mappings[i], *variant)) return mappings[i].at("material");
    }
  }
  return primitive.find("material");
}

}  // namespace heliograph::assets::gltf
