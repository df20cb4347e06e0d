#include "renderer/backend/embree/silhouettes.h"

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <algorithm>

#include "kernels/camera.h"

namespace heliograph::embree {

namespace {

constexpr i32 kLines = 8;  // a task: so many image lines start at a whole byte of a packed mask
constexpr kernels::HoleKey kProbe{0, true};

/// Lines of one instance, and what they hold.
struct Task {
  u32 row;
  i32 y0, y1;
  u32 inside = 0;
  u32 canvas = 0;
  PixelBox box_inside, box_canvas;
};

struct Reach {  // where a slot may be seen
  u32 slot;
  PixelBox box;
};

PixelBox canvas_of(const kernels::CameraView& camera, float extend) {
  const auto x = i32(std::lround(extend * float(camera.width)));
  const auto y = i32(std::lround(extend * float(camera.height)));
  return {-x, -y, i32(camera.width) + x, i32(camera.height) + y};
}

/// The slots of each row that reach the canvas.
std::vector<std::vector<Reach>> reaches(const Placement& placement,
                                        const kernels::CameraView& camera, const PixelBox& canvas) {
  const Structure& structure = *placement.structure;
  std::vector<std::vector<Reach>> out(structure.labelling.instances.size());
  for (u32 slot = 0; slot < structure.slots.size(); ++slot) {
    const u32 row = structure.slots[slot].row;
    if (row == kNone) continue;
    const PixelBox box = bounds_on_canvas(placement, slot, camera, canvas);
    if (box.x1 > box.x0) out[row].push_back({slot, box});
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
  SilhouetteTracer(const TracedScene& scene, const kernels::CameraView& camera)
      : tracer_(scene), camera_(camera) {}

  /// Traces the task's pixels; sets their bits in `mask` unless it is null.
  void trace(Task& task, const std::vector<Reach>& reaches, u8* mask) const {
    for (i32 y = task.y0; y < task.y1; ++y) {
      i32 x0 = INT32_MAX, x1 = INT32_MIN;
      for (const Reach& reach : reaches)
        if (y >= reach.box.y0 && y < reach.box.y1) {
          x0 = std::min(x0, reach.box.x0);
          x1 = std::max(x1, reach.box.x1);
        }
      for (i32 x = x0; x < x1; ++x) {
        if (!meets(reaches, x, y)) continue;
        ++task.canvas;
        task.box_canvas.extend(x, y);
        if (x < 0 || y < 0 || x >= i32(camera_.width) || y >= i32(camera_.height)) continue;
        ++task.inside;
        task.box_inside.extend(x, y);
        const u64 bit = u64(y) * camera_.width + u64(x);
        if (mask) mask[bit / 8] = u8(mask[bit / 8] | (0x80u >> (bit % 8)));
      }
    }
  }

 private:
  [[nodiscard]] bool meets(const std::vector<Reach>& reaches, i32 x, i32 y) const {
    const auto ray = kernels::camera_ray(camera_, vec2(float(x) + 0.5f, float(y) + 0.5f), kProbe);
    return std::ranges::any_of(reaches, [&](const Reach& reach) {
      return x >= reach.box.x0 && x < reach.box.x1 && y >= reach.box.y0 && y < reach.box.y1 &&
             tracer_.closest_in(reach.slot, ray).instance != kNone;
    });
  }

  EmbreeTracer tracer_;
  const kernels::CameraView& camera_;
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

}  // namespace

PixelBox bounds_on_canvas(const Placement& placement, u32 slot, const kernels::CameraView& camera,
                          const PixelBox& canvas) {
  RTCBounds bounds;
  rtcGetSceneBounds(placement.instance_scenes[slot], &bounds);
  if (!(bounds.lower_x <= bounds.upper_x)) return {};
  const mat4x3& world = placement.instances[slot].world_from_object;
  vec2 low(INFINITY), high(-INFINITY);
  u32 behind = 0;
  for (u32 i = 0; i < 8; ++i) {
    const vec3 corner(i & 1 ? bounds.upper_x : bounds.lower_x,
                      i & 2 ? bounds.upper_y : bounds.lower_y,
                      i & 4 ? bounds.upper_z : bounds.lower_z);
    const kernels::Projected p = kernels::project(camera, world * vec4(corner, 1));
    behind += !p.in_front;
    low = glm::min(low, p.raster);
    high = glm::max(high, p.raster);
  }
  if (behind == 8) return {};
  if (behind > 0) return canvas;
  const auto clip = [](float v, i32 from, i32 to) {
    return i32(std::clamp(v, float(from), float(to)));
  };
  const PixelBox box{clip(std::floor(low.x) - 1, canvas.x0, canvas.x1),
                     clip(std::floor(low.y) - 1, canvas.y0, canvas.y1),
                     clip(std::ceil(high.x) + 1, canvas.x0, canvas.x1),
                     clip(std::ceil(high.y) + 1, canvas.y0, canvas.y1)};
  return box.x0 < box.x1 && box.y0 < box.y1 ? box : PixelBox{};
}

std::vector<Silhouette> trace_silhouettes(const Placement& placement, const TracedScene& scene,
                                          const kernels::CameraView& camera,
                                          const LabelOptions& options, const Interrupt& interrupt) {
  const auto reach = reaches(placement, camera, canvas_of(camera, options.canvas));
  std::vector<Silhouette> out(reach.size());
  if (options.amodal_masks)
    for (Silhouette& silhouette : out)
      silhouette.mask.resize((u64(camera.width) * camera.height + 7) / 8);

  std::vector<Task> tasks = make_tasks(reach);
  const SilhouetteTracer tracer(scene, camera);
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, tasks.size(), 4), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end() && !interrupt.requested(); ++i) {
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

std::vector<KeypointLabel> trace_keypoints(const Placement& placement, const TracedScene& scene,
                                           const kernels::CameraView& view,
                                           const ImageCamera& camera, const LabelOptions& options) {
  using State = KeypointLabel::State;
  const Structure& structure = *placement.structure;
  const EmbreeTracer tracer(scene);
  std::vector<std::vector<KeypointLabel>> rows(structure.labelling.instances.size());
  for (u32 slot = 0; slot < structure.slots.size(); ++slot) {
    const u32 row = structure.slots[slot].row;
    if (row == kNone) continue;
    const DeviceMesh& mesh = *placement.meshes[placement.mesh_of_slot[slot]];
    const kernels::InstanceView& instance = placement.instances[slot];
    const float radius = options.keypoint_radius.value_or(
        0.005f * diameter(mesh) * glm::length(instance.world_from_object[0]));
    for (const Keypoint& keypoint : mesh.topology->keypoints) {
      const vec3 p_world = instance.world_from_object * vec4(keypoint.position, 1);
      const glm::dvec3 p_camera(camera.camera_from_world_cv * glm::dvec4(glm::dvec3(p_world), 1));
      const glm::dvec2 image = project(camera, p_camera);
      KeypointLabel label{instance.label, keypoint.name, vec3(p_camera), vec2(image),
                          State::kOutside};
      if (p_camera.z > 0 && kernels::inside_image(view, vec2(image) + 0.5f)) {
        kernels::Ray ray = kernels::camera_ray_to(view, p_world, kProbe);
        ray.t_max = std::max(0.0f, ray.t_max - radius);
        const kernels::Hit hit = tracer.closest(ray, kernels::kCameraRay);
        label.state = hit.instance == kNone ? State::kVisible
                      : scene.view->instances[hit.instance].label == instance.label
                          ? State::kSelfOccluded
                          : State::kOccluded;
      }
      rows[row].push_back(std::move(label));
    }
  }
  std::vector<KeypointLabel> out;
  for (auto& row : rows) out.insert(out.end(), row.begin(), row.end());
  return out;
}

}  // namespace heliograph::embree
