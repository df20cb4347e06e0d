// The GPU backend where there is no GPU: it says so, and nothing else happens. What it renders is
// checked by tests/gpu, on a machine that has one.
#include "renderer/backend/cuda/cuda_backend.h"

#include <dlfcn.h>

#include "renderer/backend/cuda/driver.h"
#include "renderer/backend/cuda/programs.h"
#include "tests/unit/catch.h"

using namespace heliograph;

TEST_CASE("cuda: without a driver or without programs the backend is unavailable, and says why") {
  if (void* driver = dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL)) {
    dlclose(driver);
    return;
  }
  const auto backend = cuda::make_cuda_backend({});
  REQUIRE_FALSE(backend);
  CHECK(backend.error().code == Code::kUnavailable);
  CHECK(backend.error().where == "backend");
  const char* reason = cuda::programs().empty() ? "nvcc" : "driver";
  CHECK(backend.error().message.find(reason) != std::string::npos);
  const auto driver = cuda::load_driver();
  REQUIRE_FALSE(driver);
  CHECK(driver.error().message.find("embree") != std::string::npos);
}
