// A COLLADA document: its XML, its ids, and typed reads of its numbers, every range checked.
// Source: Khronos, COLLADA - Digital Asset Schema Release 1.5.0 (2008), and 1.4.1.
#pragma once

#include <map>
#include <pugixml.hpp>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "renderer/assets/builder.h"

namespace heliograph::assets::dae {

using Node = pugi::xml_node;

/// Owns: the XML.
class Document {
 public:
  /// Parses the model of the bundle. What is parsed is paid for first; entities are not expanded.
  explicit Document(Builder& builder);

  [[nodiscard]] Node root() const { return xml_.document_element(); }
  /// The element that "#id" names, of one of the two tags; refuses what is not there.
  [[nodiscard]] Node linked(std::string_view url, const char* tag, const std::string& where) const;
  [[nodiscard]] Node find(std::string_view id, const char* tag) const;  // null when it is not there

 private:
  pugi::xml_document xml_;
  std::unordered_map<std::string_view, std::vector<Node>> ids_;
};

/// "geometry 'wheel'", for messages.
[[nodiscard]] std::string place(const Node& node);

/// All numbers of an <float_array>; what a program wrote for a number that is none is NaN.
[[nodiscard]] std::vector<double> read_doubles(const Node& node, Budget& budget);
/// All numbers of an element; finite.
[[nodiscard]] std::vector<float> read_floats(const Node& node, Budget& budget);
/// As many as are asked for.
[[nodiscard]] std::vector<float> read_floats(const Node& node, std::size_t count, Budget& budget);
[[nodiscard]] std::vector<u32> read_indices(const Node& node, Budget& budget);
/// An attribute that is a whole number; refuses others.
[[nodiscard]] u32 whole_attribute(const Node& node, const char* name, u32 absent);

// materials.cpp
/// A material of the document, once for each that geometries use: <material> element to library.
using Materials = std::map<Node, Ref>;
[[nodiscard]] Materials load_materials(const Document& document, Builder& builder,
                                       const std::vector<Node>& used);

// geometry.cpp
struct Geometry {
  Ref mesh;
  std::vector<std::string> symbols;  // of materials, by part
  glm::dvec3 centre{0};              // that its vertices are about
  bool colored = false;
};
/// nullopt: it has no faces.
[[nodiscard]] std::optional<Geometry> load_geometry(const Document& document, Builder& builder,
                                                    const Node& geometry);

// scene.cpp
/// A geometry where a node shows it.
struct Shown {
  Node geometry;
  std::string name;
  mat4x3 pose{1};                        // scene_from_geometry
  std::map<std::string, Node> material;  // by symbol
};
/// Every geometry of the document's scene, with the transforms of the nodes above it.
[[nodiscard]] std::vector<Shown> read_scene(const Document& document, Builder& builder);

}  // namespace heliograph::assets::dae
