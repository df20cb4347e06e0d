// Model that a file of one mesh becomes: OBJ, PLY and STL. Parts of it serve COLLADA too.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "renderer/assets/builder.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets {

/// True for a part without a material.
[[nodiscard]] inline bool is_nothing(const Ref& ref) {
  return std::holds_alternative<std::monostate>(ref);
}

/// A mesh that is not placed yet.
struct Model {
  MeshData mesh;                      // without positions
  std::vector<glm::dvec3> positions;  // axes and unit of the file
  std::vector<Ref> materials;         // by part
  std::string where;                  // for messages
};

/// Turns to +Z up, scales to metres, and adds the mesh and its entity. Parts without a material are
/// white where vertices have colours, which so are not tinted by the default grey.
void put_model(Builder& builder, Model model);

/// f64 positions as f32 about `centre`, which is 0 unless f32 would lose more than 1e-5 of their
/// extent, as with map coordinates; then a warning states the centre.
struct Centred {
  std::vector<vec3> positions;
  glm::dvec3 centre{0};
};
[[nodiscard]] Centred centred(std::span<const glm::dvec3> positions, Builder& builder);

/// The material of what has colours of vertices and no other: white takes them as they are.
class White {
 public:
  /// Puts it wherever there is none; adds it to the library when it is first needed.
  void fill(std::vector<Ref>& materials, Builder& builder);

 private:
  Ref made_;
};

/// Colours in [0, 1]. Those of 0 to 255 are scaled, and others above 1 cut off, with a warning.
/// Returns whether they were of 0 to 255.
bool clamp_colors(std::vector<vec4>& colors, Builder& builder);
/// Makes sRGB colours linear; alpha stays.
void make_linear(std::vector<vec4>& colors);

}  // namespace heliograph::assets
