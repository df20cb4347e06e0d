// A COLLADA document: its XML, its ids, and typed reads of its numbers, every range checked.
// Source: Khronos, COLLADA - Digital Asset Schema Release 1.5.0 (2008), and 1.4.1.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <pugixml.hpp>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "renderer/assets/builder.h"
#include "renderer/assets/curves.h"
#include "renderer/assets/mesh_data.h"

namespace heliograph::assets::dae {

using Node = pugi::xml_node;

/// Owns: the XML.
class Document {
 public:
  /// Parses the model of the bundle. What is parsed is paid for first; entities are not expanded.
  explicit Document(Builder& builder);

  [[nodiscard]] Node root() const { return xml_.document_element(); }
  /// The element of this tag that "#id" names; refuses what is not there.
  [[nodiscard]] Node linked(std::string_view url, const char* tag, const std::string& where) const;
  [[nodiscard]] Node find(std::string_view id, const char* tag) const;  // null when it is not there

 private:
  pugi::xml_document xml_;
  std::unordered_map<std::string_view, std::vector<Node>> ids_;
};

/// "geometry 'wheel'", for messages.
[[nodiscard]] std::string place(const Node& node);
/// Its name, else its id.
[[nodiscard]] std::string_view name_of(const Node& node);

/// All numbers of an <float_array>; what a program wrote for a number that is none is NaN.
[[nodiscard]] std::vector<double> read_doubles(const Node& node, Budget& budget);
/// All numbers of an element; finite.
[[nodiscard]] std::vector<float> read_floats(const Node& node, Budget& budget);
/// As many as are asked for.
[[nodiscard]] std::vector<float> read_floats(const Node& node, std::size_t count, Budget& budget);
inline constexpr u32 kNone = ~0u;  // an index that the file gives as -1, or not at all
[[nodiscard]] std::vector<u32> read_indices(const Node& node, Budget& budget,
                                            bool may_be_none = false);
/// An attribute that is a whole number; refuses others.
[[nodiscard]] u32 whole_attribute(const Node& node, const char* name, u32 absent);
/// Place of an <input>'s index among those of a corner or an influence.
[[nodiscard]] u32 offset_of(const Node& input);

// materials.cpp
/// A material of the document, once for each that geometries use: <material> element to library.
using Materials = std::map<Node, Ref>;
[[nodiscard]] Materials load_materials(const Document& document, Builder& builder,
                                       const std::vector<Node>& used);

// scene.cpp
/// A node of the scene; one that is shown in several places is there as often.
struct Placed {
  Node node;
  std::optional<u32> parent;
  u32 end = 0;     // behind the nodes below it, which follow it
  mat4x3 pose{1};  // parent_from_node
};
/// A geometry where a node shows it.
struct Shown {
  Node geometry;
  std::string name;
  mat4x3 pose{1};                        // scene_from_geometry
  std::map<std::string, Node> material;  // by symbol
  u32 node = 0;                          // of the scene
  bool stands =
      false;         // in the scene, whatever its node does: as a skin has it that gives no weights
  Node instance;     // the element that shows it
  Node skin, morph;  // that deform it
};
struct Scene {
  std::vector<Placed> nodes;
  std::vector<Shown> shown;
};
/// Every geometry of the document's scene, with the transforms of the nodes above it.
[[nodiscard]] Scene read_scene(const Document& document, Builder& builder);

// controllers.cpp
/// How a skin and morph targets deform a geometry, by the rows of its positions.
struct Deformation {
  std::vector<std::string> joints;
  mat4x3 bind{1};                     // scene_from_geometry, of what has no joints in the scene
  std::vector<mat4x3> inverse_binds;  // joint_from_geometry at rest
  MeshData skin;                      // its joints and weights
  std::vector<std::vector<vec3>> targets;  // what a weight of 1 adds to positions
  std::vector<float> target_weights;       // at rest
};
[[nodiscard]] Deformation read_deformation(const Document& document, Builder& builder,
                                           const Shown& shown);
/// Rows of <source>s within a controller or an animation: `width` numbers of each.
[[nodiscard]] std::vector<float> read_rows(const Document& document, const Node& input, u32 width,
                                           Budget& budget);
[[nodiscard]] std::vector<std::string> read_names(const Document& document, const Node& input,
                                                  Budget& budget);
[[nodiscard]] Node input_of(const Node& element, const char* semantic);      // null: it has none
[[nodiscard]] Node needed_input(const Node& element, const char* semantic);  // refused: it has none

// deform.cpp
/// The rows of sources that a vertex is of.
struct Rows {
  u32 position, normal;
};
/// Gives a mesh the joints, weights and morph targets of its vertices. Normals of targets are those
/// of their faces, smooth where the mesh's own are.
void deform(MeshData& mesh, const Deformation& deformation, std::span<const Rows> rows,
            Budget& budget);

// geometry.cpp
struct Geometry {
  Ref mesh;
  std::vector<std::string> symbols;  // of materials, by part
  glm::dvec3 centre{0};              // that its vertices are about
  bool colored = false;
  std::shared_ptr<const Deformation> deformation;  // null: it is rigid
};
/// nullopt: it has no faces.
[[nodiscard]] std::optional<Geometry> load_geometry(
    const Document& document, Builder& builder, const Node& geometry,
    std::shared_ptr<const Deformation> deformation = {});

// looks.cpp
/// Appearance of an entity that shows something: its mesh and materials.
struct Look {
  PutEntity put;
  Geometry geometry;
};
/// Adds materials and meshes to the library; nullopt for what has no faces. Empty: a companion is
/// missing.
[[nodiscard]] std::vector<std::optional<Look>> load_looks(const Document& document,
                                                          Builder& builder,
                                                          const std::vector<Shown>& all);

/// A pose of vertices that are about `centre`.
[[nodiscard]] inline mat4x3 about(const glm::dvec3& centre, mat4x3 pose) {
  pose[3] = vec3(glm::dmat4x3(pose) * glm::dvec4(centre, 1));
  return pose;
}

// samplers.cpp
/// Curve of a <sampler>: `width` numbers per key, linear between them. `angle`: which of them
/// turns, by degrees. nullopt: it has no keys.
[[nodiscard]] std::optional<Curve> read_curve(const Document& document, Builder& builder,
                                              const Node& sampler, u32 width,
                                              std::optional<u32> angle);

// clips.cpp
/// A channel's curve, and what it moves: numbers `first` and on of a transformation or of the
/// weights of a morph.
struct Channel {
  Node target;
  u32 first = 0;
  Curve curve;
};
struct Clip {
  std::string name;
  double start, end;  // seconds; what lies outside is cut off
  std::vector<Channel> channels;
};
/// Clips that move something that the scene shows.
[[nodiscard]] std::vector<Clip> read_clips(const Document& document, Builder& builder,
                                           const Scene& scene);

// moving.cpp
/// Nodes as entities, which skins and clips move. `world` turns the file's axes and unit to ours.
void put_moving(const Document& document, Builder& builder, const Scene& scene,
                const std::vector<Clip>& clips, const mat4x3& world);

}  // namespace heliograph::assets::dae
