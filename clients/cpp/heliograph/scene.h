// Scene: edits, renders, reads and queries of one scene.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "heliograph/edit.h"
#include "heliograph/frame.h"
#include "heliograph/handles.h"
#include "heliograph/live.h"
#include "heliograph/render.h"
#include "heliograph/watch.h"

namespace heliograph::client {

namespace wire {
struct SceneCore;
}

/// Points of surfaces, for Scene::tracks: on triangles, or vertices of the first entity.
struct SurfacePoints {
  std::vector<Ref> entities;
  Array entity{};       // (N,) u32, index into entities; none: all on the first one
  Array primitive{};    // (N,) u32, triangle of the mesh
  Array barycentric{};  // (N, 2) f32
  Array vertices{};     // (N,) u32, instead of these
};

/// Lifetime of a scene and of its acknowledged edits. kDisk and kDiskSynced need a daemon with
/// --state-dir. When it is restarted, clients go on: their edits are answered or applied, once.
enum class Lifetime : int {
  kSession = 1,     // until it is deleted, or its session ends
  kDaemon = 2,      // until it is deleted, or the daemon ends
  kDisk = 3,        // until it is deleted; edits survive the end of the daemon, kill -9 too
  kDiskSynced = 4,  // until it is deleted; edits survive a loss of power, too
};

/// A scene of a daemon. Copies are the same scene; a private one that this client made is deleted
/// when the last copy and the last handle are gone. Thread: any; edits go out in one order.
class Scene {
 public:
  explicit Scene(std::shared_ptr<wire::SceneCore> core) : core_(std::move(core)) {}

  [[nodiscard]] std::uint64_t id() const;
  [[nodiscard]] const std::string& name() const;

  // ---------------------------------------------------------------- edits

  /// A transaction, sent by its commit(). expected_revision: kAborted when the scene has moved on.
  [[nodiscard]] Transaction edit(std::optional<std::uint64_t> expected_revision = {}) const;
  [[nodiscard]] Overlay overlay() const;

  // ---------------------------------------------------------------- rendering

  [[nodiscard]] Frame render(const Ref& camera, const RenderOptions& options = {}) const;
  /// Renders one frame per camera, in one job.
  [[nodiscard]] std::vector<Frame> render(const std::vector<Ref>& cameras,
                                          const RenderOptions& options = {}) const;
  /// Independent jobs; a Result for each in the order they are done. One job's error does not end
  /// the others. Nothing is published. At most `credits` jobs are under way; the next one is asked
  /// for when the last Result was taken.
  [[nodiscard]] Results render_batch(Jobs jobs, const BatchOptions& options = {}) const;
  [[nodiscard]] Results render_batch(std::vector<Job> jobs, const BatchOptions& options = {}) const;
  /// Frames of the scene as it changes: rendered again at each new revision and each update().
  /// credits: frames that may be under way or held by you. A stream whose frames nobody takes for
  /// 30 s is closed. The options' timeout and cancellation end it.
  [[nodiscard]] Live stream(const std::vector<Ref>& cameras, const RenderOptions& options = {},
                            Policy policy = Policy::kLatest, std::uint32_t credits = 2) const;
  /// Watches each transaction of the scene, by any client. Returns once the daemon watches.
  [[nodiscard]] Watch watch(const WatchOptions& options = {}) const;
  /// A frame again from its manifest, at this scene's latest revision: the same bytes for the same
  /// content, daemon version and CPU features.
  [[nodiscard]] Frame rerender(const std::string& manifest) const;

  // ---------------------------------------------------------------- reading

  [[nodiscard]] std::uint64_t revision() const;
  [[nodiscard]] Lifetime lifetime() const;
  [[nodiscard]] double time() const;                                      // seconds
  [[nodiscard]] std::map<std::uint32_t, std::string> categories() const;  // class id to name
  [[nodiscard]] std::map<std::string, std::uint64_t> counts() const;      // objects by kind
  /// Bytes: "rows", "arrays" (shared ones counted once), "derived".
  [[nodiscard]] std::map<std::string, std::uint64_t> memory() const;

  /// The object with that name; kNotFound lists the nearest, another kind is kInvalidArgument.
  [[nodiscard]] Entity entity(const std::string& name) const;
  [[nodiscard]] Mesh mesh(const std::string& name) const;
  [[nodiscard]] Material material(const std::string& name) const;
  [[nodiscard]] Texture texture(const std::string& name) const;
  [[nodiscard]] Volume volume(const std::string& name) const;
  /// Objects whose names match a glob, in id order.
  [[nodiscard]] std::vector<Handle> find(const std::string& pattern = "*") const;
  [[nodiscard]] bool contains(const std::string& name) const;

  /// (N, 4, 4) f32 poses relative to the parents, at the scene's time.
  [[nodiscard]] Array transforms(const Group& entities) const;
  /// Reads a field that docs/protocol.md lists: one array per thing; empty where it has none.
  [[nodiscard]] std::vector<Array> read(const std::vector<Ref>& things,
                                        const std::string& field) const;

  // ---------------------------------------------------------------- queries

  /// The first hit of each ray; origins and directions (N, 3), world. Columns: t (N,) metres along
  /// the unit direction (+inf: none), entity, primitive, barycentric, position, normal, uv,
  /// instance. any_hit: only t, 0 where something is hit.
  [[nodiscard]] Columns cast_rays(const Array& origins, const Array& directions, double t_max = 0,
                                  bool any_hit = false) const;
  /// Columns of cast_rays() for the surfaces seen at image points (N, 2), K coordinates: integers
  /// are pixel centres.
  [[nodiscard]] Columns pick(const Ref& camera, const Array& pixels) const;
  /// visible (E,) u8, share (E,) of each entity's silhouette that is seen.
  [[nodiscard]] Columns visible(const Ref& camera, const std::vector<Ref>& entities) const;
  /// (A, B) u8: do the surfaces intersect, or does one contain the other.
  [[nodiscard]] Array overlaps(const std::vector<Ref>& a, const std::vector<Ref>& b) const;
  /// Points uniform over the world area of all: position, normal, uv, entity, primitive,
  /// barycentric.
  [[nodiscard]] Columns sample_surface(const std::vector<Ref>& entities, std::uint32_t count,
                                       std::uint64_t seed = 0) const;
  /// Projects N points at T times, seconds, into a camera: image (N, T, 2), depth (N, T) metres,
  /// position (N, T, 3) world, visible (N, T) u8.
  [[nodiscard]] Columns tracks(const Ref& camera, const SurfacePoints& points,
                               const std::vector<double>& times,
                               bool through_transmission = false) const;

  // ---------------------------------------------------------------- life

  /// A copy-on-write branch; handles of this scene serve it too, by their ids.
  [[nodiscard]] Scene branch(const std::string& name = "",
                             std::optional<std::uint64_t> revision = {},
                             Lifetime lifetime = Lifetime::kSession) const;
  /// Writes the whole scene, arrays and textures included, to one file: all or nothing.
  void save(const std::string& path, std::optional<std::uint64_t> revision = {}) const;
  /// Deletes the scene in the daemon.
  void remove();

  [[nodiscard]] const std::shared_ptr<wire::SceneCore>& core() const { return core_; }

 private:
  std::shared_ptr<wire::SceneCore> core_;
};

}  // namespace heliograph::client
