#include "renderer/host/queries.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <random>

#include "kernels/label/probe_sight.h"
#include "renderer/base/parallel.h"
#include "renderer/frame/image_camera.h"
#include "renderer/host/overlap.h"
#include "renderer/placement/canvas.h"

namespace heliograph::host {

namespace {

constexpr kernels::HoleKey kProbe{0, true};

/// A scene at an instant.
struct QueryScene {
  const Snapshot& snapshot;
  const Placement& placement;
  const kernels::SceneView& view;
  const HostTracer& tracer;
};

/// A column of n rows of `width` values, written in place.
template <class T>
class Out {
 public:
  Out(QueryResult& result, const char* name, DType dtype, std::size_t rows, u64 width)
      : width_(width) {
    Column column{.name = name, .dtype = dtype, .shape = {rows}};
    if (width > 1) column.shape.push_back(width);
    column.data.resize(rows * width * sizeof(T));
    values_ = reinterpret_cast<T*>(column.data.data());
    result.push_back(std::move(column));  // moving keeps the storage
  }
  [[nodiscard]] T* row(std::size_t i) const { return values_ + i * width_; }

 private:
  T* values_ = nullptr;
  u64 width_;
};

template <class V>
void put(float* to, const V& v) {
  for (int i = 0; i < V::length(); ++i) to[i] = v[i];
}

Expected<u32> slot_of(const QueryScene& scene, EntityId id, const std::string& where) {
  if (!scene.snapshot.find(id)) return fail(Code::kNotFound, where, "there is no such entity");
  const u32 slot = scene.placement.structure->slot_of_entity[id.index()];
  if (slot == kNone)
    return fail(Code::kInvalidArgument, where,
                fmt::format("'{}' shows no mesh; give it one, or make it visible",
                            scene.snapshot.name_of(id)));
  return slot;
}

Expected<std::vector<u32>> slots_of(const QueryScene& scene, const std::vector<EntityId>& ids,
                                    const char* where) {
  std::vector<u32> slots;
  for (std::size_t i = 0; i < ids.size(); ++i) {
    auto slot = slot_of(scene, ids[i], fmt::format("{}[{}]", where, i));
    if (!slot) return std::unexpected(std::move(slot).error());
    slots.push_back(*slot);
  }
  return slots;
}

/// The slots of entities whose triangles a query looks at.
Expected<std::vector<u32>> mesh_slots_of(const QueryScene& scene, const std::vector<EntityId>& ids,
                                         const char* where) {
  auto slots = slots_of(scene, ids, where);
  if (!slots) return slots;
  for (std::size_t i = 0; i < slots->size(); ++i) {
    const Placement& placement = scene.placement;
    const DeviceMesh& mesh = placement.mesh((*slots)[i]);
    if (mesh.shape() != kernels::Shape::kTriangles) {
      const bool curves = mesh.shape() == kernels::Shape::kCurves;
      return fail(Code::kInvalidArgument, fmt::format("{}[{}]", where, i),
                  fmt::format("'{}' {}; this query takes meshes of triangles",
                              scene.snapshot.name_of(ids[i]),
                              curves ? "shows curves" : "is a light's disc or sphere"));
    }
  }
  return slots;
}

Expected<kernels::CameraView> camera_of(const QueryScene& scene, EntityId id) {
  const Entity* entity = scene.snapshot.find(id);
  if (!entity) return fail(Code::kNotFound, "camera", "there is no such entity");
  if (!entity->camera)
    return fail(Code::kInvalidArgument, "camera",
                fmt::format("'{}' has no camera", scene.snapshot.name_of(id)));
  return camera_view(image_camera(*entity->camera, scene.placement.world[id.index()],
                                  entity->camera->width, entity->camera->height));
}

/// The columns of rays that met something, or did not.
class HitColumns {
 public:
  HitColumns(QueryResult& result, std::size_t rows)
      : t_(result, "t", DType::kF32, rows, 1),
        entity_(result, "entity", DType::kU64, rows, 1),
        instance_(result, "instance", DType::kU32, rows, 1),
        primitive_(result, "primitive", DType::kU32, rows, 1),
        barycentric_(result, "barycentric", DType::kF32, rows, 2),
        position_(result, "position", DType::kF32, rows, 3),
        normal_(result, "normal", DType::kF32, rows, 3),
        uv_(result, "uv", DType::kF32, rows, 2) {}

  void set(std::size_t i, const QueryScene& scene, const kernels::Sight& sight) {
    const kernels::Ray& ray = sight.ray;
    const kernels::Hit hit =
        kernels::refined(scene.view, ray, sight.direction, scene.tracer.closest(ray, sight.mask));
    *t_.row(i) = hit.t + sight.passed;
    if (hit.instance == kNone) {
      *primitive_.row(i) = kNone;
      put(position_.row(i), vec3(NAN));
      return;
    }
    const kernels::InstanceView& instance = scene.view.instances[hit.instance];
    const kernels::Surface surface =
        kernels::surface_at(scene.view, hit.instance, hit.primitive, vec2(hit.u, hit.v), 0);
    *entity_.row(i) = scene.snapshot.entity_id(instance.entity).value;
    *instance_.row(i) = instance.label;
    *primitive_.row(i) = hit.primitive;
    put(barycentric_.row(i), vec2(hit.u, hit.v));
    put(position_.row(i), ray.origin + ray.direction * hit.t);
    put(normal_.row(i), glm::dot(surface.ng, ray.direction) > 0 ? -surface.ng : surface.ng);
    put(uv_.row(i), kernels::uvs_at(surface).set[0]);
  }

