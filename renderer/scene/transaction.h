// An edit after hop 3: every number in it was checked, no id in it was. Made in server/convert, by
// the asset store, and by tests; consumed by apply() in scene.h.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "renderer/base/boxed.h"
#include "renderer/scene/components.h"

namespace heliograph {

/// Names an object: nothing, an id, a name, or the object of an earlier edit of the transaction.
struct CreatedByEdit {
  u32 edit = 0;
};
/// Bytes of an object's name.
inline constexpr std::size_t kMostNameBytes = 1024;

using Ref = std::variant<std::monostate, Id, std::string, CreatedByEdit>;

/// A texture use whose texture is not resolved yet; `use.texture` is ignored.
struct TextureUsePatch {
  Ref texture;
  TextureUse use;
};

// In every patch, a field that is absent stays as it is. A field that a client cleared is present
// and holds its default.

struct PosePatch {
  std::vector<Time> times;       // empty: constant
  std::vector<mat4x3> matrices;  // one, or as many as times
};
struct LightPatch {
  Light light;
  TextureUsePatch texture;
  Ref profile{};
};
struct SkinPatch {
  std::vector<Ref> joints;
  std::vector<mat4x3> inverse_binds;
};
/// kAuto keeps a value that the entity has for itself alone. kInherit with a category changes the
/// category (and a part that is not 0) and leaves the rest; without one it resets the label.
/// An entity that has a mesh or a volume, no label of its own and no labelled ancestor gets kAuto
/// at the end of an edit that carries its mesh, its volume or its label; the root of an Instantiate
/// always does.
struct LabelPatch {
  enum class Kind : u8 { kInherit, kValue, kAuto } kind = Kind::kInherit;
  u32 value = 0;
  bool group = false;
  std::optional<std::string> category;  // "": none; absent: stays, unless the label is reset
  u32 part = 0;
};

struct PutEntity {
  std::optional<Ref> parent;
  std::optional<PosePatch> pose;
  std::optional<Ref> mesh;
  std::optional<std::vector<Ref>> materials;
  Boxed<std::optional<LightPatch>> light;  // inner nullopt: removed
  Boxed<std::optional<Portal>> portal;
  Boxed<std::optional<Camera>> camera;
  Boxed<Ref> volume;
  Boxed<std::optional<SkinPatch>> skin;
  Boxed<std::optional<MorphWeights>> morph_weights;
  Boxed<LabelPatch> label;
  std::optional<bool> visible;
  std::optional<u8> visibility;  // RayMask bits
  std::optional<bool> is_static;
  std::optional<bool> shadow_catcher;
  bool teleport = false;
  Boxed<Attributes> attributes;
  Boxed<std::string> light_group;
};

/// A whole topology, or only new vertices for the present one; a new mesh needs both.
struct PutMesh {
  std::shared_ptr<const MeshTopology> topology;  // null: stays
  std::shared_ptr<const VertexKeys> vertices;    // null: stays
};

struct ParameterPatch {
  std::optional<vec3> value;
  Boxed<TextureUsePatch> texture;
};
struct PutMaterial {
  /// By MaterialParameter. Not in the patch itself, as an Edit is as large as its largest action.
  std::vector<ParameterPatch> parameters = std::vector<ParameterPatch>(kMaterialParameters);
#define HELIO_MAP(name) Boxed<TextureUsePatch> name;
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  std::optional<AlphaMode> alpha_mode;
  std::optional<float> alpha_cutoff;
  std::optional<bool> two_sided_emission;
  std::optional<bool> unlit;
  std::optional<bool> thin_walled;
  std::optional<i32> priority;
};

struct PutTexture {
  std::shared_ptr<const ImageData> image;  // null: stays
  std::optional<bool> srgb;                // a new texture without one: u8 is sRGB, others linear
  std::optional<bool> nearest;
  std::optional<Wrap> wrap_u;
  std::optional<Wrap> wrap_v;
};

struct PutVolume {
  std::shared_ptr<const Grid> density;                     // null: stays
  std::optional<std::shared_ptr<const Grid>> temperature;  // inner null: removed
  std::optional<std::shared_ptr<const Grid>> color;
  std::optional<float> density_scale;
  std::optional<vec3> albedo;
  std::optional<float> anisotropy;
  std::optional<float> temperature_scale;
  std::optional<float> emission_scale;
};
/// The patch that makes this volume.
[[nodiscard]] PutVolume describe(const Volume& volume);

struct PutDome {
  std::optional<Ref> texture;
  std::optional<std::optional<vec3>> color;
  std::optional<float> intensity;
  std::optional<mat3> world_from_dome;
  std::optional<bool> camera_visible;
  std::optional<std::string> light_group;
};
struct PutSettings {
  std::optional<Time> time;             // forgets the state before the last Advance
  std::vector<std::string> categories;  // registers classes in this order, those that are new
  std::optional<PutDome> dome;
};

struct Remove {
  bool cascade = false;
};

struct Asset;
struct Instantiate {
  std::shared_ptr<const Asset> asset;
  std::optional<Ref> parent;
  std::optional<PosePatch> pose;
  Boxed<LabelPatch> label;
  std::vector<std::pair<std::string, Ref>> materials;  // overrides, by the asset's material name
  std::optional<u32> animation;                        // clip to bind; nullopt: none
};

struct Instances {
  PutEntity prototype;
  std::vector<mat4x3> matrices;
};
struct Poses {
  ArrayOf<Id> ids;
  ArrayOf<mat4x3> matrices;
  bool teleport = false;
};
struct Advance {
  double dt = 0;
};
struct Prune {};

using Action = std::variant<PutEntity, PutMesh, PutMaterial, PutTexture, PutVolume, Remove,
                            Instantiate, Instances, Poses, PutSettings, Advance, Prune>;

enum class Mode : u8 { kUpsert, kCreate, kUpdate };

struct Edit {
  Mode mode = Mode::kUpsert;
  Ref target;  // monostate: a new object without a name
  Action action;
};

struct Transaction {
  std::vector<Edit> edits;
};

/// A decoded model: the edits that make it. CreatedByEdit counts over library, then entities.
/// Names in `library` are relative to the asset's name, names in `entities` to the root's.
struct Asset {
  std::string hash;            // 32 bytes
  std::string name;            // the file's stem: prefix of the library's names
  std::vector<Edit> library;   // textures, materials, meshes, volumes; made once a scene
  std::vector<Edit> entities;  // made for each instance; the first is the root
  struct Channel {
    u32 entity = 0;  // index into `entities`
    std::variant<PosePatch, MorphWeights> keys;
  };
  struct Animation {
    std::string name;
    std::vector<Channel> channels;
  };
  std::vector<Animation> animations;
};

}  // namespace heliograph
