#include "renderer/host/silhouettes.h"

#include <algorithm>
#include <bit>
#include <optional>

#include "kernels/camera/rolling.h"
#include "kernels/media/volume_march.h"
#include "renderer/base/parallel.h"
#include "renderer/host/object_rays.h"
#include "renderer/placement/canvas.h"

namespace heliograph::host {

namespace {

constexpr i32 kLines = 8;  // a task: so many image lines start at a whole byte of a packed mask

/// Lines of one instance, and what they hold.
struct Task {
  u32 row;
  i32 y0, y1;
  u32 inside = 0;
  u32 canvas = 0;
  PixelBox box_inside, box_canvas;
};

struct Reach {  // where a slot or a volume may be seen
  u32 label;
  PixelBox box;
  u32 slot = kNone;
  u32 volume = kNone;  // index into SceneView::volumes
};

std::array<vec3, 8> world_corners(const kernels::VolumeView& volume) {
  const kernels::GridView& grid = volume.density;
  const mat4x3 world_from_voxel =
      multiply(volume.instance.world_from_object, kernels::inverse_of(grid.voxel_from_object));
  std::array<vec3, 8> corners;
  for (u32 i = 0; i < 8; ++i) {
    const ivec3 voxel(i & 1 ? grid.upper.x : grid.lower.x, i & 2 ? grid.upper.y : grid.lower.y,
                      i & 4 ? grid.upper.z : grid.lower.z);
    corners[i] = world_from_voxel * vec4(vec3(voxel), 1);
  }
  return corners;
}

/// The slots and volumes of each row that reach the canvas.
std::vector<std::vector<Reach>> reaches(const ResidentScene& scene,
                                        const kernels::CameraView& camera, const PixelBox& canvas) {
  const Placement& placement = scene.placement();
  const Structure& structure = scene.structure();
  const auto& instances = placement.instances();
  std::vector<std::vector<Reach>> out(structure.labelling.instances.size());
  for (u32 slot = 0; slot < structure.slots.size(); ++slot) {
    const u32 row = structure.slots[slot].row;
    if (row == kNone || !(instances[slot].visibility & kernels::kCameraRay)) continue;
    const PixelBox box = bounds_on_canvas(placement, slot, camera, canvas);
    if (box.x1 > box.x0)
      out[row].push_back({.label = instances[slot].label, .box = box, .slot = slot});
  }
  for (u32 i = 0; i < structure.volumes.size(); ++i) {
    const u32 row = structure.volumes[i].row;
    const kernels::VolumeView& volume = scene.view().volumes[i];
    if (row == kNone || !(volume.instance.visibility & kernels::kCameraRay)) continue;
    const PixelBox box = volume.instance.segments > 0
                             ? canvas
                             : bounds_on_canvas(world_corners(volume), camera, canvas);
    if (box.x1 > box.x0)
      out[row].push_back({.label = volume.instance.label, .box = box, .volume = i});
  }
  return out;
}

std::vector<Task> make_tasks(const std::vector<std::vector<Reach>>& reaches) {
  std::vector<Task> tasks;
  for (u32 row = 0; row < reaches.size(); ++row) {
    if (reaches[row].empty()) continue;
    i32 y0 = reaches[row][0].box.y0, y1 = reaches[row][0].box.y1;
    for (const Reach& reach : reaches[row]) {
      y0 = std::min(y0, reach.box.y0);
      y1 = std::max(y1, reach.box.y1);
    }
    for (i32 y = y0; y < y1;) {
      const i32 next = std::min(y1, (y & ~(kLines - 1)) + kLines);
      tasks.push_back({.row = row, .y0 = y, .y1 = next});
      y = next;
    }
  }
  return tasks;
}

class SilhouetteTracer {
 public:
  SilhouetteTracer(const SceneRays& scene, const SilhouetteInputs& in)
      : tracer_(*scene.tracer),
        scene_(scene.scene->view()),
        instances_(scene_.instances),
        camera_(in.camera),
        plane_(in.instance_plane),
        distances_(in.distance_plane) {}

  /// Traces the task's pixels; sets their bits in `mask` unless it is null. A pixel whose centre
  /// ray met the instance belongs to it without another ray.
  void trace(Task& task, const std::vector<Reach>& reaches, u8* mask) const {
    std::optional<kernels::CameraAt> now;
    std::vector<ObjectRays> rays;
    const auto look_at = [&](float time) {
      now.emplace(camera_, time);
      rays = rays_of(reaches, now->camera());
    };
    const i32 at_once = camera_.table.times ? 1 : kLanes;
    for (i32 y = task.y0; y < task.y1; ++y) {
      if (!now || camera_.shutter.row != 0) look_at(kernels::row_time(camera_, float(y) + 0.5f));
      i32 x0 = INT32_MAX, x1 = INT32_MIN;
      for (const Reach& reach : reaches)
        if (y >= reach.box.y0 && y < reach.box.y1) {
          x0 = std::min(x0, reach.box.x0);
          x1 = std::max(x1, reach.box.x1);
        }
      for (i32 x = x0; x < x1; x += at_once) {
        if (camera_.table.times) look_at(kernels::pixel_time(camera_, u32(x), u32(y)));
        const u32 lanes = (1u << std::min(at_once, x1 - x)) - 1;
        u32 met = seen(reaches[0].label, x, y) & lanes;
        for (std::size_t i = 0; i < reaches.size() && met != lanes; ++i)
          met |= meets(reaches[i], rays[i], {x, y}, lanes & ~met);
        for (; met; met &= met - 1) add(task, x + std::countr_zero(met), y, mask);
      }
    }
  }

