// Which materials are shown where a file has several sets of them.
// Source: KHR_materials_variants.
#pragma once

#include "renderer/assets/gltf/document.h"

namespace heliograph::assets::gltf {

/// The variant that the options name; nothing: the file's default, with a warning that lists the
/// variants. NOT_FOUND lists them when none is called so.
[[nodiscard]] std::optional<u32> choose_variant(const Document& document, Builder& builder);

/// The material of a primitive: what it maps the variant to, else its own; nothing: it has none.
[[nodiscard]] std::optional<Value> material_of(const Value& primitive, std::optional<u32> variant);

/// All that any variant shows of a primitive, its own included.
[[nodiscard]] std::vector<Value> materials_of(const Value& primitive);

}  // namespace heliograph::assets::gltf
