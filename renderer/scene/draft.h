// A transaction at work on its own copy of a snapshot. Used by apply() and the files that carry out
// one group of actions each; nobody else includes it.
#pragma once

#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "renderer/scene/scene.h"

namespace heliograph {

/// Owns: the copy that is edited and what the reply states. Dropped as a whole when an edit fails,
/// so nothing here is ever undone.
struct Draft {
  const SceneLimits& limits;
  Snapshot next;
  std::vector<Id> created;  // the object of each edit so far
  std::vector<Id> further;  // of all edits so far, in order
  std::vector<u32> counts;  // how many of them each edit has
  /// Label values that may be on unrelated entities, with the edit that made them doubtful.
  std::vector<std::pair<u32, u32>> doubtful_labels;

  [[nodiscard]] u32 edit() const { return u32(created.size()); }  // number of the present one
};

/// Kind of a shared object.
template <class T>
inline constexpr Kind kKindOf = std::is_same_v<T, Mesh>       ? Kind::kMesh
                                : std::is_same_v<T, Material> ? Kind::kMaterial
                                : std::is_same_v<T, Texture>  ? Kind::kTexture
                                                              : Kind::kVolume;
/// "mesh 'chair'", or its kind and id when it has no name.
[[nodiscard]] std::string describe_object(const Snapshot& snapshot, Id id);

// ---------------------------------------------------------------- references (references.cpp)

/// Places where the references of an edit look: the scene, and what earlier edits created.
class Scope {
 public:
  enum class Names : bool { kRefused, kAllowed };  // refused: within an asset
  Scope(const Snapshot& scene, std::span<const Id> created, Names names = Names::kAllowed)
      : scene_(scene), created_(created), names_(names) {}

  /// The object that `ref` names, null for nothing. NOT_FOUND, INVALID_ARGUMENT; no `where`.
  /// kind: of an object that is named; kNone: any.
  [[nodiscard]] Expected<Id> resolve(const Ref& ref, Kind kind = Kind::kNone) const;
  /// The same, and it has to be of kind K or nothing. `where` is `field`.
  template <Kind K>
  [[nodiscard]] Status bind(const Ref& ref, std::string_view field, TypedId<K>& out) const {
    auto id = resolve_kind(ref, K);
    if (!id) return std::unexpected(std::move(id).error().at(std::string(field)));
    out = TypedId<K>(*id);
    return {};
  }

 private:
  [[nodiscard]] Expected<Id> resolve_kind(const Ref& ref, Kind kind) const;
  const Snapshot& scene_;
  std::span<const Id> created_;
  Names names_;
};

/// Object that a put changes, or the name under which it creates one.
struct Target {
  Id id;             // null: to be created
  std::string name;  // "": without a name
};
/// Finds an edit's target among objects of `kind`, by the rules of its mode.
[[nodiscard]] Expected<Target> find_target(const Draft& draft, const Edit& edit, Kind kind);
/// The name a creating edit gives, "" for none; fails when it is taken among objects of `kind`, or
/// not a name.
[[nodiscard]] Expected<std::string> new_name(const Draft& draft, const Edit& edit, Kind kind);
/// `name`, or the first of "name~2", "name~3"... that no object of any kind has.
[[nodiscard]] std::string free_name(const Draft& draft, const std::string& name);

// Keep uses, children, labels and the count of keyed entities true when a row changes. A row that
// is created comes from an empty one, a row that is removed becomes one.
void count(Draft& draft, const Entity& before, const Entity& after);
void count(Draft& draft, const Material& before, const Material& after);
void count(Draft& draft, const Dome& before, const Dome& after);

// ---------------------------------------------------------------- puts (put_*.cpp)

// Change or create one object; `where` is relative to the message of the action.
[[nodiscard]] Expected<Id> put(Draft& draft, const Scope& scope, const Target& target,
                               const PutEntity& patch);
[[nodiscard]] Expected<Id> put(Draft& draft, const Scope& scope, const Target& target,
                               const PutMesh& patch);
[[nodiscard]] Expected<Id> put(Draft& draft, const Scope& scope, const Target& target,
                               const PutMaterial& patch);
[[nodiscard]] Expected<Id> put(Draft& draft, const Scope& scope, const Target& target,
                               const PutTexture& patch);
[[nodiscard]] Expected<Id> put(Draft& draft, const Scope& scope, const Target& target,
                               const PutVolume& patch);

/// A row of its own under that name, its references counted; the pose is the identity.
[[nodiscard]] Expected<EntityId> create_entity(Draft& draft, const std::string& name,
                                               const Entity& row);
/// Replaces the row of a live entity and counts what changed.
void store(Draft& draft, EntityId id, const Entity& row);
void set_pose(Draft& draft, EntityId id, const mat4x3& pose);
/// Fails unless a skin and morph weights fit the mesh. `where` is relative to an Entity.
[[nodiscard]] Status check_deformation(const Entity& entity, const MeshTopology& topology);
/// Fails unless an entity's light can leave from its mesh: INVALID_ARGUMENT.
[[nodiscard]] Status check_light(const Entity& entity, const MeshTopology& topology);
/// A texture use whose texture is resolved.
[[nodiscard]] Status bind(const Scope& scope, const TextureUsePatch& patch, std::string_view field,
                          TextureUse& out);

// ---------------------------------------------------------------- labels (put_label.cpp)

void set_label(Draft& draft, Entity& entity, const LabelPatch& patch);
/// The next free label, for this entity.
void set_auto_label(Draft& draft, Entity& entity);
/// True if an ancestor of an entity with this parent states its label, be it 0.
[[nodiscard]] bool labelled_above(const Snapshot& snapshot, EntityId parent);
void register_category(Draft& draft, const std::string& name, u32& id);
/// At the end of a transaction: one label, one subtree, or a group.
[[nodiscard]] Status check_labels(const Draft& draft, const Transaction& transaction);

// ---------------------------------------------------------------- the other actions

// remove.cpp
[[nodiscard]] Status remove(Draft& draft, Id id, bool cascade);
void prune(Draft& draft);
// instantiate.cpp
[[nodiscard]] Expected<Id> instantiate(Draft& draft, const Scope& scope, const std::string& name,
                                       const Instantiate& action);
// place.cpp, place_many.cpp
[[nodiscard]] Status place(Draft& draft, const Scope& scope, const std::string& name,
                           const Instances& action);
[[nodiscard]] Status place(Draft& draft, const Poses& action);
// settings.cpp
[[nodiscard]] Status put(Draft& draft, const Scope& scope, const PutSettings& patch);
[[nodiscard]] Status advance(Draft& draft, const Advance& action);

// ---------------------------------------------------------------- arrays (memory.cpp)

[[nodiscard]] u64 bytes_of(const Mesh& mesh);
[[nodiscard]] u64 bytes_of(const Texture& texture);
[[nodiscard]] u64 bytes_of(const Volume& volume);
inline u64 bytes_of(const Material&) { return 0; }
/// Bytes of the arrays that an entity itself has.
[[nodiscard]] u64 bytes_of(const Entity& entity);
/// RESOURCE_EXHAUSTED when the arrays exceed the limit.
[[nodiscard]] Status check_memory(const Draft& draft);

}  // namespace heliograph
