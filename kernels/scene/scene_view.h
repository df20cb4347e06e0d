// The plain data a device sees: a scene at one instant. Filled by a backend, read by every kernel.
#pragma once

#include "kernels/scene/camera_view.h"
#include "kernels/scene/material_parameters.h"

namespace heliograph::kernels {

// ---------------------------------------------------------------- textures

enum class TexelType : u8 { kU8, kU16, kF16, kF32 };
enum class Wrap : u8 { kRepeat, kClamp, kMirror };

/// Texels in their source's bit depth, row 0 at the top (v = 1).
struct TextureView {
  const void* texels;
  const void* mips;  // the same at half the size, at a quarter, ... one after the other; or null
  u32 width;
  u32 height;
  u8 channels;  // 1..4
  TexelType type;
  bool srgb;  // decode before filtering; the fourth channel (of 2 or 4: the last) stays linear
  bool nearest;
  Wrap wrap_u;
  Wrap wrap_v;
};

/// value = texel[channel] * scale + offset at uv' = uv_x * u + uv_y * v + uv_offset.
struct TextureUseView {
  u32 texture;  // kNone: none
  u32 uv_set;
  u32 channel;
  float scale;
  float offset;
  vec2 uv_x;
  vec2 uv_y;
  vec2 uv_offset;
};

// ---------------------------------------------------------------- materials

template <int N, class F = float>
struct ParameterType;
template <class F>
struct ParameterType<1, F> {
  using type = F;
};
template <class F>
struct ParameterType<3, F> {
  using type = glm::vec<3, F>;
};

/// One value of every parameter: base_color, metallic, ...
template <class F>
struct MaterialValuesOf {
#define HELIO_PARAMETER(name, components, ...) typename ParameterType<components, F>::type name;
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
};
using MaterialValues = MaterialValuesOf<float>;

/// Bits of ParameterBit.
using ParameterSet = u64;
enum class ParameterBit : u32 {
#define HELIO_PARAMETER(name, ...) name,
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
      kCount
};
static_assert(u32(ParameterBit::kCount) <= 8 * sizeof(ParameterSet));
template <class... Bits>
KERNEL constexpr ParameterSet parameters(Bits... bits) {
  return (... | (ParameterSet(1) << u32(bits)));
}

enum class AlphaMode : u8 { kOpaque, kMask, kBlend };

struct MaterialView {
  MaterialValues constant;
  ParameterSet textured;  // parameters that have a texture; their uses follow each other in order
  u32 first_use;          // index into SceneView::texture_uses
#define HELIO_MAP(name) TextureUseView name;
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  float alpha_cutoff;
  AlphaMode alpha_mode;
  bool two_sided_emission;
  bool unlit;
  bool thin_walled;
  bool passable;  // is_passable()
  i32 priority;   // of the body inside, where others overlap it
  u32 id;         // the plane "material": index of the material object in the scene
};

// ---------------------------------------------------------------- geometry

/// Primitives of a mesh that rays meet: triangles, the shape that it stands for (shape.h), or round
/// segments of its strands (curve.h). primitive.h has a type for each kind.
enum class Shape : u8 { kTriangles, kDisc, kSphere, kCurves };

/// A mesh as it is at this instant, in object space. Null: there is none. One that deforms while
/// the shutter is open has positions and normals at segments + 1 equidistant times, one after the
/// other.
struct MeshView {
  const uvec3* triangles;  // of curves: points a, b, a of each segment, those of a strand in a row
  const vec3* positions;
  const vec3* normals;         // flat shading without
  const vec3* rest_positions;  // the first key without morph or skin: what labels measure
  const vec2* uvs;
  const vec2* uvs1;
  const vec4* colors;
  const vec4* tangents;  // w: handedness
  const u32* parts;      // per triangle
  // Curves only, per point: a vector across the strand at rest, of any length, and its radius.
  const vec4* strand_points;
  u32 triangle_count;
  u32 vertex_count;
  u32 part_count;
  u32 segments;  // 0: it does not deform
  Shape shape;
  bool uvs_around;  // of curves: v of the first set goes around the strand, see uvs_at()
};

enum InstanceFlag : u32 {
  kFlipped = 1,      // world_from_object mirrors: front and back change places
  kMayBeHole = 2,    // some material of it is not opaque: accepts() decides
  kFlowInvalid = 4,  // created or teleported within the flow interval
  kCatcher = 8,      // a shadow catcher
  kOnePart = 16,     // all of it is the part `part`
};

/// An entity that shows a mesh, wherever it is.
struct SlotView {
  u32 mesh;
  u32 first_part;   // its parts' rows in SceneView::part_materials and part_lights
  u32 flags;        // InstanceFlag
  u32 visibility;   // ray mask bits
  u32 entity;       // entity index in the scene
  u32 label;        // instance label, 0: none
  u32 category;     // class id
  u32 part;         // number within the instance of its first mesh part
  u32 segments;     // of its motion while the shutter is open; 0: it does not move
  u32 first_key;    // of segments + 1 in SceneView::motion_keys
  u32 light_group;  // of all light it gives off
  vec3 scale;       // of the mesh, before the entity's pose
};

/// The same in its place (place.h). Its flags have kFlipped, and its visibility is 0 where it
/// cannot be shown.
struct InstanceView : SlotView {
  mat4x3 world_from_object;  // of what does not move; use pose_at()
  mat4x3 object_from_world;
};

/// Box of an instance or a volume for the planes of object coordinates.
struct RestBoxView {
  mat4x3 box_from_object;  // rest position -> [0, 1]^3 in the labelled instance's rest box
  vec3 nocs_scale;         // box size / box diagonal
};

// ---------------------------------------------------------------- volumes

inline constexpr i32 kBrickSide = 8;
inline constexpr u32 kBrickVoxels = 512;

/// A field of one number or three over the voxels of a box, in bricks of kBrickSide^3 voxels.
/// Voxel v covers [v, v + 1) in voxel coordinates.
struct GridView {
  const float* values;  // kBrickVoxels * channels a brick, z fastest of the voxels; null: no grid
  const u32* bricks;    // brick of every cell of the table, kNone: all 0
  const float* majorants;  // no less than the first channel anywhere in the cell
  ivec3 first_cell;        // the table covers [first_cell, first_cell + cells), z fastest
  ivec3 cells;
  ivec3 lower;  // the box: its first voxel, and
  ivec3 upper;  // one past its last
  mat4x3 voxel_from_object;
};

/// Radiance of a black body: entry i is of 1 / kelvin = i * kBlackBodyStep, in Rec.709 at unit
/// luminance, and the natural logarithm of the luminance / (W sr^-1 m^-2).
inline constexpr u32 kBlackBodyEntries = 256;
inline constexpr float kColdestBlackBody = 400;  // kelvin; what is colder does not glow
inline constexpr float kBlackBodyStep = 1 / (kColdestBlackBody * float(kBlackBodyEntries - 1));

/// One entity that shows a volume.
struct VolumeView {
  InstanceView instance;  // its pose and labels; it has no mesh
  GridView density;
  GridView temperature;
  GridView color;
  float density_scale;  // 1/m of density 1
  vec3 albedo;
  float anisotropy;
  float temperature_scale;  // kelvin
  float emission_scale;     // 0 where nothing glows
};

/// A box about some volumes, in the world and over their whole motion.
struct VolumeNode {
  vec3 lower;
  u32 first;  // inner: the first child, the other one follows; leaf: the volume
  vec3 upper;
  bool is_leaf;
};
/// No tree of the builder is deeper.
inline constexpr u32 kVolumeTreeDepth = 32;

// ---------------------------------------------------------------- lights

/// A subtree of a light tree: bounds of what emits there, and how strongly.
struct alignas(16) LightNode {
  vec3 center;
  float radius2;     // square of the radius of a sphere about it
  vec3 axis;         // unit, of a cone that holds the fronts' normals
  float cos_spread;  // of the cone's half angle; -1: every direction
  float power;       // what the emitters beneath send, up to a factor common to the tree
  u32 first;         // inner: the first child, the other one follows; leaf: the first entry
  u32 parent;        // kNone: the root
  u16 count;         // of a leaf's entries; 0: inner
  bool two_sided;    // some emitters beneath emit from their backs, too
};

/// The most triangles in a leaf.
inline constexpr u32 kLeafTriangles = 4;

/// A triangle in a leaf.
struct TriangleEntry {
  u32 triangle;
  float radiosity;  // relative to the other triangles of its tree
  float power;      // radiosity times area, before the mesh deforms
  u32 leaf;         // node
};

/// The light tree over the triangles of a mesh part, in object space. Power is area times
/// radiosity.
struct TriangleTree {
  const LightNode* nodes;
  const TriangleEntry* entries;
  const u32* entry_of_triangle;  // by triangle of the mesh
  u32 root;
};

/// A triangle of a light that is_flat(), in the world. Read in rows of four numbers.
struct alignas(16) FlatTriangle {
  vec3 a;
  float radiosity;  // TriangleEntry::radiosity
  vec3 ab;
  float power;  // TriangleEntry::power
  vec3 ac;
  float offset;  // plane_error() of its points
  vec3 normal;   // of the front side, its length twice the area
  float both;    // 1: it emits from its back, too; else 0
};

/// One emitting (instance, mesh part): a leaf of the tree SceneView::light_nodes.
struct LightView {
  vec3 radiance;  // of the entity's light before `texture`; the material's emission comes on top
  TextureUseView texture;
  u32 instance;
  u32 part;
  u32 leaf;  // index into SceneView::light_nodes
  TriangleTree tree;
  // The sphere that it is, in the world, where it stands still and shines evenly, to the outside
  // alone and to all kinds of rays. Radius 0: it is something else.
  vec3 sphere_center;
  float sphere_radius;
  u32 flat = kNone;         // the first of its SceneView::flat_triangles, where it is_flat()
  float cone_cos;           // cosine of the half angle at which a spot light's cone ends
  float cone_scale;         // of the fall-off within; 0: no cone
  u32 profile = kNone;      // texture of its intensities by direction (light_profile.h)
  bool light_two_sided;     // of the entity's light
  bool material_two_sided;  // of the material's emission
  bool material_emits;      // the material's emission is not black
};

inline constexpr u32 kDomeGuide = 128;
inline constexpr u32 kPortalSide = 128;  // texels of a portal's map

/// A rectangle that the dome shines through (portal.h).
struct PortalView {
  vec3 center;
  vec3 x, y, z;        // unit, world: its sides, and out to the dome
  vec2 half;           // of its sides, metres
  const double* sums;  // (kPortalSide + 1)^2: of the map's texels below and to the left
};

/// Light from infinity. Direction d in the dome's frame: u = 0.5 - atan2(d.y, d.x) / 2 pi, v =
/// acos(d.z) / pi.
struct DomeView {
  u32 texture;    // kNone: constant
  vec3 radiance;  // multiplies the texture
  mat3 world_from_dome;
  mat3 dome_from_world;
  float probability;  // of choosing the dome among the lights of the sky; 0: no light
  u32 light_group;
  bool camera_visible;
  // Piecewise-constant density over the texels, luminance times solid angle; null: uniform
  // directions.
  u32 width;
  u32 height;
  const float* row_cdf;     // height: sum over rows up to and including, normalised
  const float* column_cdf;  // height * width: the same within a row
  // (height + 1) * kDomeGuide: for each row the column that u = i / kDomeGuide falls into, i. e.
  // the first one whose sum exceeds it; then the same for the rows themselves. Null: the sums are
  // searched as a whole.
  const u16* guides;
  const PortalView* portals;
  u32 portal_count;
};

/// A disc of light infinitely far away.
struct SunView {
  vec3 direction;                // unit, to its middle; use sun_direction()
  const MotionKey* motion_keys;  // segments + 1 poses, whose z axes point there
  u32 segments;                  // 0: it stands still
  float one_minus_cos;           // of its angular radius: its solid angle over 2 pi
  vec3 radiance;
  float probability;  // of choosing it among the lights of the sky
  u32 visibility;     // ray mask bits
  u32 light_group;
};

/// The most entities of a scene that paths look for, and the most lights in each.
inline constexpr u32 kMostCasters = 8;
inline constexpr u32 kMostCastLights = 4;

/// A sphere about an entity that reflects or refracts light sharply.
struct CasterView {
  vec3 center;  // world
  float radius;
  float mirror = 0;  // how often it is looked at for the images of lights, against all of it
  float spread = 0;  // that its roughness adds to the half angle of an image, rad
};
/// A sphere about a light whose images casters show.
struct CastLightView {
  vec3 center;  // world
  float radius;
};

// ---------------------------------------------------------------- scene

struct SceneView {
  const InstanceView* instances;
  const MeshView* meshes;
  const MaterialView* materials;
  const TextureView* textures;
  const TextureUseView* texture_uses;
  const u32* part_materials;  // material of each part of each instance
  const u32* part_lights;     // light of each, or kNone
  const LightView* lights;
  const MotionKey* motion_keys;
  const LightNode* light_nodes;  // the tree over the lights; node 0 is its root
  DomeView dome;
  const SunView* suns;
  u32 sun_count;
  float sky_power;  // of the dome and the suns, as importance() counts; 0: there are none
  const CasterView* casters;
  u32 caster_count;
  const CastLightView* cast_lights;
  u32 cast_light_count;
  float caster_probability;  // of a direction towards them
  u32 instance_count;
  u32 light_count;
  const VolumeView* volumes;
  u32 volume_count;
  const VolumeNode* volume_nodes;      // the tree over the volumes; node 0 is its root
  const vec4* black_body;              // kBlackBodyEntries
  const FlatTriangle* flat_triangles;  // on a GPU there are none
  bool only_even;                      // every light has a sphere_radius or is_flat()
  bool any_holes;                      // some instance has kMayBeHole
  bool any_media;                      // paths keep track of what they are inside of
  bool any_passable;                   // some instance has a passable material
  bool any_priority;                   // some instance has a material with a priority
  bool any_rich;                       // some instance has a material that is_rich()
  bool any_curves;                     // some mesh has curves
  bool any_unlit;                      // some instance has an unlit material
  bool plain_rays;                     // no instance moves, deforms, has kMayBeHole or shows curves
  float radius;                        // of a sphere about the scene's bounds, metres
  vec3 center;
};

static_assert(std::is_trivially_copyable_v<SceneView>);
static_assert(std::is_trivially_copyable_v<InstanceView>);
static_assert(std::is_trivially_copyable_v<VolumeView>);
static_assert(std::is_trivially_copyable_v<MaterialView>);

}  // namespace heliograph::kernels
