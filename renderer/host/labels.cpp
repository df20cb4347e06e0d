#include "renderer/host/labels.h"

#include <fmt/format.h>

#include "renderer/host/silhouettes.h"

namespace heliograph::host {

namespace {

Status check_rows(std::size_t rows, const LabelOptions& options) {
  if (rows <= options.max_rows) return {};
  auto error =
      fail(Code::kResourceExhausted, "labels.max_rows",
           fmt::format("{} labelled instances; raise max_rows, now {}", rows, options.max_rows));
  error.error().needed = rows;
  error.error().available = options.max_rows;
  return error;
}

template <class T>
std::vector<T> flat(const ChunkedArray<T>& rows) {
  std::vector<T> all;
  all.reserve(rows.size());
  for (u32 c = 0; c < rows.chunk_count(); ++c)
    all.insert(all.end(), rows.chunk(c).begin(), rows.chunk(c).end());
  return all;
}

}  // namespace

Expected<std::vector<Column>> labels(const HostFilm& film, const SceneRays& rays,
                                     const Interrupt& interrupt) {
  const ResidentScene& scene = *rays.scene;
  const LabelOptions& options = film.job().labels;
  const Labelling& labelling = scene.structure().labelling;
  HELIO_TRY(check_rows(labelling.instances.size(), options));
  const auto frames = scene.labels(interrupt);
  if (!frames) return std::unexpected(frames.error());
  const kernels::CameraView& camera = film.still().camera;
  const auto* plane = static_cast<const u32*>(film.view().planes[u32(Plane::INSTANCE)]);
  const u64 pixels = plane ? u64(film.view().width) * film.view().height : 0;
  const auto* distances = static_cast<const float*>(film.view().planes[u32(Plane::DISTANCE)]);
  // Before what a pixel shows there may be glass, or the displaced part of a body.
  const bool seen_through = film.job().settings.through_transmission || scene.view().any_priority;
  std::vector<Silhouette> silhouettes;
  std::vector<KeypointLabel> keypoints;
  if (options.amodal || options.amodal_masks)
    silhouettes = trace_silhouettes(
        rays, {camera, options, {plane, pixels}, {distances, seen_through ? 0 : pixels}},
        interrupt);
  HELIO_TRY(interrupt.status());
  if (options.keypoints) keypoints = trace_keypoints(rays, camera, film.image_camera(), options);
  return label_columns({.snapshot = scene.snapshot(),
                        .labelling = labelling,
                        .camera = film.image_camera(),
                        .frames = flat((*frames)->frames),
                        .boxes = flat((*frames)->boxes),
                        .instance_plane = {plane, pixels},
                        .silhouettes = silhouettes,
                        .keypoints = keypoints,
                        .options = options});
}

}  // namespace heliograph::host
