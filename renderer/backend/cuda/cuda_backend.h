// The GPU backend.
#pragma once

#include "renderer/device/backend.h"

namespace heliograph::cuda {

/// Fails with UNAVAILABLE where there is no driver or no GPU; FAILED_PRECONDITION as
/// make_backend().
[[nodiscard]] Expected<std::unique_ptr<Backend>> make_cuda_backend(const BackendOptions& options);

/// Number of GPUs that the driver shows. Fails like make_cuda_backend().
[[nodiscard]] Expected<u32> gpu_count();

}  // namespace heliograph::cuda
