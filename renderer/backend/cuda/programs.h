// The GPU programs, compiled with nvcc: programs.cu.
#pragma once

#include <cstddef>
#include <span>

namespace heliograph::cuda {

/// A fat binary; empty where nvcc was not found when this was built.
[[nodiscard]] std::span<const std::byte> programs();

}  // namespace heliograph::cuda
