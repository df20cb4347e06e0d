// Parts of a scene, as plain values. Read by every backend; changed only through
// Transactions.
#pragma once

#include <array>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "kernels/scene/camera_view.h"
#include "kernels/scene/material_parameters.h"
#include "renderer/base/array.h"
#include "renderer/scene/ids.h"

namespace heliograph {

// ---------------------------------------------------------------- textures and materials

enum class TexelType : u8 { kU8, kU16, kF16, kF32 };
enum class Wrap : u8 { kRepeat, kClamp, kMirror };

/// Texels as in the source: bit depth and channels are kept. Row 0 is the top.
struct ImageData {
  BufferPtr texels;
  u32 width = 0;
  u32 height = 0;
  u32 channels = 0;  // 1..4
  TexelType type = TexelType::kU8;
};

struct Texture {
  std::shared_ptr<const ImageData> image;
  bool srgb = false;
  bool nearest = false;
  Wrap wrap_u = Wrap::kRepeat;
  Wrap wrap_v = Wrap::kRepeat;
};

/// value = texel[channel] * scale + offset, looked up at uv_transform * (u, v, 1); v = 0 is the
/// bottom row.
struct TextureUse {
  TextureId texture;
  u32 uv_set = 0;
  u32 channel = 0;
  float scale = 1;
  float offset = 0;
  glm::mat3x2 uv_transform{1, 0, 0, 1, 0, 0};
};

enum class MaterialParameter : u32 {
#define HELIO_PARAMETER(name, ...) name,
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
      kCount
};
inline constexpr std::size_t kMaterialParameters = std::size_t(MaterialParameter::kCount);

struct Parameter {
  vec3 value{0};  // scalars use x
  TextureUse texture;
};

enum class AlphaMode : u8 { kOpaque, kMask, kBlend };

struct Material {
  std::array<Parameter, kMaterialParameters> parameters;  // defaults: make_material()
#define HELIO_MAP(name) TextureUse name;
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  AlphaMode alpha_mode = AlphaMode::kOpaque;
  float alpha_cutoff = 0.5f;
  bool two_sided_emission = false;
  bool unlit = false;
  bool thin_walled = false;
  i32 priority = 0;  // of the body inside, where others overlap it

  [[nodiscard]] Parameter& operator[](MaterialParameter p) { return parameters[std::size_t(p)]; }
  [[nodiscard]] const Parameter& operator[](MaterialParameter p) const {
    return parameters[std::size_t(p)];
  }
};

/// A material with the default of every parameter.
[[nodiscard]] Material make_material();

// ---------------------------------------------------------------- meshes

struct Keypoint {
  std::string name;
  vec3 position{0};
};
struct Symmetry {
  std::optional<mat4> matrix;  // discrete, or
  vec3 axis{0};                // any rotation about this axis
  vec3 offset{0};
};

/// Shapes of lights, in the wire's order, and what rays meet of the meshes that stand for them.
#define HELIO_LIGHT_SHAPES(X) X(kSphere, kSphere) X(kDisc, kDisc) X(kRectangle, kTriangles)

/// Shapes that a light's radiance leaves from: the entity's mesh, or others.
enum class LightShape : u8 {
  kMesh,
#define HELIO_SHAPE(name, primitive) name,
  HELIO_LIGHT_SHAPES(HELIO_SHAPE)
#undef HELIO_SHAPE
};

/// Parts of a mesh that stay when vertices move. Arrays are per vertex unless they state otherwise.
struct MeshTopology {
  u32 vertex_count = 0;
  ArrayOf<uvec3> triangles;  // vertex indices, checked; of curves as kernels::MeshView has them
  ArrayOf<vec2> uvs;         // empty, or vertex_count
  ArrayOf<vec2> uvs1;
  ArrayOf<vec4> colors;
  ArrayOf<vec4> tangents;
  ArrayOf<u32> parts;  // per triangle; empty: all 0
  u32 part_count = 1;
  std::vector<std::string> part_names;
  ArrayOf<glm::u16vec4> joints;
  ArrayOf<vec4> weights;
  u32 morph_count = 0;
  ArrayOf<vec3> morph_positions;  // morph_count * vertex_count
  ArrayOf<vec3> morph_normals;    // empty, or as many
  std::vector<Keypoint> keypoints;
  ArrayOf<uvec2> skeleton;
  std::vector<Symmetry> symmetries;
  LightShape shape = LightShape::kMesh;  // that its triangles stand for (light_shapes.h)
  // Curves only (strands.h); empty: triangles.
  ArrayOf<u32> curves;   // points of each strand; they follow each other
  ArrayOf<float> radii;  // metres, of the spheres about the points

