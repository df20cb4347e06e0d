// Cost of preparing a scene, by what is kept. Declared in scene.h.
#include <algorithm>

#include "renderer/derived/mips.h"
#include "renderer/resident/scene.h"

namespace heliograph::resident {
namespace {

// Seconds of a core, measured; what they decide is where work is done, never what it gives.
constexpr double kOfTriangle = 8e-7;  // in a tree
constexpr double kOfTexel = 5e-8;     // in a table or a mip
constexpr double kOfVoxel = 2e-9;     // in a table of bricks
constexpr double kOfMean = 1e-8;      // of a texel, in a texture's mean
constexpr double kOfInstance = 5e-7;  // in a top level that is made again
constexpr double kOfEntity = 3e-6;    // in a scene of which nothing is known
constexpr double kOfAnyScene = 2e-3;  // the same
constexpr u64 kBytesOfTriangle = 100;

const Snapshot& nothing() {
  static const Snapshot empty;
  return empty;
}

double texels(const Texture& texture) {
  return double(texture.image->width) * texture.image->height;
}

bool may_deform(const Mesh& mesh) {
  return mesh.vertices->times.size() > 1 || mesh.topology->morph_count > 0 ||
         !mesh.topology->joints.empty();
}

/// Pieces that assets need, of those that a scene kept does not have.
class Pieces {
 public:
  Pieces(const Snapshot& now, const SceneState* before, DerivedCache& cache)
      : now_(now), before_(before ? before->snapshot() : nothing()), cache_(cache) {}

  void add_meshes(const MeshBuilder& builder) {
    for_each_new(&Snapshot::meshes, [&](const std::shared_ptr<const Mesh>& mesh) {
      const u64 triangles = mesh->topology->triangles.size();
      if (triangles == 0 || builder.ready(*mesh)) return;
      add(builder.key_of(*mesh), kOfTriangle * double(triangles),
          [&builder, mesh](const Interrupt& interrupt) { (void)builder.build(*mesh, interrupt); });
    });
  }
  void add_textures() {
    for_each_new(&Snapshot::textures, [&](const std::shared_ptr<const Texture>& texture) {
      means_ += kOfMean * texels(*texture);
    });
    if (!same_materials(now_, before_)) add_mips();
    const auto* lit = now_.dome ? now_.find(now_.dome->texture) : nullptr;
    if (!lit || now_.dome == before_.dome) return;
    const DerivedKey key = key_of(Derived::kDome, *lit->value);
    if (!cache_.contains(key))
      add(key, kOfTexel * texels(*lit->value),
          [cache = &cache_, texture = lit->value](const Interrupt&) {
            (void)dome_tables(*texture, *cache);
          });
  }
  void add_grids() {
    for_each_new(&Snapshot::volumes, [&](const std::shared_ptr<const Volume>& volume) {
      for (const Grid* grid : grids_of(*volume))
        if (!grid_table_ready(*grid, cache_))
          add(key_of(*grid), kOfVoxel * double(grid->values.size()),
              [cache = &cache_, volume, grid](const Interrupt&) {
                (void)grid_table(*grid, *cache);
              });
    });
  }
  [[nodiscard]] Preparation take() {
    made_.seconds = means_;
    return std::move(made_);
  }

 private:
  void add_mips() {
    const std::vector<bool> filtered = filtered_textures(now_);
    now_.textures.for_each([&](u32 index, const Shared<Texture>& row) {
      if (!filtered[index] || !needs_mips(*row.value, cache_)) return;
      add(key_of(Derived::kMips, *row.value), kOfTexel * texels(*row.value),
          [cache = &cache_, texture = row.value](const Interrupt&) {
            (void)mips_of(*texture, view_of(*texture), *cache);
          });
    });
  }
  /// f(value) of each row in use that a chunk of the scene before does not have.
  template <class T, class F>
  void for_each_new(Table<Shared<T>> Snapshot::* table, const F& f) {
    const auto& rows = now_.*table;
    rows.for_each_changed(before_.*table, [&](u32 index) {
      if (rows.alive(index) && rows.at(index).uses > 0) f(rows.at(index).value);
    });
  }
  void add(const DerivedKey& key, double seconds, Errand::Run run) {
    Errand errand{.seconds = seconds, .run = std::move(run)};
    errand.key[0] = u64(reinterpret_cast<std::uintptr_t>(&cache_));
    errand.key[1] = u64(key.kind);
    std::ranges::copy(key.from, errand.key.begin() + 2);
    made_.pieces.push_back(std::move(errand));
  }