 private:
  static constexpr i32 kLanes = RayPacket::kRays;

  /// The rays of a camera that stands still to each slot.
  [[nodiscard]] std::vector<ObjectRays> rays_of(const std::vector<Reach>& reaches,
                                                const kernels::CameraView& camera) const {
    std::vector<ObjectRays> rays;
    for (const Reach& reach : reaches)
      rays.emplace_back(
          camera,
          reach.slot == kNone  // volumes take the world's rays
              ? mat4x3(1)
              : kernels::pose_at(scene_, instances_[reach.slot], camera.time).object_from_world);
    return rays;
  }
  [[nodiscard]] bool in_image(i32 x, i32 y) const {
    return x >= 0 && y >= 0 && x < i32(camera_.width) && y < i32(camera_.height);
  }
  /// Bits of the pixels from (x, y) on that show the label.
  [[nodiscard]] u32 seen(u32 label, i32 x, i32 y) const {
    u32 bits = 0;
    for (i32 i = 0; i < kLanes; ++i)
      if (in_image(x + i, y) && plane_[u64(y) * camera_.width + u64(x + i)] == label)
        bits |= 1u << i;
    return bits;
  }
  /// Distances of what the pixels from (x, y) on show; 0 outside of the image.
  [[nodiscard]] Distances distances(i32 x, i32 y) const {
    Distances out{};
    for (i32 i = 0; i < kLanes && !distances_.empty(); ++i)
      if (in_image(x + i, y)) out[std::size_t(i)] = distances_[u64(y) * camera_.width + u64(x + i)];
    return out;
  }
  void add(Task& task, i32 x, i32 y, u8* mask) const {
    ++task.canvas;
    task.box_canvas.extend(x, y);
    if (!in_image(x, y)) return;
    ++task.inside;
    task.box_inside.extend(x, y);
    const u64 bit = u64(y) * camera_.width + u64(x);
    if (mask) mask[bit / 8] = u8(mask[bit / 8] | (0x80u >> (bit % 8)));
  }
  /// True if a volume alone brings the transmittance of a world's ray of any length to one half.
  [[nodiscard]] bool meets(u32 volume, kernels::Ray ray) const {
    const float length = glm::length(ray.direction);
    ray.direction /= length;
    ray.t_max *= length;
    kernels::MarchedSet set;
    set.add(kernels::make_marched(scene_, volume, ray, ray.t_max));
    return kernels::march(scene_, set).volume != kNone;
  }
  /// Bits of the lanes from `first` on that meet one slot or volume.
  [[nodiscard]] u32 meets(const Reach& reach, const ObjectRays& rays, glm::ivec2 first,
                          u32 lanes) const {
    u32 wanted = 0;
    for (i32 i = 0; i < kLanes; ++i) {
      const i32 x = first.x + i;
      const bool want = (lanes >> i & 1) && first.y >= reach.box.y0 && first.y < reach.box.y1 &&
                        x >= reach.box.x0 && x < reach.box.x1;
      wanted |= u32(want) << i;
    }
    if (wanted == 0) return 0;
    RayPacket rays_behind;
    wanted &=
        rays.through(float(first.x), float(first.y), distances(first.x, first.y), rays_behind);
    const bool is_volume = reach.slot == kNone;
    if (!is_volume && !(instances_[reach.slot].flags & kernels::kMayBeHole))
      return tracer_.meets_of(reach.slot, rays_behind, wanted);
    u32 met = 0;
    for (; wanted; wanted &= wanted - 1) {
      const u32 i = u32(std::countr_zero(wanted));
      const kernels::Ray ray = rays_behind.ray(i);
      if (is_volume ? meets(reach.volume, ray) : tracer_.meets(reach.slot, ray)) met |= 1u << i;
    }
    return met;
  }

  const HostTracer& tracer_;
  const kernels::SceneView& scene_;
  const kernels::InstanceView* instances_;
  const kernels::CameraView& camera_;
  std::span<const u32> plane_;
  std::span<const float> distances_;
};

void merge(PixelBox& into, const PixelBox& box) {
  if (box.x1 == box.x0) return;
  into.extend(box.x0, box.y0);
  into.extend(box.x1 - 1, box.y1 - 1);
}

/// The diagonal of a mesh's rest box.
float diameter(const DeviceMesh& mesh) {
  return mesh.rest.empty() ? 0 : glm::length(mesh.rest.upper - mesh.rest.lower);
}

/// A keypoint at the time of the row that sees it.
struct KeypointSight {
  kernels::Sighting seen;
  vec3 p_world;

