// glTF 2.0 to an asset: the order of the steps. Chosen by load.cpp.
//
// The root entity is the user's: its pose is left alone. Below it the entity "z_up" turns glTF's +Y
// up to the world's +Z, and the scene's nodes hang below that.
#include "renderer/assets/gltf/animation.h"
#include "renderer/assets/gltf/draco.h"
#include "renderer/assets/gltf/variants.h"

namespace heliograph::assets {
void load_gltf(Builder& builder) {
  using namespace gltf;
  Document document(builder);
  if (builder.complete()) unpack_draco(document, builder.budget);
  const auto variant = choose_variant(document, builder);
  Materials materials = load_materials(document, builder, any_without_material(document, variant));
  materials.variant = variant;
  Library library{.meshes = {}, .profiles = load_profiles(document, builder)};
  if (!builder.complete()) return;
  const std::vector<Node> nodes = read_nodes(document, builder);
  library.meshes = load_meshes(document, builder, materials);
  const Entities entities = make_entities(document, builder, nodes, library);
  builder.loaded.asset.animations =
      load_animations(document, builder, nodes, entities, library.meshes);
}

}  // namespace heliograph::assets
