#include "renderer/backend/cuda/driver.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <algorithm>

namespace heliograph::cuda {

std::string Driver::describe(Result result) const {
  const char *name = nullptr, *text = nullptr;
  if (error_name(result, &name) != 0 || error_text(result, &text) != 0)
    return fmt::format("CUDA error {}", result);
  return fmt::format("{}: {}", name, text);
}

bool is_sticky(Result result) {
  // ECC, NVLink, contained; illegal address, timeout, assert; hardware stack, illegal instruction,
  // misaligned address, address space, program counter, launch failed; tensor memory.
  constexpr Result kSticky[] = {214, 220, 226, 700, 702, 710, 714, 715, 716, 717, 718, 719, 721};
  return std::ranges::count(kSticky, result) > 0;
}

Expected<Driver> load_driver() {
  Driver driver;
  driver.library = {dlopen("libcuda.so.1", RTLD_NOW | RTLD_LOCAL), [](void* library) {
                      if (library) dlclose(library);
                    }};
  if (!driver.library)
    return fail(Code::kUnavailable, "backend",
                fmt::format("there is no NVIDIA driver here ({}); install one, or use the backend "
                            "embree",
                            dlerror()));
  const char* missing = nullptr;
  const auto find = [&](auto& function, const char* symbol) {
    function = reinterpret_cast<std::remove_reference_t<decltype(function)>>(
        dlsym(driver.library.get(), symbol));
    if (!function && !missing) missing = symbol;
  };
#define HELIO_FIND(name, symbol, ...) find(driver.name, #symbol);
  HELIO_CUDA_FUNCTIONS(HELIO_FIND)
#undef HELIO_FIND
  if (missing)
    return fail(Code::kUnavailable, "backend",
                fmt::format("the NVIDIA driver lacks {}; install a newer one", missing));
  if (const Result result = driver.init(0); result != 0)
    return fail(is_sticky(result) ? Code::kFailedPrecondition : Code::kUnavailable, "backend",
                fmt::format("the NVIDIA driver does not start ({})", driver.describe(result)));
  return driver;
}

}  // namespace heliograph::cuda
