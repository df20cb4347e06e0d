// glTF 2.0 to an asset: the order of the steps. Chosen by load.cpp.
//
// The root entity is the user's: its pose is left alone. Below it the entity "z_up" turns glTF's +Y
// up to the world's +Z, and the scene's nodes hang below that.
#include "renderer/assets/gltf/animation.h"
#include "renderer/assets/gltf/draco.h"

namespace heliograph::assets {
namespace {

/// The default materials are shown; those of variants are in the asset, where the `materials` of an
/// import can put them instead.
void name_variants(const gltf::Document& document, Builder& builder) {
  const auto extension = document.root().extension("KHR_materials_variants");
  if (!extension) return;
  std::string names;
  const gltf::Value variants = extension->at("variants");
  for (std::size_t i = 0; i < variants.size(); ++i)
    names += (i == 0 ? "'" : ", '") + clean_name(variants[i].at("name").text(), "?") + "'";
  builder.warn(fmt::format("KHR_materials_variants: the default is shown, not {}", names));
}

}  // namespace

void load_gltf(Builder& builder) {
  using namespace gltf;
  Document document(builder);
  if (builder.complete()) unpack_draco(document, builder.budget);
  name_variants(document, builder);
  const Materials materials = load_materials(document, builder, any_without_material(document));
  Library library{.meshes = {}, .profiles = load_profiles(document, builder)};
  if (!builder.complete()) return;
  const std::vector<Node> nodes = read_nodes(document, builder);
  library.meshes = load_meshes(document, builder, materials);
  const Entities entities = make_entities(document, builder, nodes, library);
  builder.loaded.asset.animations =
      load_animations(document, builder, nodes, entities, library.meshes);
}

}  // namespace heliograph::assets
