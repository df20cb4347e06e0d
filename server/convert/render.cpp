// Checks a RenderRequest, in the order of its fields.
#include "server/convert/render.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <set>

#include "renderer/frame/check.h"
#include "renderer/frame/frame.h"
#include "server/convert/fields.h"
#include "server/convert/resolve.h"
#include "server/convert/transaction.h"
#include "server/os/hash.h"

namespace heliograph::server {
namespace {

using kernels::PixelFilter;

constexpr Range kSeconds{-1e9, 1e9};
constexpr u32 kDefaultDepth = 12;
constexpr u32 kDefaultRouletteDepth = 3;
constexpr u32 kDefaultRows = 65536;
constexpr Range kCanvas{0, 4};
constexpr Range kClamp{1e-6, 1e30};
constexpr Range kPriority{-100, 100};

constexpr std::array kFilters{PixelFilter::kBlackmanHarris, PixelFilter::kBox, PixelFilter::kTent,
                              PixelFilter::kGaussian, PixelFilter::kBlackmanHarris};
static_assert(kFilters.size() == v1::PixelFilter_ARRAYSIZE);

bool is_disparity(Plane plane) {
  return (kernels::planes_from<kernels::ProbeStereo>() & kernels::plane_bit(plane)) != 0;
}

Status read_cameras(const v1::RenderRequest& request, const RenderLimits& limits, RenderJob& job) {
  const auto count = u32(request.cameras_size());
  if (count < 1 || count > limits.cameras)
    return fail(Code::kInvalidArgument, "cameras",
                fmt::format("has {} entries; name 1 to {} cameras", count, limits.cameras));
  for (u32 i = 0; i < count; ++i)
    HELIO_TAKE(job.cameras.emplace_back(), resolve_camera(request.cameras(int(i)), *job.snapshot),
               indexed("cameras", i));
  return {};
}

Status check_group(const std::string& group, const Snapshot& snapshot) {
  const auto known = light_groups(snapshot);
  if (group.empty() || known.contains(group)) return {};
  return fail(Code::kNotFound, "group",
              fmt::format("nothing has the light group '{}'; there are: '{}'", group,
                          fmt::join(known, "', '")));
}

/// The arguments of a plane: disparity has a second camera, beauty_group its group.
Status read_argument(const v1::PlaneRequest& request, Plane plane, RenderJob& job) {
  if (plane == Plane::BEAUTY_GROUP) {
    HELIO_TRY(check_group(request.group(), *job.snapshot));
    job.groups.push_back(request.group());
  } else if (!request.group().empty()) {
    return fail(Code::kInvalidArgument, "group", "is for PLANE_BEAUTY_GROUP; leave it out");
  }
  if (is_disparity(plane) != request.has_camera())
    return fail(Code::kInvalidArgument, "camera",
                request.has_camera() ? "is for the disparity planes; leave it out"
                                     : "is missing; name the second camera of the rig");
  if (!is_disparity(plane)) return {};
  EntityId camera;
  HELIO_TAKE(camera, resolve_camera(request.camera(), *job.snapshot), "camera");
  if (job.disparity_camera && job.disparity_camera != camera)
    return fail(Code::kInvalidArgument, "camera",
                "differs from another disparity plane's; ask for one second camera a request");
  job.disparity_camera = camera;
  return {};
}

Status read_planes(const v1::RenderRequest& request, const RenderLimits& limits, RenderJob& job) {
  std::set<std::pair<Plane, std::string>> seen;
  for (int i = 0; i < request.planes_size(); ++i) {
    const std::string where = indexed("planes", u64(i));
    Plane plane{};
    HELIO_TAKE(plane, to_plane(request.planes(i).plane()), where);
    if (!seen.emplace(plane, request.planes(i).group()).second)
      return fail(Code::kInvalidArgument, where,
                  fmt::format("{} is asked for twice; leave one out",
                              v1::Plane_Name(request.planes(i).plane())));
    if (request.planes(i).half() && plane_info(plane).dtype != DType::kF32)
      return fail(Code::kInvalidArgument, where + ".half",
                  fmt::format("is for planes of f32, which {} is not; leave it out",
                              plane_info(plane).name));
    HELIO_CHECK(read_argument(request.planes(i), plane, job), where);
    job.planes.push_back(plane);
  }
  if (job.groups.size() > limits.groups)
    return std::unexpected(
        Error{.code = Code::kInvalidArgument,
              .message = fmt::format("has {} light groups; ask for at most {} (limit groups)",
                                     job.groups.size(), limits.groups),
              .where = "planes",
              .limit = "groups",
              .needed = job.groups.size(),
              .available = limits.groups});
  return {};
}

Status read_size(const v1::RenderRequest& request, const RenderLimits& limits, RenderJob& job) {
  if (request.has_width() != request.has_height())
    return fail(Code::kInvalidArgument, request.has_width() ? "height" : "width",
                "is missing; give both, or neither for the camera's own size");
  if (!request.has_width()) return {};
  const Range side{1, double(limits.size)};
  HELIO_TAKE(job.width, in_range(request.width(), side), "width");
  HELIO_TAKE(job.height, in_range(request.height(), side), "height");
  return {};
}

Status read_times(const v1::RenderRequest& request, RenderJob& job) {
  const Snapshot& snapshot = *job.snapshot;
  job.time = snapshot.time;
  if (request.has_time()) HELIO_TAKE(job.time, in_range(request.time(), kSeconds), "time");
  if (request.has_label_time())
    HELIO_TAKE(job.label_time, in_range(request.label_time(), kSeconds), "label_time");
  job.hold = request.hold();
  if (!request.has_frame_interval()) {
    job.frame_interval = snapshot.previous ? snapshot.time - snapshot.previous->time : 0;
    return {};
  }
  HELIO_TAKE(job.frame_interval, in_range(request.frame_interval(), {0, 1e9}), "frame_interval");
  if (job.frame_interval == 0)
    return fail(Code::kInvalidArgument, "frame_interval",
                "is 0; give the seconds to the next frame, or leave it out");
  return {};
}

Status read_stop_rule(const v1::RenderRequest& request, const RenderLimits& limits,
                      RenderJob& job) {
  if (request.has_spp())
    HELIO_TAKE(job.stop.spp, in_range(request.spp(), {1, double(limits.spp)}), "spp");
  if (request.has_seconds())
    HELIO_TAKE(job.stop.seconds, in_range(request.seconds(), {1e-3, limits.seconds}), "seconds");
  if (request.has_noise())
    HELIO_TAKE(job.stop.noise, in_range(request.noise(), {1e-6, 1}), "noise");
  job.progressive = request.progressive();
  job.stop.adaptive = request.adaptive();
  job.stop.tile_rounds = request.tile_rounds();
  if (job.stop.tile_rounds > 0 && !job.stop.adaptive)
    return fail(Code::kInvalidArgument, "tile_rounds", "is for adaptive sampling; set adaptive");
  if (!wants_samples(job) || job.stop.tile_rounds > 0 || request.has_spp() ||
      request.has_seconds() || request.has_noise())
    return {};
  return fail(Code::kInvalidArgument, "spp",
              "is missing; these planes are averaged over samples: set spp, seconds or noise");
}

/// Checks planes that stay on the device: only those made there can.
Status read_memory(const v1::RenderRequest& request, RenderJob& job) {
  job.on_device = request.memory() == v1::FRAME_MEMORY_CUDA;
  for (std::size_t i = 0; job.on_device && i < job.planes.size(); ++i) {
    const PlaneInfo& info = plane_info(job.planes[i]);
    const bool half = request.planes(int(i)).half();
    const bool is_made_there =
        info.fold != kernels::Fold::kPost || job.planes[i] == Plane::DENOISED;
    if (is_made_there && !half) continue;
    return fail(Code::kUnimplemented, indexed("planes", i) + (half ? ".half" : ""),
                fmt::format("{} is made on the host and cannot stay on the device; ask for it "
                            "without `memory`",
                            half ? "a half float" : info.name));
  }
  return {};
}

Status read_settings(const v1::RenderRequest& request, const RenderLimits& limits,
                     kernels::Settings& settings) {
  settings.seed = request.seed();
  settings.max_depth = kDefaultDepth;
  if (request.has_max_depth())
    HELIO_TAKE(settings.max_depth, in_range(request.max_depth(), {1, double(limits.max_depth)}),
               "max_depth");
  settings.roulette_depth = kDefaultRouletteDepth;
  if (request.has_roulette_depth())
    HELIO_TAKE(settings.roulette_depth,
               in_range(request.roulette_depth(), {1, double(limits.max_depth)}), "roulette_depth");
  if (request.has_roulette() && !request.roulette()) settings.roulette_depth = kernels::kNone;
  settings.clamp = INFINITY;
  if (request.has_clamp()) HELIO_TAKE(settings.clamp, in_range(request.clamp(), kClamp), "clamp");
  settings.clamp_indirect = settings.clamp;
  if (request.has_clamp_indirect())
    HELIO_TAKE(settings.clamp_indirect, in_range(request.clamp_indirect(), kClamp),
               "clamp_indirect");
  settings.clamp_indirect = std::min(settings.clamp, settings.clamp_indirect);
  settings.regularize = request.regularize();
  settings.filter = from_enum(kFilters, request.filter());
  settings.transparent_background = request.transparent_background();
  settings.through_transmission = request.through_transmission();
  HELIO_TAKE(settings.vertex, in_range(request.vertex(), {0, double(limits.max_depth)}), "vertex");
  return {};
}

/// Refuses planes that are counted or sensed at a later vertex, which is no view.
Status check_vertex(const RenderJob& job) {
  if (job.settings.vertex == 0) return {};
  const auto refuse = [](const char* what) {
    return fail(
        Code::kInvalidArgument, "vertex",
        fmt::format("is above 0, but {} of the first surfaces; leave one of both out", what));
  };
  const LabelOptions& labels = job.labels;
  if (labels.boxes || labels.amodal || labels.keypoints) return refuse("labels are");
  if (job.settings.through_transmission) return refuse("through_transmission is");
  if (std::ranges::count(job.planes, Plane::SENSOR_DEPTH) > 0) return refuse("sensor_depth is");
  return {};
}

Status read_labels(const v1::LabelRequest& request, const RenderLimits& limits,
                   LabelOptions& labels) {
  labels.boxes = request.boxes();
  labels.amodal_masks = request.amodal_masks();
  labels.amodal = request.amodal() || request.amodal_masks();
  labels.keypoints = request.keypoints();
  if (request.has_canvas())
    HELIO_TAKE(labels.canvas, in_range(request.canvas(), kCanvas), "canvas");
  if (request.has_keypoint_radius())
    HELIO_TAKE(labels.keypoint_radius, in_range(request.keypoint_radius(), {0, 1e9}),
               "keypoint_radius");
  labels.max_rows = kDefaultRows;
  if (request.max_rows() > 0)
    HELIO_TAKE(labels.max_rows, in_range(request.max_rows(), {1, double(limits.label_rows)}),
               "max_rows");
  return {};
}

}  // namespace

Expected<RenderJob> to_job(const v1::RenderRequest& request,
                           std::shared_ptr<const Snapshot> snapshot, const RenderLimits& limits) {
  HELIO_TRY(check_known(request));
  RenderJob job{.snapshot = std::move(snapshot), .scene = request.scene()};
  if (request.has_overlay()) job.overlay = overlay_hash(request.overlay());
  HELIO_TRY(read_cameras(request, limits, job));
  HELIO_TRY(read_planes(request, limits, job));
  HELIO_TRY(read_size(request, limits, job));
  HELIO_TRY(read_times(request, job));
  HELIO_TRY(read_stop_rule(request, limits, job));
  HELIO_TRY(read_settings(request, limits, job.settings));
  HELIO_TRY(read_memory(request, job));
  HELIO_CHECK(read_labels(request.labels(), limits, job.labels), "labels");
  HELIO_TRY(check_vertex(job));
  HELIO_TAKE(job.origin.priority, in_range(request.priority(), kPriority), "priority");
  const LabelOptions& labels = job.labels;
  if (job.planes.empty() && !labels.boxes && !labels.amodal && !labels.keypoints)
    return fail(Code::kInvalidArgument, "planes",
                "is empty; ask for at least one plane, or for labels");
  return job;
}

namespace {

/// Returns true when the predicate holds for an array of a message, or of a nested one.
bool any_array(const google::protobuf::Message& message, bool (*is_so)(const v1::Array&)) {
  using google::protobuf::FieldDescriptor;
  if (message.GetDescriptor() == v1::Array::descriptor())
    return is_so(static_cast<const v1::Array&>(message));
  const auto& reflection = *message.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  return std::ranges::any_of(fields, [&](const FieldDescriptor* field) {
    if (field->cpp_type() != FieldDescriptor::CPPTYPE_MESSAGE || field->is_map()) return false;
    if (!field->is_repeated()) return any_array(reflection.GetMessage(message, field), is_so);
    for (int i = 0; i < reflection.FieldSize(message, field); ++i)
      if (any_array(reflection.GetRepeatedMessage(message, field, i), is_so)) return true;
    return false;
  });
}

}  // namespace

bool names_lent_buffers(const google::protobuf::Message& message) {
  return any_array(message, [](const v1::Array& a) { return a.buffer().generation() != 0; });
}

bool has_arrays_elsewhere(const google::protobuf::Message& message) {
  return any_array(message, [](const v1::Array& array) {
    return array.source_case() != v1::Array::kInline &&
           array.source_case() != v1::Array::SOURCE_NOT_SET;
  });
}

u64 overlay_hash(const v1::Transaction& overlay) {
  static std::atomic<u64> lent = 0;
  std::string content = serialize(overlay);
  if (names_lent_buffers(overlay)) content += std::to_string(++lent);
  const std::string digest = sha256(content);
  u64 hash = 0;
  std::memcpy(&hash, digest.data(), sizeof hash);
  return std::max<u64>(hash, 1);
}

}  // namespace heliograph::server
