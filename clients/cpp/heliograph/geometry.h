// Parts of meshes, textures, volumes and the dome, and the bundled shapes.
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/array.h"
#include "heliograph/pose.h"

namespace heliograph::client {

/// A motion that maps a mesh onto itself: a matrix, or any rotation about an axis through a point.
struct Symmetry {
  std::optional<Mat4> matrix{};
  std::optional<Vec3> axis{};
  Vec3 offset{};
};

/// A mesh's arrays; what is empty is not sent. The vertices (positions, times, normals) and the
/// topology (all else) are each one value: positions alone keep the topology, so that flow and
/// labels follow the surface. Floats are f32 or f64.
struct Geometry {
  Array positions{};            // (V, 3) metres, or (K, V, 3) at `times`
  Array indices{};              // (F, 3) u32, counter-clockwise seen from outside
  Array normals{};              // (V, 3), or (K, V, 3); none: flat
  Array uvs{};                  // (V, 2)
  Array uvs1{};                 // (V, 2)
  std::vector<double> times{};  // seconds, increasing
  Array colors{};               // (V, 3) or (V, 4): f32 linear, or u8, u16 normalised
  Array tangents{};             // (V, 4)
  Array parts{};                // (F,) u32 from 0
  std::vector<std::string> part_names{};
  Array joints{};                           // (V, 4) u16
  Array weights{};                          // (V, 4)
  Array morph_positions{};                  // (T, V, 3)
  Array morph_normals{};                    // (T, V, 3)
  std::map<std::string, Vec3> keypoints{};  // in mesh coordinates
  Array skeleton{};                         // (E, 2) u32, edges between keypoints
  std::vector<Symmetry> symmetries{};
  // Instead of indices, round curves through the positions: hairs, cables, grass. docs/curves.md
  Array curves{};  // (S,) u32, points of each strand
  Array radii{};   // (V,) metres
};

/// A texture: a picture and how it is read. What is empty stays, or is the default of a new one.
struct Image {
  enum class Encoding : int { kLinear = 1, kSrgb = 2 };
  enum class Wrap : int { kRepeat = 1, kClamp = 2, kMirror = 3 };
  enum class Filter : int { kLinear = 1, kNearest = 2 };

  /// (H, W) or (H, W, C), row 0 at the top: u8 and u16 are normalised, f16 and f32 are as they are.
  Array texels{};
  std::string path{};   // instead: a file, which the daemon decodes; .ies: a luminaire's candela
  std::string layer{};  // of a file with several: "diffuse" of diffuse.R, a part, or a channel
  std::optional<Encoding> encoding{};  // default: u8 is sRGB
  std::optional<Wrap> wrap_u{};
  std::optional<Wrap> wrap_v{};
  std::optional<Filter> filter{};
};

/// A volume: grids that fill one box, which begins at `origin` and has the density's voxels. What
/// is empty stays. docs/volumes.md.
struct Medium {
  Array density{};           // (X, Y, Z) f32 >= 0
  Array temperature{};       // (X, Y, Z) f32 >= 0; needs density with it
  Array color{};             // (X, Y, Z, 3) f32 in [0, 1], multiplies albedo; needs density with it
  Vec3 voxel_size{1, 1, 1};  // metres
  Vec3 origin{};             // metres, corner of voxel (0, 0, 0)
  std::optional<double> density_scale{};      // 1/m, extinction of density 1; 1
  std::optional<Color> albedo{};              // share of the extinction that scatters; 0.8
  std::optional<double> anisotropy{};         // [-0.99, 0.99]; 0
  std::optional<double> temperature_scale{};  // kelvin of temperature 1; 1
  std::optional<double> emission_scale{};     // 1
  std::vector<std::string> reset{};           // names that go back to their defaults
};

/// The light from infinitely far; what is empty stays.
struct Dome {
  Image image{};                      // lat-long, row 0 at +Z
  std::optional<Color> color{};       // radiance; multiplies the image
  std::optional<double> intensity{};  // a factor
  std::optional<Mat3> rotation{};     // world_from_dome
  std::optional<bool> camera_visible{};
  std::optional<std::string> light_group{};
  std::vector<std::string> reset{};  // names that go back to their defaults: "texture", "color", ..
};

/// Bundled meshes: metres, centred on the origin, +Z up, with normals and texture coordinates.
namespace shapes {
Geometry plane(double size = 1);  // faces +Z
Geometry cube(double size = 1);
Geometry sphere(double radius = 0.5, int segments = 64);
Geometry torus(double radius = 0.35, double tube = 0.15, int segments = 96);
Geometry cylinder(double radius = 0.5, double height = 1, int segments = 64);
}  // namespace shapes

}  // namespace heliograph::client