  /// The buffers of all arrays; null where one is empty.
  [[nodiscard]] auto buffers() const {
    return std::apply([](const auto&... a) { return std::array{a.buffer()...}; },
                      std::tie(triangles, uvs, uvs1, colors, tangents, parts, joints, weights,
                               morph_positions, morph_normals, skeleton, curves, radii));
  }
};

/// Positions and normals at one or more times, in mesh coordinates.
struct VertexKeys {
  std::vector<Time> times;  // strictly increasing; one entry when static
  ArrayOf<vec3> positions;  // times.size() * vertex_count
  ArrayOf<vec3> normals;    // empty (flat), or as many
};

struct Mesh {
  std::shared_ptr<const MeshTopology> topology;
  std::shared_ptr<const VertexKeys> vertices;
  bool reshaped = false;  // these took the place of other vertices: others may soon take theirs
};

// ---------------------------------------------------------------- volumes

inline constexpr i32 kBrickSide = 8;
inline constexpr u32 kBrickVoxels = 512;

/// A sparse field: voxels in bricks, 0 where there is no brick. Made by dense_grid() or from
/// bricks.
struct Grid {
  u32 channels = 1;       // 1 or 3
  ivec3 lower{0};         // the first voxel of its box, and
  ivec3 upper{0};         // one past the last
  ArrayOf<ivec3> bricks;  // increasing in (x, y, z); the first voxel of a brick is 8 times this
  ArrayOf<float> values;  // kBrickVoxels * channels a brick, z fastest of the voxels
  mat4x3 object_from_voxel{1};
};

/// A participating medium; null: no such grid.
struct Volume {
  std::shared_ptr<const Grid> density;      // one channel, >= 0
  std::shared_ptr<const Grid> temperature;  // one channel, >= 0
  std::shared_ptr<const Grid> color;        // three channels
  float density_scale = 1;                  // 1/m
  vec3 albedo{0.8f};
  float anisotropy = 0;
  float temperature_scale = 1;  // kelvin
  float emission_scale = 1;
};

// ---------------------------------------------------------------- entities

/// An affine pose relative to the parent. The exact matrix the client gave.
struct PoseKey {
  Time time = 0;
  mat4x3 matrix{1};
};
using PoseKeys = std::vector<PoseKey>;  // strictly increasing times, at least two

enum class LightUnit : u8 {
  kRadiance,
  kPower,
  kLuminance,
  kLumen,
  kIrradiance,    // suns only
  kIlluminance,   // suns only
  kIntensity,     // shapes only
  kCandela,       // shapes only
  kProfileScale,  // of the profile's candela
};

struct Light {
  vec3 color{1};
  float intensity = 1;
  LightUnit unit = LightUnit::kRadiance;
  float exposure = 0;
  float temperature = 0;  // 0: none
  bool two_sided = false;
  float sun_angle = 0;  // radians, diameter; 0: no sun
  LightShape shape = LightShape::kMesh;
  float radius = 1;             // metres, of spheres and discs
  float width = 1, height = 1;  // metres, of rectangles along x and y
  // Half angles of a spot light's cone about the entity's -Z axis, radians: full up to the inner
  // one, none from the outer one on. 0: no cone.
  float inner_cone_angle = 0, outer_cone_angle = 0;
  TextureUse texture;
  TextureId profile;  // intensities by direction; null: none
};

/// A rectangle that the dome shines through along the entity's -Z axis; metres.
struct Portal {
  float width = 1, height = 1;
};

/// A linear colour sensor; a signal of 1 fills its wells.
struct RgbSensor {
  /// Colours of the photosites, two by two, row by row.
  enum class Pattern : u8 { kNone, kRggb, kBggr, kGrbg, kGbrg };
  double exposure = 0;    // stops
  double full_well = 0;   // electrons; 0: no photon noise
  double read_noise = 0;  // electrons
  double black_level = 0;
  u32 bits = 0;           // 0: not quantised
  double vignetting = 0;  // share of the cosine fourth law
  Pattern pattern = Pattern::kNone;
};

/// A depth camera. Lengths in metres, widths and disparities in pixels.
struct DepthSensor {
  enum class Kind : u8 { kActiveStereo, kTimeOfFlight };
  Kind kind = Kind::kActiveStereo;
  double baseline = 0;  // to the projector at +x
  double disparity_noise = 0;
  double disparity_step = 0;  // 0: not quantised
  double lateral_noise = 0;
  double range_noise = 0;  // at a signal of 1
  u32 window = 1;
  double min_signal = 0;
  double max_angle = 0.5 * 3.14159265358979323846;
  double min_depth = 0, max_depth = 0;  // max 0: none
};

using kernels::Projection;

/// When a camera sees, in seconds relative to the frame's time. Rows are read from the top to the
/// bottom; each is open from `open` to `close`, the last one `rolling` later than the first. Of a
/// ray table with times, `rolling` is the last of these.
struct Shutter {
  double open = 0;
  double close = 0;
  double rolling = 0;

