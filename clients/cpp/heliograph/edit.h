// Edits: one atomic transaction, built by calls and sent by commit(). Made by Scene::edit and
// Scene::overlay.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/array.h"
#include "heliograph/components.h"
#include "heliograph/geometry.h"
#include "heliograph/handles.h"
#include "heliograph/material.h"
#include "heliograph/sky.h"

namespace heliograph::client {

namespace wire {
struct Draft;
struct PendingEdit;
class Session;
}  // namespace wire

/// Treatment of the name of an edit.
enum class Mode : int {
  kUpsert = 0,  // change it, or create it when the name is new
  kCreate = 1,  // kAlreadyExists when the name is taken
  kUpdate = 2,  // kNotFound, with the nearest names, when it is not there
};

/// Options for decoding a file.
struct ImportOptions {
  std::string name{};         // of the asset; default: the file's stem
  int count = 1;              // roots are called `name`, or "<name>/0" .. for a count above 1
  std::string up{};           // "x", "y" or "z", for formats that name no axis
  double units = 0;           // metres per unit, for formats that name none; 0: 1
  std::string variant{};      // of a glTF with KHR_materials_variants; "": its default
  bool surface = false;       // of a volume file: its level sets as a mesh, not as fog
  std::string server_path{};  // instead of the path: a file under the daemon's asset root
  std::vector<std::string> folders{};  // further ones whose files the model may refer to
  bool strict = false;                 // refuse a model whose companions are not all there
};

/// Options for placing a copy of an asset.
struct Placement {
  std::optional<Pose> transform{};
  std::optional<Ref> parent{};
  std::optional<std::uint32_t> label{};  // default: the next free one
  std::optional<std::string> category{};
  std::optional<bool> group{};
  std::map<std::string, Ref> materials{};  // overrides for this copy, by the names in the file
  std::optional<std::string> animation{};  // clip to bind, by its name in the file
};

/// A list of edits. A name that is empty makes an object without one. Thread: one at a time.
///
/// Arrays up to 1 MiB travel in the message; larger ones are uploaded by these calls: topology and
/// texels by SHA-256, once per session, vertices and matrices without a hash.
class Edits {
 public:
  Entity entity(const std::string& name, const Components& components, Mode mode = Mode::kUpsert);
  /// Changes an entity that exists.
  Entity update(const Ref& target, const Components& components);
  /// Entities "<name>/0" .. that share everything but the pose: (N, 4, 4), one packed message.
  Group instances(const std::string& name, const Array& transforms, const Components& shared);
  /// Poses of N entities: (N, 4, 4) f32, or f64, which is converted. One packed message.
  void set_transforms(const Group& entities, const Array& transforms, bool teleport = false);

  Mesh mesh(const std::string& name, const Geometry& geometry, Mode mode = Mode::kUpsert);
  Material material(const std::string& name, const Parameters& parameters,
                    Mode mode = Mode::kUpsert);
  Texture texture(const std::string& name, const Image& image, Mode mode = Mode::kUpsert);
  Volume volume(const std::string& name, const Medium& medium, Mode mode = Mode::kUpsert);
  void dome(const Dome& dome);
  /// A clear sky as the dome, and its sun as the entity `sun`. elevation, azimuth: of the sun,
  /// radians.
  void sky(double elevation, double azimuth = 0, const Air& air = {},
           const std::string& sun = "sun");
  /// The bundled dome, and a floor of `floor` metres called "floor" at z = 0; the floor.
  Entity sample_studio(double floor = 40);

  /// Decodes a model (glTF, GLB, DAE, OBJ, PLY, STL, VDB, ..) and places it. Companions are
  /// uploaded from beneath the model's folder and `folders` only; Asset::warnings() names those
  /// that are not there.
  Asset import_file(const std::string& path, const Placement& placement = {},
                    const ImportOptions& options = {});
  /// Places an asset again, without decoding it again.
  Entity instance(const Asset& asset, const std::string& name, const Placement& placement = {});

  /// kFailedPrecondition lists who still uses one; `cascade` removes an entity's children too and
  /// unbinds references to it.
  void remove(const std::vector<Ref>& things, bool cascade = false);
  void remove(const Ref& thing, bool cascade = false) { remove(std::vector<Ref>{thing}, cascade); }
  /// Removes every mesh, material, texture and volume that nothing refers to.
  void prune();
  /// Makes the present state the one at the old time and moves the scene's time on, seconds; what
  /// follows is the state at the new time, and flow is backward from then on.
  void advance(double dt);
  void time(double seconds);
  /// Registers classes in this order; known ones keep their ids.
  void categories(const std::vector<std::string>& names);

  /// Remarks on the files of textures and domes, each after its path: what their decoder assumed or
  /// changed.
  [[nodiscard]] const std::vector<std::string>& warnings() const;

  [[nodiscard]] const std::shared_ptr<wire::Draft>& draft() const { return draft_; }

 protected:
  explicit Edits(std::shared_ptr<wire::Draft> draft) : draft_(std::move(draft)) {}
  ~Edits() = default;
  Edits(const Edits&) = default;
  Edits& operator=(const Edits&) = default;

 private:
  std::shared_ptr<wire::Draft> draft_;
};

/// The answer to a transaction that is on its way. Dropping it does not call the transaction back.
class Receipt {
 public:
  Receipt(std::shared_ptr<wire::Session> session, std::shared_ptr<wire::PendingEdit> pending)
      : session_(std::move(session)), pending_(std::move(pending)) {}

  /// Waits, and gives the revision that the transaction made; handles have their ids then. A
  /// refusal is thrown here: the scene is as it was.
  std::uint64_t wait();

 private:
  std::shared_ptr<wire::Session> session_;
  std::shared_ptr<wire::PendingEdit> pending_;
};

/// Edits of the scene: all or nothing, one round trip. Without commit() they are dropped.
class Transaction final : public Edits {
 public:
  explicit Transaction(std::shared_ptr<wire::Draft> draft) : Edits(std::move(draft)) {}

  /// Sends it, waits, and gives the revision. kAborted when the scene has moved on from the
  /// expected revision.
  std::uint64_t commit();
  /// Sends the transaction without waiting; up to 256 may be under way. They are applied in the
  /// order of these calls, each by itself: one behind a refused one is still applied, unless that
  /// one may be sent again later (details().retry_seconds > 0). Then those behind it are kAborted.
  Receipt commit_later();
};

/// Edits that Scene::render(.., RenderOptions().overlay(o)) applies for itself; the scene never
/// changes.
class Overlay final : public Edits {
 public:
  explicit Overlay(std::shared_ptr<wire::Draft> draft) : Edits(std::move(draft)) {}
};

}  // namespace heliograph::client