 private:
  Out<float> t_;
  Out<u64> entity_;
  Out<u32> instance_, primitive_;
  Out<float> barycentric_, position_, normal_, uv_;
};

template <class F>
void for_each_row(std::size_t rows, const Interrupt& interrupt, F&& f) {
  parallel_ranges(rows, std::size_t(1024), [&](std::size_t begin, std::size_t end) {
    if (interrupt.requested()) return;
    for (std::size_t i = begin; i < end; ++i) f(i);
  });
}

Expected<QueryResult> cast_rays(const QueryScene& scene, const CastRays& query,
                                const Interrupt& interrupt) {
  const std::size_t rows = query.origins.size();
  for (std::size_t i = 0; i < rows; ++i) {
    if (!(glm::dot(query.directions[i], query.directions[i]) > 0))
      return fail(Code::kInvalidArgument, fmt::format("cast_rays.directions[{}]", i),
                  "a direction must have a length above 0");
    if (!kernels::is_sound({query.origins[i], {}, 0, 0, kProbe}))
      return fail(Code::kInvalidArgument, fmt::format("cast_rays.origins[{}]", i),
                  fmt::format("lies farther than {:g} m from the world's origin along an axis",
                              kernels::kReach));
  }
  const float t_max = query.t_max > 0 ? query.t_max : INFINITY;
  QueryResult result;
  if (query.any_hit) {
    const Out<float> t(result, "t", DType::kF32, rows, 1);
    for_each_row(rows, interrupt, [&](std::size_t i) {
      const kernels::Ray ray{query.origins[i], glm::normalize(query.directions[i]), t_max, 0,
                             kProbe};
      *t.row(i) = scene.tracer.occluded(ray, kernels::kAllRays) ? 0 : INFINITY;
    });
    return result;
  }
  HitColumns columns(result, rows);
  for_each_row(rows, interrupt, [&](std::size_t i) {
    const glm::dvec3 direction = glm::normalize(glm::dvec3(query.directions[i]));
    columns.set(
        i, scene,
        {{query.origins[i], vec3(direction), t_max, 0, kProbe}, kernels::kAllRays, 0, direction});
  });
  return result;
}

Expected<QueryResult> pick(const QueryScene& scene, const Pick& query, const Interrupt& interrupt) {
  const auto camera = camera_of(scene, query.camera);
  if (!camera) return std::unexpected(camera.error());
  QueryResult result;
  HitColumns columns(result, query.pixels.size());
  for_each_row(query.pixels.size(), interrupt, [&](std::size_t i) {
    columns.set(i, scene, kernels::centre_sight(*camera, query.pixels[i] + 0.5f));
  });
  return result;
}

Expected<QueryResult> visible(const QueryScene& scene, const Visible& query,
                              const Interrupt& interrupt) {
  const auto camera = camera_of(scene, query.camera);
  if (!camera) return std::unexpected(camera.error());
  const auto slots = slots_of(scene, query.entities, "visible.entities");
  if (!slots) return std::unexpected(slots.error());
  const PixelBox image{0, 0, i32(camera->width), i32(camera->height)};
  QueryResult result;
  const Out<u8> visible(result, "visible", DType::kU8, slots->size(), 1);
  const Out<float> share(result, "share", DType::kF32, slots->size(), 1);
  parallel_for(slots->size(), [&](std::size_t i) {
    const u32 slot = (*slots)[i];
    const PixelBox box = bounds_on_canvas(scene.placement, slot, *camera, image);
    u32 alone = 0, seen = 0;
    for (i32 y = box.y0; y < box.y1 && !interrupt.requested(); ++y)
      for (i32 x = box.x0; x < box.x1; ++x) {
        const kernels::Ray ray = kernels::centre_ray(*camera, kernels::centre_of(x, y));
        if (!(ray.t_max > 0) || scene.tracer.closest_in(slot, ray).instance == kNone) continue;
        ++alone;
        seen += scene.tracer.closest(ray, kernels::kCameraRay).instance == slot;
      }
    *visible.row(i) = seen > 0;
    *share.row(i) = alone ? float(double(seen) / alone) : 0;
  });
  return result;
}

Expected<QueryResult> overlaps(const QueryScene& scene, const Overlaps& query,
                               const Interrupt& interrupt) {
  const auto a = mesh_slots_of(scene, query.a, "overlaps.a");
  if (!a) return std::unexpected(a.error());
  const auto b = mesh_slots_of(scene, query.b, "overlaps.b");
  if (!b) return std::unexpected(b.error());
  QueryResult result;
  const Out<u8> out(result, "overlaps", DType::kU8, a->size(), b->size());
  result[0].shape = {a->size(), b->size()};
  parallel_for(a->size() * b->size(), [&](std::size_t i) {
    if (interrupt.requested()) return;
    const u32 slot_a = (*a)[i / b->size()], slot_b = (*b)[i % b->size()];
    out.row(0)[i] = slot_a == slot_b || overlap(scene.placement, scene.tracer, slot_a, slot_b);
  });
  return result;
}

/// Running world areas of the triangles of some slots.
struct AreaTable {
  struct Entry {
    u32 slot, triangle;
  };
  std::vector<Entry> entries;
  std::vector<double> sums;
};

AreaTable area_table(const QueryScene& scene, const std::vector<u32>& slots,
                     const Interrupt& interrupt) {
  AreaTable table;
  double sum = 0;
  for (const u32 slot : slots) {
    if (interrupt.requested()) break;
    const DeviceMesh& mesh = scene.placement.mesh(slot);
    const mat3 linear(scene.placement.instances()[slot].world_from_object);
    const auto triangles = mesh.topology->triangles.span();
    for (u32 i = 0; i < triangles.size(); ++i) {
      const vec3 p = mesh.positions[triangles[i].x];
      const vec3 e1 = linear * (mesh.positions[triangles[i].y] - p);
      const vec3 e2 = linear * (mesh.positions[triangles[i].z] - p);
      sum += 0.5 * double(glm::length(glm::cross(e1, e2)));
      table.entries.push_back({slot, i});
      table.sums.push_back(sum);
    }
  }
  return table;
}

Expected<QueryResult> sample_surface(const QueryScene& scene, const SampleSurface& query,
                                     const Interrupt& interrupt) {
  const auto slots = mesh_slots_of(scene, query.entities, "sample_surface.entities");
  if (!slots) return std::unexpected(slots.error());
  const AreaTable table = area_table(scene, *slots, interrupt);
  HELIO_TRY(interrupt.status());
  if (table.sums.empty() || !(table.sums.back() > 0))
    return fail(Code::kInvalidArgument, "sample_surface.entities", "these entities have no area");
  QueryResult result;
  const Out<float> position(result, "position", DType::kF32, query.count, 3);
  const Out<float> normal(result, "normal", DType::kF32, query.count, 3);
  const Out<float> uv(result, "uv", DType::kF32, query.count, 2);
  const Out<u64> entity(result, "entity", DType::kU64, query.count, 1);
  const Out<u32> primitive(result, "primitive", DType::kU32, query.count, 1);
  const Out<float> barycentric(result, "barycentric", DType::kF32, query.count, 2);
  std::mt19937_64 random(query.seed);
  const auto uniform = [&] { return double(random() >> 11) * 0x1p-53; };
  for (u32 i = 0; i < query.count; ++i) {
    if (i % 1024 == 0) HELIO_TRY(interrupt.status());
    const auto found = std::ranges::upper_bound(table.sums, uniform() * table.sums.back());
    const auto at = std::min(std::size_t(found - table.sums.begin()), table.sums.size() - 1);
    double u = uniform(), v = uniform();
    if (u + v > 1) {
      u = 1 - u;
      v = 1 - v;
    }
    const auto [slot, triangle] = table.entries[at];
    const kernels::Surface surface =
        kernels::surface_at(scene.view, slot, triangle, vec2(float(u), float(v)), 0);
    put(position.row(i), surface.p);
    put(normal.row(i), surface.ng);
    put(uv.row(i), kernels::uvs_at(surface).set[0]);
    *entity.row(i) = scene.snapshot.entity_id(scene.placement.structure->slots[slot].entity).value;
    *primitive.row(i) = triangle;
    put(barycentric.row(i), vec2(float(u), float(v)));
  }
  return result;
}

}  // namespace

Expected<QueryResult> answer(const SceneRays& scene, const QueryJob& job, const SceneAt& scene_at,
                             const Interrupt& interrupt) {
  struct Visitor {
    const QueryScene& scene;
    const SceneAt& scene_at;
    const Interrupt& interrupt;
    Expected<QueryResult> operator()(const CastRays& q) const {
      return cast_rays(scene, q, interrupt);
    }
    Expected<QueryResult> operator()(const Pick& q) const { return pick(scene, q, interrupt); }
    Expected<QueryResult> operator()(const Visible& q) const {
      return visible(scene, q, interrupt);
    }
    Expected<QueryResult> operator()(const Overlaps& q) const {
      return overlaps(scene, q, interrupt);
    }
    Expected<QueryResult> operator()(const SampleSurface& q) const {
      return sample_surface(scene, q, interrupt);
    }
    Expected<QueryResult> operator()(const Tracks& q) const {
      return follow(q, scene_at, interrupt);
    }
  };
  const QueryScene seen{scene.scene->snapshot(), scene.scene->placement(), scene.scene->view(),
                        *scene.tracer};
  auto result = std::visit(Visitor{seen, scene_at, interrupt}, job.query);
  if (interrupt.requested()) return fail(Code::kCancelled, "", "the query was cancelled");
  return result;
}

}  // namespace heliograph::host
