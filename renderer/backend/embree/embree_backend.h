// The CPU backend, made by registry.cpp.
#pragma once

#include "renderer/device/backend.h"

namespace heliograph::embree {

[[nodiscard]] Expected<std::unique_ptr<Backend>> make_embree_backend(const BackendOptions& options);

}  // namespace heliograph::embree
