#include "renderer/host/tracks.h"

#include <fmt/format.h>

#include "kernels/label/probe.h"
#include "renderer/base/parallel.h"
#include "renderer/frame/image_camera.h"
#include "renderer/scene/motion.h"

namespace heliograph::host {
namespace {

/// The columns, by point and time.
class TrackColumns {
 public:
  TrackColumns(QueryResult& result, const Tracks& tracks)
      : tracks_(tracks),
        image_(add<float>(result, "image", DType::kF32, 2)),
        depth_(add<float>(result, "depth", DType::kF32, 1)),
        position_(add<float>(result, "position", DType::kF32, 3)),
        visible_(add<u8>(result, "visible", DType::kU8, 1)) {}

  struct Sighting {
    glm::dvec2 image;
    double depth;
    vec3 p_world;
    bool visible;
  };
  /// Sets the sighting of point i at time t.
  void set(u64 i, u64 t, const Sighting& s) const {
    const u64 row = i * tracks_.times.size() + t;
    image_[2 * row] = float(s.image.x);
    image_[2 * row + 1] = float(s.image.y);
    depth_[row] = float(s.depth);
    for (int k = 0; k < 3; ++k) position_[3 * row + u64(k)] = s.p_world[k];
    visible_[row] = s.visible;
  }

 private:
  template <class T>
  T* add(QueryResult& result, const char* name, DType dtype, u64 width) const {
    Column column{
        .name = name, .dtype = dtype, .shape = {tracks_.points.size(), tracks_.times.size()}};
    if (width > 1) column.shape.push_back(width);
    column.data.resize(tracks_.points.size() * tracks_.times.size() * width * sizeof(T));
    T* values = reinterpret_cast<T*>(column.data.data());
    result.push_back(std::move(column));  // moving keeps the storage
    return values;
  }

  const Tracks& tracks_;
  float *image_, *depth_, *position_;
  u8* visible_;
};

/// All points at one time.
Status fill(const TrackColumns& columns, const Tracks& tracks, u64 t, const SceneRays& rays) {
  const ResidentScene& scene = *rays.scene;
  const Entity* entity = scene.snapshot().find(tracks.camera);
  if (entity->camera->rays)
    return fail(Code::kUnimplemented, "camera",
                fmt::format("'{}' has a ray table, which does not tell where it sees a point; "
                            "follow points with another camera",
                            scene.snapshot().name_of(tracks.camera)));
  const ImageCamera image = image_camera(
      *entity->camera, world_pose(scene.snapshot(), tracks.camera.index(), tracks.times[t]),
      entity->camera->width, entity->camera->height);
  const kernels::CameraView camera = camera_view(image);
  const kernels::ProbeScene at{&scene.view(), &camera};
  const auto& slots = scene.structure().slot_of_entity;
  for (u64 i = 0; i < tracks.points.size(); ++i)
    if (const EntityId id = tracks.points[i].entity; slots[id.index()] == kNone)
      return fail(Code::kInvalidArgument, "entities",
                  fmt::format("'{}' shows no mesh; give it one, or make it visible",
                              scene.snapshot().name_of(id)));
  parallel_ranges(u64(tracks.points.size()), u64(256), [&](u64 begin, u64 end) {
    u32 traced = 0;
    const kernels::CountedTracer<HostTracer> counted{*rays.tracer, traced};
    for (u64 i = begin; i < end; ++i) {
      const TrackPoint& point = tracks.points[i];
      const kernels::Surface s = kernels::locate(scene.view(), slots[point.entity.index()],
                                                 point.primitive, point.barycentric, 0);
      const glm::dvec3 p_camera(image.camera_from_world_cv * glm::dvec4(glm::dvec3(s.p), 1));
      const glm::dvec2 seen = project(image, p_camera);
      columns.set(i, t,
                  {.image = seen,
                   .depth = p_camera.z,
                   .p_world = s.p,
                   .visible = kernels::inside_image(camera, vec2(seen) + 0.5f) &&
                              kernels::camera_sees(at, counted, s, tracks.through_transmission)});
    }
  });
  return {};
}

}  // namespace

Expected<QueryResult> follow(const Tracks& tracks, const SceneAt& scene_at,
                             const Interrupt& interrupt) {
  QueryResult result;
  const TrackColumns columns(result, tracks);
  for (u64 t = 0; t < tracks.times.size(); ++t) {
    HELIO_TRY(interrupt.status());
    const auto scene = scene_at(tracks.times[t]);
    if (!scene) return std::unexpected(scene.error());
    HELIO_TRY(fill(columns, tracks, t, *scene));
  }
  return result;
}

}  // namespace heliograph::host
