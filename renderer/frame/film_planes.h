// The planes that films have, for a job's post planes to be computed from. Called by checks, films
// and the runner.
#pragma once

#include "renderer/frame/frame.h"

namespace heliograph {

using kernels::PlaneSet;

/// The planes that samples make.
inline constexpr PlaneSet kSampledPlanes =
    kernels::planes_of(kernels::Fold::kMean) | kernels::planes_of(kernels::Fold::kFilm);

/// True if a plane is made of samples, or computed from one that is.
[[nodiscard]] bool is_averaged(Plane plane);
/// The planes that a job asks for, and those that its post planes are computed from.
[[nodiscard]] PlaneSet wanted_planes(const RenderJob& job);

/// True if a job asks for a post plane.
[[nodiscard]] bool wants_post(const RenderJob& job);
/// The planes that a backend makes for a job: those it asks for that are no post planes, in its
/// order, then what the post planes are computed from.
[[nodiscard]] std::vector<Plane> film_planes(const RenderJob& job);
/// True if anybody but DENOISED reads a plane of film_planes(): the job's reader, or another post
/// plane.
[[nodiscard]] bool is_read_beside(const RenderJob& job, Plane film_plane);

}  // namespace heliograph
