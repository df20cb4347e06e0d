// Requirements of a job on its snapshot, checked before it is queued. Called by Engine::submit.
#pragma once

#include "renderer/base/error.h"
#include "renderer/frame/job.h"

namespace heliograph {

/// Most pixels a side, samples a pixel and bytes of planes of one frame.
struct JobLimits {
  u32 size = 16384;
  u32 spp = 1u << 20;
  u64 film_bytes = 8ull << 30;
  u64 mask_bytes = 1ull << 30;
  float canvas = 8;
};

/// Fails with NOT_FOUND (a stale camera), FAILED_PRECONDITION (not a camera; flow without another
/// end), INVALID_ARGUMENT (sizes, samples, planes), RESOURCE_EXHAUSTED (bytes); `where` names the
/// field of RenderRequest.
[[nodiscard]] Status check_job(const RenderJob& job, const JobLimits& limits);

/// Time of labels and centre planes; with a rolling shutter those of the first row.
[[nodiscard]] Time label_time(const RenderJob& job);
/// Seconds between the label time and the other end of flow: the job's, or else the length of
/// the last advance; 0 when there is none.
[[nodiscard]] double flow_interval(const RenderJob& job);
[[nodiscard]] bool wants_forward(const RenderJob& job);
[[nodiscard]] bool wants_backward(const RenderJob& job);
[[nodiscard]] bool wants_samples(const RenderJob& job);  // some plane averages samples
/// True if some plane but beauty_still does.
[[nodiscard]] bool wants_open_shutter(const RenderJob& job);
[[nodiscard]] bool wants_label_columns(const RenderJob& job);
/// True if the film keeps second moments: for the plane `variance` or to stop by noise.
[[nodiscard]] bool measures_noise(const RenderJob& job);
/// True if anything is seen at the label time: labels, centre planes, beauty_still.
[[nodiscard]] bool wants_still(const RenderJob& job);
/// True if any centre plane is wanted, by the job or by its labels.
[[nodiscard]] bool wants_probe(const RenderJob& job);
/// The rendered size of a camera that check_job() has accepted.
[[nodiscard]] uvec2 rendered_size(const RenderJob& job, EntityId camera);

}  // namespace heliograph
