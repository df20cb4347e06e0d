// Checks of jobs.
#include "renderer/frame/check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "kernels/camera/projection.h"
#include "kernels/scene/ray.h"
#include "renderer/frame/film_planes.h"
#include "renderer/frame/image_camera.h"
#include "renderer/frame/worlds.h"
#include "renderer/scene/labels.h"
#include "renderer/scene/motion.h"

namespace heliograph {
namespace {

using kernels::Fold;

/// True if a job asks for a plane that is read from this part, or for one computed from it.
template <class Part>
bool wants(const RenderJob& job) {
  return (wanted_planes(job) & kernels::planes_from<Part>()) != 0;
}

Status check_camera(const RenderJob& job, EntityId id, const std::string& where) {
  const Entity* entity = job.snapshot->find(id);
  if (!entity) return fail(Code::kNotFound, where, "there is no such entity in this revision");
  if (!entity->camera)
    return fail(Code::kFailedPrecondition, where,
                fmt::format("'{}' has no camera; put one with camera=", job.snapshot->name_of(id)));
  const vec3 eye = world_pose(*job.snapshot, id.index(), label_time(job))[3];
  for (int axis = 0; axis < 3; ++axis)
    if (!(std::abs(eye[axis]) <= kernels::kReach))
      return fail(Code::kFailedPrecondition, where,
                  fmt::format("'{}' is at {:g} {:g} {:g}; rays begin within {:g} m of the world's "
                              "origin, along each axis",
                              job.snapshot->name_of(id), eye.x, eye.y, eye.z, kernels::kReach));
  return {};
}

Status check_size(const RenderJob& job, EntityId camera, const JobLimits& limits) {
  const uvec2 size = rendered_size(job, camera);
  for (const auto& [value, name] : {std::pair{size.x, "width"}, {size.y, "height"}})
    if (value == 0 || value > limits.size)
      return fail(Code::kInvalidArgument, name,
                  fmt::format("{} must be in [1, {}], is {}", name, limits.size, value));
  u64 bytes = 0;
  for (const Plane plane : film_planes(job)) {
    const PlaneInfo& info = plane_info(plane);
    bytes += u64(size.x) * size.y * info.channels * size_of(info.dtype) *
             (info.fold == Fold::kMean ? 2 : 1);
  }
  if (bytes <= limits.film_bytes) return {};
  auto error = fail(Code::kResourceExhausted, "planes",
                    fmt::format("the planes take {} bytes, {} are allowed; ask for a smaller image",
                                bytes, limits.film_bytes));
  error.error().needed = bytes;
  error.error().available = limits.film_bytes;
  return error;
}

Status check_stop_rule(const RenderJob& job, const JobLimits& limits) {
  const StopRule& stop = job.stop;
  if (stop.spp > limits.spp)
    return fail(Code::kInvalidArgument, "spp",
                fmt::format("spp must be at most {}, is {}", limits.spp, stop.spp));
  if (!(stop.seconds >= 0)) return fail(Code::kInvalidArgument, "seconds", "must be at least 0");
  if (!(stop.noise >= 0)) return fail(Code::kInvalidArgument, "noise", "must be at least 0");
  if (wants_samples(job) && stop.spp == 0 && stop.seconds == 0 && stop.noise == 0 &&
      stop.tile_rounds == 0)
    return fail(Code::kInvalidArgument, "spp",
                "these planes average samples: set spp, seconds or noise");
  return {};
}

Status check_flow(const RenderJob& job) {
  if (!wants_forward(job) && !wants_backward(job)) return {};
  const double interval = flow_interval(job);
  if (!(interval > 0) || !std::isfinite(interval))
    return fail(Code::kFailedPrecondition, "frame_interval",
                "flow needs another end: set frame_interval, or move the scene with advance()");
  if (job.hold) return {};
  double rolling = 0;
  for (const EntityId camera : job.cameras)
    rolling = std::max(rolling, job.snapshot->find(camera)->camera->shutter.rolling);
  const Time first = label_time(job), last = first + rolling;
  if (wants_forward(job))
    HELIO_TRY(flow_defined(*job.snapshot, first, last + interval, job.cameras));
  if (wants_backward(job))
    HELIO_TRY(flow_defined(*job.snapshot, last, first - interval, job.cameras));
  return {};
}

Status check_labels(const RenderJob& job, const JobLimits& limits) {
  const LabelOptions& labels = job.labels;
  if (!wants_label_columns(job)) return {};
  if (!(labels.canvas >= 0 && labels.canvas <= limits.canvas))
    return fail(Code::kInvalidArgument, "labels.canvas",
                fmt::format("canvas must be in [0, {}], is {}", limits.canvas, labels.canvas));
  for (const EntityId camera : job.cameras) {
    const uvec2 size = rendered_size(job, camera);
    const auto side = [&](u32 pixels) {
      return pixels + 2 * u64(std::lround(double(labels.canvas) * pixels));
    };
    if (side(size.x) * side(size.y) > std::numeric_limits<u32>::max())
      return fail(Code::kInvalidArgument, "labels.canvas",
                  fmt::format("a canvas of {} around {}x{} has more pixels than are counted, 2^32; "
                              "ask for a smaller one",
                              labels.canvas, size.x, size.y));
  }
  if (labels.keypoint_radius && !(*labels.keypoint_radius >= 0))
    return fail(Code::kInvalidArgument, "labels.keypoint_radius", "must be at least 0");
  const u64 rows = label_entities(*job.snapshot).instances.size();
  if (rows > labels.max_rows) {
    auto error = fail(Code::kResourceExhausted, "labels.max_rows",
                      fmt::format("{} labelled instances, max_rows is {}", rows, labels.max_rows));
    error.error().needed = rows;
    error.error().available = labels.max_rows;
    return error;
  }
  if (!labels.amodal_masks) return {};
  for (const EntityId camera : job.cameras) {
    const uvec2 size = rendered_size(job, camera);
    const u64 bytes = rows * ((u64(size.x) * size.y + 7) / 8);
    if (bytes <= limits.mask_bytes) continue;
    auto error =
        fail(Code::kResourceExhausted, "labels.amodal_masks",
             fmt::format("the masks take {} bytes, {} are allowed", bytes, limits.mask_bytes));
    error.error().needed = bytes;
    error.error().available = limits.mask_bytes;
    return error;
  }
  return {};
}

bool has_keypoints(const Snapshot& snapshot) {
  bool any = false;
  snapshot.meshes.for_each(
      [&](u32, const Shared<Mesh>& row) { any |= !row.value->topology->keypoints.empty(); });
  return any;
}

/// Refuses answers that a camera whose pixels have rays of their own cannot give, as it does not
/// know where it sees a point.
Status check_ray_tables(const RenderJob& job) {
  using kernels::planes_from;
  const PlaneSet flow =
      (planes_from<kernels::ProbeForward>() | planes_from<kernels::ProbeBackward>()) &
      ~plane_bit(Plane::SCENE_FLOW);
  for (const EntityId id : job.cameras) {
    const Camera& camera = *job.snapshot->find(id)->camera;
    if (!camera.rays) continue;
    const auto refuse = [&](Code code, const char* field, const std::string& why) {
      return fail(code, field,
                  fmt::format("'{}' has a ray table{}", job.snapshot->name_of(id), why));
    };
    constexpr const char* kNoPlace = ", which does not tell where it sees a point; ";
    if (rendered_size(job, id) != uvec2(camera.width, camera.height))
      return refuse(Code::kInvalidArgument, "width",
                    fmt::format(" of {} x {} rays; render it at that size: leave out width and "
                                "height",
                                camera.width, camera.height));
    if (wanted_planes(job) & flow)
      return refuse(Code::kUnimplemented, "planes",
                    std::string(kNoPlace) + "ask for scene_flow in place of flow in pixels");
    if (job.labels.keypoints && has_keypoints(*job.snapshot))
      return refuse(Code::kUnimplemented, "labels.keypoints",
                    std::string(kNoPlace) + "leave out keypoints");
  }
  return {};
}

/// Refuses a camera unless it and the second camera of disparity show a point in the same row: the
/// same way of looking to 1e-4 radians, side by side, the same rows.
Status check_rectified(const RenderJob& job, EntityId first) {
  const auto image_of = [&](EntityId id) {
    const uvec2 size = rendered_size(job, id);
    return image_camera(*job.snapshot->find(id)->camera,
                        world_pose(*job.snapshot, id.index(), label_time(job)), size.x, size.y);
  };
  const ImageCamera a = image_of(first), b = image_of(job.disparity_camera);
  const auto rolling = [&](EntityId id) { return job.snapshot->find(id)->camera->shutter.rolling; };
  const auto refuse = [&](const char* what) {
    return fail(Code::kFailedPrecondition, "planes.camera",
                fmt::format("'{}' and '{}' are no rectified rig: {}", job.snapshot->name_of(first),
                            job.snapshot->name_of(job.disparity_camera), what));
  };
  if (!kernels::is_rectilinear(a.lens) || !kernels::is_rectilinear(b.lens) ||
      a.lens.projection != b.lens.projection)
    return refuse("give both the same projection, perspective or orthographic, and no distortion");
  if (rolling(first) != rolling(job.disparity_camera)) return refuse("give both the same rolling");
  const double rows =
      std::abs(a.k[1][1] / b.k[1][1] - 1) * a.height + std::abs(a.k[2][1] - b.k[2][1]);
  if (a.width != b.width || a.height != b.height) return refuse("give both the same size");
  if (rows > 0.01 || std::abs(a.k[0][0] / b.k[0][0] - 1) > 1e-6)
    return refuse("give both the same fx, fy and cy");
  const glm::dmat4 b_from_a = b.camera_from_world_cv * glm::inverse(a.camera_from_world_cv);
  for (int i = 0; i < 3; ++i)
    for (int j = 0; j < 3; ++j)
      if (std::abs(b_from_a[i][j] - (i == j)) > 1e-4) return refuse("turn both the same way");
  const glm::dvec3 offset(b_from_a[3]);
  if (std::hypot(offset.y, offset.z) > 1e-4 * std::abs(offset.x) + 1e-6)
    return refuse("place one beside the other along the image's x axis");
  return {};
}

/// The planes of sensors need cameras that have them.
Status check_sensors(const RenderJob& job) {
  for (const EntityId id : job.cameras) {
    const Camera& camera = *job.snapshot->find(id)->camera;
    const bool mosaic =
        camera.rgb_sensor && camera.rgb_sensor->pattern != RgbSensor::Pattern::kNone;
    for (const auto& [plane, has_it, name] :
         {std::tuple{Plane::SENSOR_RGB, camera.rgb_sensor.has_value(), "rgb_sensor"},
          {Plane::SENSOR_MOSAIC, mosaic, "rgb_sensor with a pattern"},
          {Plane::SENSOR_DEPTH, camera.depth_sensor.has_value(), "depth_sensor"}})
      if (std::ranges::count(job.planes, plane) > 0 && !has_it)
        return fail(Code::kFailedPrecondition, "planes",
                    fmt::format("the camera '{}' has no {}; put one with camera=",
                                job.snapshot->name_of(id), name));
  }
  return {};
}

Status check_disparity(const RenderJob& job) {
  if (!wants<kernels::ProbeStereo>(job)) return {};
  if (!job.disparity_camera)
    return fail(Code::kInvalidArgument, "planes.camera",
                "disparity needs a second camera: set PlaneRequest.camera");
  HELIO_TRY(check_camera(job, job.disparity_camera, "planes.camera"));
  for (const EntityId camera : job.cameras) HELIO_TRY(check_rectified(job, camera));
  return {};
}

Status check_groups(const RenderJob& job) {
  const auto planes = std::size_t(std::ranges::count(job.planes, Plane::BEAUTY_GROUP));
  if (planes == job.groups.size()) return {};
  return fail(Code::kInvalidArgument, "planes",
              fmt::format("{} names of light groups for {} planes", job.groups.size(), planes));
}

}  // namespace

bool measures_noise(const RenderJob& job) {
  return job.stop.noise > 0 || job.stop.adaptive || wants<kernels::SquareSum>(job);
}

bool wants_samples(const RenderJob& job) {
  return job.stop.noise > 0 || job.stop.adaptive || (wanted_planes(job) & kSampledPlanes) != 0;
}

bool wants_open_shutter(const RenderJob& job) {
  const PlaneSet open = kSampledPlanes & ~kernels::planes_from<kernels::StillFilm>();
  return job.stop.noise > 0 || job.stop.adaptive || (wanted_planes(job) & open) != 0;
}

bool wants_label_columns(const RenderJob& job) {
  const LabelOptions& l = job.labels;
  return l.boxes || l.amodal || l.amodal_masks || l.keypoints;
}

bool wants_probe(const RenderJob& job) {
  return wants_label_columns(job) || (wanted_planes(job) & kernels::planes_of(Fold::kCentre)) != 0;
}

bool wants_still(const RenderJob& job) {
  return wants_probe(job) || wants<kernels::StillFilm>(job);
}

bool wants_forward(const RenderJob& job) { return wants<kernels::ProbeForward>(job); }

bool wants_backward(const RenderJob& job) { return wants<kernels::ProbeBackward>(job); }

Time label_time(const RenderJob& job) { return job.label_time.value_or(job.time); }

double flow_interval(const RenderJob& job) {
  if (job.frame_interval != 0) return job.frame_interval;
  return job.snapshot->previous ? job.snapshot->time - job.snapshot->previous->time : 0;
}

uvec2 rendered_size(const RenderJob& job, EntityId camera) {
  const Camera& model = *job.snapshot->find(camera)->camera;
  return {job.width ? job.width : model.width, job.height ? job.height : model.height};
}

Status check_job(const RenderJob& job, const JobLimits& limits) {
  if (job.cameras.empty())
    return fail(Code::kInvalidArgument, "cameras", "name at least one camera");
  if (job.planes.empty() && !wants_label_columns(job))
    return fail(Code::kInvalidArgument, "planes", "ask for at least one plane, or for labels");
  for (std::size_t i = 0; i < job.cameras.size(); ++i) {
    HELIO_TRY(check_camera(job, job.cameras[i], fmt::format("cameras[{}]", i)));
    HELIO_TRY(check_size(job, job.cameras[i], limits));
  }
  HELIO_TRY(check_ray_tables(job));
  HELIO_TRY(check_stop_rule(job, limits));
  HELIO_TRY(check_disparity(job));
  HELIO_TRY(check_groups(job));
  HELIO_TRY(check_sensors(job));
  HELIO_TRY(check_labels(job, limits));
  HELIO_TRY(check_flow(job));
  return job.worlds ? check_worlds(job, limits) : Status{};
}

}  // namespace heliograph
