// The GPU programs, compiled with nvcc: each .cu beside this file.
#pragma once

#include <cstddef>
#include <span>

namespace heliograph::cuda {

/// Fat binaries; none where nvcc was not found when this was built.
[[nodiscard]] std::span<const std::byte* const> programs();

}  // namespace heliograph::cuda
