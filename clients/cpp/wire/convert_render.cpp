// RenderOptions to a RenderRequest.
#include <algorithm>
#include <cctype>

#include "heliograph/error.h"
#include "wire/convert.h"

namespace heliograph::client::wire {
namespace {

constexpr std::uint32_t kDefaultSpp = 64;

/// Row of a plane in the daemon's list; null where it has none.
const v1::PlaneKind* kind_of(const v1::GetServerInfoReply& server, v1::Plane plane) {
  for (const v1::PlaneKind& kind : server.planes())
    if (kind.plane() == plane) return &kind;
  return nullptr;
}
/// True where the daemon lists one of the planes as `averaged`, or does not list it.
bool may_any(const v1::GetServerInfoReply& server, const v1::RenderRequest& request,
             bool averaged) {
  const auto& planes = request.planes();
  return std::any_of(planes.begin(), planes.end(), [&](const v1::PlaneRequest& plane) {
    const v1::PlaneKind* kind = kind_of(server, plane.plane());
    return !kind || kind->averaged() == averaged;
  });
}

/// "depth", "disparity:right" or "beauty:GROUP".
void put_plane(const std::string& plane, v1::PlaneRequest* out) {
  const std::size_t colon = plane.find(':');
  const std::string base = plane.substr(0, colon);
  const bool has_argument = colon != std::string::npos;
  const bool is_group = base == "beauty" && has_argument;
  std::string wanted = "PLANE_" + (is_group ? "beauty_group" : base);
  std::transform(wanted.begin(), wanted.end(), wanted.begin(),
                 [](unsigned char c) { return char(std::toupper(c)); });
  v1::Plane found = v1::PLANE_UNSPECIFIED;
  if (!v1::Plane_Parse(wanted, &found) || found == v1::PLANE_UNSPECIFIED)
    throw ClientError(Code::kInvalidArgument,
                      "planes: no plane \"" + base + "\"; docs/planes.md lists them", {"planes"});
  out->set_plane(found);
  if (is_group)
    out->set_group(plane.substr(colon + 1));
  else if (has_argument)
    out->mutable_camera()->set_name(plane.substr(colon + 1));
}

void put_labels(const v1::GetServerInfoReply& server, const RenderOptions::Fields& given,
                v1::RenderRequest* out) {
  if (!given.labels) {  // boxes where a plane looks at first surfaces anyway
    if (given.vertex == 0 && may_any(server, *out, false)) out->mutable_labels()->set_boxes(true);
    return;
  }
  const Labels& labels = *given.labels;
  v1::LabelRequest* to = out->mutable_labels();
  to->set_boxes(labels.boxes);
  to->set_amodal(labels.amodal);
  to->set_amodal_masks(labels.amodal_masks);
  to->set_keypoints(labels.keypoints);
  if (labels.canvas) to->set_canvas(*labels.canvas);
  if (labels.keypoint_radius) to->set_keypoint_radius(*labels.keypoint_radius);
  to->set_max_rows(labels.max_rows);
}

void put_stop_rule(const v1::GetServerInfoReply& server, const RenderOptions::Fields& given,
                   v1::RenderRequest* out) {
  if (given.spp) out->set_spp(*given.spp);
  if (given.seconds) out->set_seconds(*given.seconds);
  if (given.noise) out->set_noise(*given.noise);
  out->set_adaptive(given.adaptive);
  if (!given.spp && !given.seconds && !given.noise && may_any(server, *out, true))
    out->set_spp(kDefaultSpp);
}

void put_view(const RenderOptions::Fields& given, v1::RenderRequest* out) {
  if (given.width) out->set_width(*given.width);
  if (given.height) out->set_height(*given.height);
  if (given.time) out->set_time(*given.time);
  if (given.label_time) out->set_label_time(*given.label_time);
  if (given.frame_interval) out->set_frame_interval(*given.frame_interval);
  out->set_hold(given.hold);
  if (given.revision) out->set_revision(*given.revision);
  if (given.min_revision) out->set_min_revision(*given.min_revision);
  if (given.overlay) *out->mutable_overlay() = given.overlay->transaction;
}

void put_half(const RenderOptions::Fields& given, v1::RenderRequest* out) {
  for (const std::string& plane : given.half) {
    const auto found = std::find(given.planes.begin(), given.planes.end(), plane);
    if (found == given.planes.end())
      throw ClientError(Code::kInvalidArgument, "half: \"" + plane + "\" is not among planes",
                        {"half"});
    out->mutable_planes(int(found - given.planes.begin()))->set_half(true);
  }
}

}  // namespace

v1::RenderRequest to_request(const v1::GetServerInfoReply& server, std::uint64_t scene,
                             const std::vector<Ref>& cameras, const RenderOptions& options) {
  const RenderOptions::Fields& given = options.fields();
  v1::RenderRequest out;
  out.set_scene(scene);
  out.set_seed(given.seed);
  for (const Ref& camera : cameras) put_ref(camera, nullptr, "cameras", out.add_cameras());
  for (const std::string& plane : given.planes) put_plane(plane, out.add_planes());
  put_half(given, &out);
  put_stop_rule(server, given, &out);
  put_view(given, &out);
  put_labels(server, given, &out);
  if (given.max_depth) out.set_max_depth(*given.max_depth);
  if (given.roulette) out.set_roulette(*given.roulette);
  if (given.roulette_depth) out.set_roulette_depth(*given.roulette_depth);
  if (given.clamp) out.set_clamp(float(*given.clamp));
  if (given.clamp_indirect) out.set_clamp_indirect(float(*given.clamp_indirect));
  out.set_regularize(given.regularize);
  if (given.filter) out.set_filter(v1::PixelFilter(int(*given.filter)));
  out.set_transparent_background(given.transparent_background);
  out.set_through_transmission(given.through_transmission);
  out.set_vertex(given.vertex);
  out.set_progressive(bool(given.on_pass));
  return out;
}

}  // namespace heliograph::client::wire