  /// OpenCV camera frame; in double where the camera stands still.
  [[nodiscard]] glm::dvec3 p_camera(const kernels::CameraView& view,
                                    const ImageCamera& camera) const {
    if (view.segments == 0)
      return {camera.camera_from_world_cv * glm::dvec4(glm::dvec3(p_world), 1)};
    const kernels::CameraAt now(view, seen.time);
    return kernels::point_in_camera(now.camera(), p_world);
  }
  [[nodiscard]] kernels::Ray ray(const kernels::CameraView& view) const {
    const kernels::CameraAt now(view, seen.time);
    return kernels::clipped(now.camera(), kernels::camera_ray_to(now.camera(), p_world, kProbe));
  }
  [[nodiscard]] bool in_clip(const kernels::CameraView& view) const {
    return kernels::within_clip(kernels::CameraAt(view, seen.time).camera(), p_world);
  }
};

KeypointSight see_keypoint(const kernels::SceneView& scene, const kernels::InstanceView& instance,
                           const kernels::CameraView& view, vec3 p_object) {
  const auto point_at = [&](float time) {
    return kernels::transform_point(kernels::pose_at(scene, instance, time).world_from_object,
                                    p_object);
  };
  KeypointSight sight;
  sight.seen = kernels::find_row(
      view, 0.5f * float(view.height),
      [&](const kernels::CameraView& now) { return kernels::project(now, point_at(now.time)); });
  sight.p_world = point_at(sight.seen.time);
  return sight;
}

/// A ray to a point, and how near to it a surface does not hide it.
struct RayToPoint {
  kernels::Ray ray;
  float radius;
};
KeypointLabel::State state_of(const HostTracer& tracer, const kernels::SceneView& scene, u32 label,
                              RayToPoint to) {
  using State = KeypointLabel::State;
  to.ray.t_max = std::max(0.0f, to.ray.t_max - to.radius);
  const kernels::Hit hit = tracer.closest(to.ray, kernels::kCameraRay);
  if (hit.instance == kNone) return State::kVisible;
  return scene.instances[hit.instance].label == label ? State::kSelfOccluded : State::kOccluded;
}

}  // namespace

std::vector<Silhouette> trace_silhouettes(const SceneRays& scene, const SilhouetteInputs& in,
                                          const Interrupt& interrupt) {
  const kernels::CameraView& camera = in.camera;
  const LabelOptions& options = in.options;
  const auto reach = reaches(*scene.scene, camera, canvas_of(camera, options.canvas));
  std::vector<Silhouette> out(reach.size());
  if (options.amodal_masks)
    for (Silhouette& silhouette : out)
      silhouette.mask.resize((u64(camera.width) * camera.height + 7) / 8);

  std::vector<Task> tasks = make_tasks(reach);
  const SilhouetteTracer tracer(scene, in);
  parallel_ranges(tasks.size(), std::size_t(4), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end && !interrupt.requested(); ++i) {
      Task& task = tasks[i];
      tracer.trace(task, reach[task.row],
                   options.amodal_masks ? out[task.row].mask.data() : nullptr);
    }
  });
  for (const Task& task : tasks) {
    Silhouette& silhouette = out[task.row];
    silhouette.inside += task.inside;
    silhouette.canvas += task.canvas;
    merge(silhouette.box_inside, task.box_inside);
    merge(silhouette.box_canvas, task.box_canvas);
  }
  return out;
}

std::vector<KeypointLabel> trace_keypoints(const SceneRays& scene, const kernels::CameraView& view,
                                           const ImageCamera& camera, const LabelOptions& options) {
  const Structure& structure = scene.scene->structure();
  const Placement& placement = scene.scene->placement();
  const auto& instances = placement.instances();
  const kernels::SceneView& seen = scene.scene->view();
  std::vector<std::vector<KeypointLabel>> rows(structure.labelling.instances.size());
  for (u32 slot = 0; slot < structure.slots.size(); ++slot) {
    const u32 row = structure.slots[slot].row;
    if (row == kNone) continue;
    const DeviceMesh& mesh = placement.mesh(slot);
    const kernels::InstanceView& instance = instances[slot];
    const float radius = options.keypoint_radius.value_or(
        0.005f * diameter(mesh) * glm::length(instance.world_from_object[0]));
    for (const Keypoint& keypoint : mesh.topology->keypoints) {
      const KeypointSight sight = see_keypoint(seen, instance, view, keypoint.position);
      const glm::dvec3 p_camera = sight.p_camera(view, camera);
      KeypointLabel label{instance.label, keypoint.name, vec3(p_camera), vec2(NAN),
                          KeypointLabel::State::kOutside};
      if (sight.seen.found) label.p_image = vec2(project(camera, p_camera));
      if (kernels::inside_image(view, label.p_image + 0.5f) && sight.in_clip(view))
        label.state = state_of(*scene.tracer, seen, instance.label, {sight.ray(view), radius});
      rows[row].push_back(std::move(label));
    }
  }
  std::vector<KeypointLabel> out;
  for (auto& row : rows) out.insert(out.end(), row.begin(), row.end());
  return out;
}

}  // namespace heliograph::host