  friend bool operator==(const Shutter&, const Shutter&) = default;
};

struct RayTable;

/// OpenCV intrinsics at the calibrated size: integers are pixel centres.
struct Camera {
  u32 width = 0;
  u32 height = 0;
  Projection projection = Projection::kPerspective;
  double fx = 0, fy = 0, cx = 0, cy = 0;
  std::shared_ptr<const RayTable> rays;  // of kRayTable, whose fx and fy are 0; otherwise null
  std::array<double, 8> distortion{};    // OpenCV's order: k1 k2 p1 p2 k3 k4 k5 k6; fisheye: k1..k4
  double aperture = 0;                   // metres, diameter; 0: a pinhole
  double focus_distance = 0;             // metres along the optical axis
  u32 blades = 0;                        // 0: round
  double blade_rotation = 0;             // radians
  double near = 0, far = 0;              // metres, where rays start and end; far 0: they do not end
  std::optional<RgbSensor> rgb_sensor;
  std::optional<DepthSensor> depth_sensor;
  Shutter shutter;
};

/// Kinds of rays that meet an entity. Bits of Entity::visibility and of a ray's mask.
enum RayMask : u8 {
  kCameraRay = 1,
  kDiffuseRay = 2,
  kGlossyRay = 4,
  kTransmissionRay = 8,
  kShadowRay = 16,
  kVolumeRay = 32,
  kAllRays = 63,
};

struct Skin {
  std::vector<EntityId> joints;
  std::vector<mat4x3> inverse_binds;  // joint_from_mesh in the bind pose
};
struct MorphWeights {
  std::vector<Time> times;     // empty: constant
  std::vector<float> weights;  // max(1, times.size()) * morph_count
};

/// An entity's own statement of labels; label_entities() finds what it inherits.
struct Label {
  u32 value = 0;     // 0 with `set`: opted out
  bool set = false;  // false: inherits from the nearest labelled ancestor
  bool group = false;
  u32 part = 0;      // 0: automatic
  u32 category = 0;  // class id; 0: none

  friend bool operator==(const Label&, const Label&) = default;
};

using Attributes = std::map<std::string, std::string>;

/// One entity, but for its pose, which has a table of its own because it changes most.
struct Entity {
  std::shared_ptr<const std::string> name;  // null: none
  EntityId parent;
  MeshId mesh;
  VolumeId volume;
  // By part; the last one serves all further parts. Null, or an id that is null: make_material().
  std::shared_ptr<const std::vector<MaterialId>> materials;
  std::shared_ptr<const PoseKeys> keys;  // null: the pose is constant
  std::shared_ptr<const Light> light;
  std::shared_ptr<const Portal> portal;
  std::shared_ptr<const Camera> camera;
  std::shared_ptr<const Skin> skin;
  std::shared_ptr<const MorphWeights> morph_weights;
  std::shared_ptr<const Attributes> attributes;
  std::shared_ptr<const std::string> light_group;  // of all its light; null: ""
  Label label;
  u32 children = 0;    // entities whose parent this is
  u32 skins = 0;       // times that skins name this as a joint
  u64 teleported = 0;  // Snapshot::advances when its pose last jumped
  u8 visibility = kAllRays;
  bool visible = true;
  bool is_static = false;  // may be traced as one mesh with the other static ones
  bool shadow_catcher = false;

  /// The same fields; what they point to is compared by address.
  friend bool operator==(const Entity&, const Entity&) = default;
};

/// A named, shared payload: the row of meshes, materials, textures and volumes.
template <class T>
struct Shared {
  std::shared_ptr<const std::string> name;  // null: none
  std::shared_ptr<const T> value;
  u32 uses = 0;  // references from entities, materials and the dome
};

// ---------------------------------------------------------------- scene settings

struct Dome {
  TextureId texture;
  std::optional<vec3> color;  // unset: 1 with a texture, else 0
  float intensity = 1;
  mat3 world_from_dome{1};
  bool camera_visible = true;
  std::string light_group;
};

}  // namespace heliograph
