// The only file that knows which backends there are.
#include <fmt/format.h>

#include "renderer/backend/cuda/cuda_backend.h"
#include "renderer/backend/embree/embree_backend.h"
#include "renderer/device/backend.h"

namespace heliograph {

Expected<std::unique_ptr<Backend>> make_backend(std::string_view name,
                                                const BackendOptions& options) {
  if (name == "embree") return embree::make_embree_backend(options);
  if (name == "cuda") return cuda::make_cuda_backend(options);
  auto error = fail(Code::kNotFound, "backend", fmt::format("there is no backend '{}'", name));
  for (const std::string_view known : backend_names()) error.error().nearest.emplace_back(known);
  return error;
}

Expected<u32> device_count(std::string_view name) {
  return name == "cuda" ? cuda::gpu_count() : Expected<u32>(1);
}

std::vector<std::string_view> backend_names() { return {"embree", "cuda"}; }

}  // namespace heliograph
