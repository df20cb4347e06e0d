// The manifest of a frame: the request that renders it again.
#include <fmt/format.h>
#include <google/protobuf/util/json_util.h>

#include <nlohmann/json.hpp>

#include "server/convert/fields.h"
#include "server/convert/frame.h"
#include "server/convert/render.h"

namespace heliograph::server {
namespace {

constexpr std::size_t kLargestOverlay = 64 << 10;

/// Names the frame's cameras, by name where they have one: ids do not survive a scene file.
void name_cameras(const Frame& frame, v1::RenderRequest& request) {
  const auto name = [](v1::Ref& camera, const std::string& text) {
    if (!text.empty()) camera.set_name(text);
  };
  if (frame.worlds) {
    for (int i = 0; i < request.cameras_size(); ++i)
      name(*request.mutable_cameras(i), frame.worlds->cameras[std::size_t(i)]);
    return;
  }
  const v1::Ref camera = request.cameras(int(frame.index));
  request.clear_cameras();
  *request.add_cameras() = camera;
  name(*request.mutable_cameras(0), frame.camera);
}

/// Keeps worlds that are small and lie in the message completely.
void keep_worlds(const RenderJob& job, v1::RenderRequest& request) {
  v1::Worlds& worlds = *request.mutable_worlds();
  const auto is_here = [](const v1::Array& array) { return array.has_inline_(); };
  if (worlds.ByteSizeLong() > kLargestOverlay || names_lent_buffers(worlds) ||
      (worlds.has_poses() && !is_here(worlds.poses().matrices())) ||
      (worlds.has_mask() && !is_here(worlds.mask())))
    return request.clear_worlds();
  for (int i = 0; i < worlds.poses().entities_size(); ++i)
    if (const auto name = job.snapshot->name_of(job.worlds->entities[std::size_t(i)]);
        !name.empty())
      worlds.mutable_poses()->mutable_entities(i)->set_name(name);
}

}  // namespace

v1::RenderRequest request_again(const Frame& frame, const FrameContext& context) {
  const RenderJob& job = *context.job;
  v1::RenderRequest request = context.request;
  request.set_scene(frame.scene);
  request.set_revision(frame.revision);
  name_cameras(frame, request);
  if (const std::string second = job.snapshot->name_of(job.disparity_camera); !second.empty())
    for (v1::PlaneRequest& plane : *request.mutable_planes())
      if (plane.has_camera()) plane.mutable_camera()->set_name(second);
  request.set_width(frame.width);
  request.set_height(frame.height);
  request.set_time(frame.time);
  request.clear_label_time();  // an older client, which made the request without it, reads this too
  if (frame.label_time != frame.time) request.set_label_time(frame.label_time);
  if (job.frame_interval > 0) request.set_frame_interval(job.frame_interval);
  request.set_seed(frame.seed);
  request.clear_spp();
  request.clear_seconds();
  if (frame.tile_rounds > 0) {
    request.set_tile_rounds(frame.tile_rounds);
    if (job.stop.spp > 0) request.set_spp(job.stop.spp);
  } else {
    if (frame.samples > 0) request.set_spp(frame.samples);
    request.clear_adaptive();
    request.clear_noise();
  }
  request.clear_progressive();
  request.clear_priority();
  request.clear_memory();
  request.clear_buffers_in_header();
  request.set_max_depth(job.settings.max_depth);
  request.set_roulette(job.settings.roulette_depth != kernels::kNone);
  if (request.overlay().ByteSizeLong() > kLargestOverlay || names_lent_buffers(request.overlay()))
    request.clear_overlay();
  if (request.has_worlds()) keep_worlds(job, request);
  return request;
}

std::string json_of(const v1::RenderRequest& request) {
  std::string json;
  google::protobuf::util::JsonPrintOptions options;
  options.preserve_proto_field_names = true;
  return google::protobuf::util::MessageToJsonString(request, &json, options).ok() ? json : "{}";
}

std::string manifest(const Frame& frame, const FrameContext& context,
                     const std::string& request_json) {
  nlohmann::json head{{"format", "heliograph.manifest.v1"},
                      {"version", context.version},
                      {"backend", context.backend},
                      {"cpu_features", context.cpu_features}};
  if (!frame.denoiser.empty()) head["denoiser"] = frame.denoiser;
  if (frame.overlay) head["overlay"] = fmt::format("{:016x}", frame.overlay);
  if (frame.worlds) head["worlds"] = fmt::format("{}", context.job->worlds->count);
  if (context.trace) {
    head["trace"]["traceparent"] = context.trace.parent;
    if (!context.trace.state.empty()) head["trace"]["tracestate"] = context.trace.state;
  }
  std::string json = head.dump();
  json.pop_back();
  return json + ",\"request\":" + request_json + "}";
}

}  // namespace heliograph::server