  const Snapshot& now_;
  const Snapshot& before_;
  DerivedCache& cache_;
  Preparation made_;
  double means_ = 0;
};

/// Triangles that a snapshot may trace as one mesh, and those that may deform.
double triangles_of_unknown(const Snapshot& snapshot) {
  u64 triangles = 0;
  snapshot.entities.for_each([&](u32, const Entity& entity) {
    const auto* mesh = snapshot.find(entity.mesh);
    if (mesh && (entity.is_static || may_deform(*mesh->value)))
      triangles += mesh->value->topology->triangles.size();
  });
  return double(triangles);
}

/// True if an entity of one snapshot is the same in another, but for what is above it.
bool same_entity(const Snapshot& a, const Snapshot& b, u32 index) {
  const u32 chunk = index / ChunkedArray<u32>::kRows;
  if (!a.poses.shares(chunk, b.poses) && !same_bytes(a.poses[index], b.poses[index])) return false;
  if (a.entities.shares(chunk, b.entities)) return true;
  const Entity* now = b.entities.find(a.entities.version(index), index);
  return now && *now == a.entities.at(index);
}

/// True if it is of the same Scene, or of one that this is a branch of.
bool is_related(const SceneState& before, const Snapshot& now) {
  const Snapshot& then = before.snapshot();
  if (!then.scene.owner_before(now.scene) && !now.scene.owner_before(then.scene)) return true;
  u32 chunk = 0;
  while (chunk < now.entities.chunk_count() && !now.entities.shares(chunk, then.entities)) ++chunk;
  return chunk < now.entities.chunk_count();
}

/// Seconds that it takes to go from a scene to a related snapshot.
double seconds_from(const SceneState& before, const Snapshot& now, const TimeSpan& span) {
  if (same_poses(before, now, span)) return 0;
  const Placement& placed = before.placement();
  const Structure& structure = *placed.structure;
  double seconds = kOfInstance * double(structure.slots.size());
  const auto moved = [&](u32 slot) {
    return !same_entity(before.snapshot(), now, structure.slots[slot].entity);
  };
  if (placed.accelerator && std::ranges::any_of(structure.fixed, moved))
    seconds += kOfTriangle * double(placed.accelerator->static_bytes_beside(nullptr)) /
               double(kBytesOfTriangle);
  for (const u32 slot : structure.deforming)
    seconds += kOfTriangle *
               double(structure.meshes[structure.slots[slot].mesh]->topology->triangles.size());
  return seconds;
}

}  // namespace

Preparation SceneStore::preparation(const SceneAt& wanted) const {
  const Snapshot& now = *wanted.snapshot;
  State before;
  {
    const std::scoped_lock lock(mutex_);
    before = kept_.nearest(now, wanted.span);
  }
  if (before && !is_related(*before, now)) before = nullptr;
  Pieces pieces(now, before.get(), cache_);
  pieces.add_meshes(builder_);
  pieces.add_textures();
  pieces.add_grids();
  Preparation needed = pieces.take();
  needed.seconds += before ? seconds_from(*before, now, wanted.span)
                           : kOfAnyScene + kOfEntity * double(now.entities.count()) +
                                 kOfTriangle * triangles_of_unknown(now);
  return needed;
}

}  // namespace heliograph::resident
