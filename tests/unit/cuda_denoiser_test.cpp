// The denoiser on a GPU, with a driver and a library that stand for the real ones: what they are
// asked for, and what is said where they cannot. Pictures are checked by tests/gpu/denoise.py.
#include "renderer/backend/cuda/denoiser.h"

#include <dlfcn.h>

#include <filesystem>

#include "tests/unit/catch.h"
#include "tests/unit/fake_driver.h"
#include "tests/unit/fake_oidn.h"

using namespace heliograph;
using namespace heliograph::cuda;

namespace {

int primary_users = 0, own_contexts = 0, resets = 0;
bool is_primary_taken = false, is_lost = false;

Driver counting_driver() {
  Driver driver = test::fake_driver();
  primary_users = own_contexts = resets = 0;
  is_primary_taken = is_lost = false;
  driver.primary_state = [](Device, unsigned*, int* taken) { return *taken = is_primary_taken, 0; };
  driver.retain_primary = [](ContextHandle* context, Device) {
    return *context = reinterpret_cast<ContextHandle>(0x7), ++primary_users, 0;
  };
  driver.release_primary = [](Device) { return --primary_users, 0; };
  driver.reset_primary = [](Device) { return ++resets, primary_users = 0, 0; };
  driver.create_context = [](ContextHandle* context, unsigned, Device) {
    return *context = reinterpret_cast<ContextHandle>(0x8), ++own_contexts, 0;
  };
  driver.destroy_context = [](ContextHandle) { return --own_contexts, 0; };
  driver.create_stream = [](StreamHandle* stream, unsigned) {
    return *stream = reinterpret_cast<StreamHandle>(0x5), 0;
  };
  driver.error_name = driver.error_text = [](Result, const char** text) { return *text = "", 0; };
  driver.wait_for_stream = [](StreamHandle) { return is_lost ? 700 : 0; };
  return driver;
}

/// The library, and what it was told; as new.
struct FakeLibrary {
  const std::string path =
      std::filesystem::read_symlink("/proc/self/exe").replace_filename("fake_oidn.so");
  void* handle = ::dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL);
  FakeOidn& state = *static_cast<FakeOidn*>(::dlsym(handle, "fake_oidn_state"));
  FakeLibrary() { state = {}; }
  ~FakeLibrary() { ::dlclose(handle); }
};

std::shared_ptr<Context> context_of(const Driver& driver) {
  auto context = Context::create(driver, 0);
  REQUIRE(context);
  return *context;
}

/// A picture whose beauty is 7 with alphas 0, 1, 2... and whose albedo is `albedo`.
struct Picture {
  Picture(u32 w, u32 h, float albedo)
      : beauty(4ul * w * h, 7),
        guide(3ul * w * h, albedo),
        out(beauty.size()),
        width(w),
        height(h) {
    for (u32 i = 0; i < width * height; ++i) beauty[4ul * i + 3] = float(i);
  }
  [[nodiscard]] DevicePicture there() const {
    const auto at = [](const auto& v) { return DevicePointer(v.data()); };
    return {width, height, at(beauty), at(guide), at(guide), at(out)};
  }
  [[nodiscard]] bool is_filtered() const {
    for (u32 i = 0; i < width * height; ++i)
      for (u32 c = 0; c < 4; ++c)
        if (out[4ul * i + c] != (c < 3 ? 2 * guide[3ul * i + c] : float(i))) return false;
    return true;
  }
  std::vector<float> beauty, guide, out;
  u32 width, height;
};

}  // namespace

TEST_CASE("cuda denoiser: filters device memory on the context's stream, a filter for each size") {
  FakeLibrary library;
  {
    const auto context = context_of(counting_driver());
    const auto denoiser = CudaDenoiser::create(*context, library.path);
    REQUIRE(denoiser);
    CHECK((*denoiser)->name() == "Open Image Denoise 2.5.1 on the GPU");
    CHECK((library.state.index == 0 && library.state.stream == context->stream()));
    CHECK((library.state.executed == 1 && library.state.filters == 0));  // the test picture
    for (const float albedo : {0.25f, 0.75f}) {
      Picture picture(5, 3, albedo);
      REQUIRE((*denoiser)->denoise(picture.there()));
      CHECK(picture.is_filtered());
      CHECK(picture.beauty[0] == 7);
    }
    CHECK((library.state.made == 2 && library.state.filters == 1));
    const Picture other(4, 4, 1);
    REQUIRE((*denoiser)->denoise(other.there()));
    CHECK(other.is_filtered());
    CHECK((library.state.made == 3 && library.state.filters == 1));
    CHECK((primary_users == 1 && own_contexts == 0));
  }
  CHECK((library.state.filters == 0 && library.state.devices == 0));
  CHECK((primary_users == 0 && test::fake_allocations == 0));
  CHECK(library.state.misuse == nullptr);
}

TEST_CASE("cuda denoiser: says why it is not there") {
  FakeLibrary library;
  const auto context = context_of(counting_driver());
  const auto refused = [&](const char* says) {
    const auto denoiser = CudaDenoiser::create(*context, library.path);
    REQUIRE_FALSE(denoiser);
    INFO(denoiser.error().message);
    CHECK(denoiser.error().code == Code::kUnimplemented);
    CHECK(denoiser.error().message.find(says) != std::string::npos);
    CHECK((library.state.devices == 0 && library.state.filters == 0));
  };
  library.state.has_gpu = false;
  refused("no device on the GPU: unsupported device type");
  library.state.has_gpu = true;
  library.state.start_error = "the driver is too old";
  refused("does not start: the driver is too old");
  library.state.start_error = nullptr;
  library.state.denoises = false;
  refused("did not denoise a test picture");
  const auto nowhere = CudaDenoiser::create(*context, "/nowhere/libOpenImageDenoise.so.2");
  REQUIRE_FALSE(nowhere);
  CHECK(nowhere.error().message.find("--denoiser") != std::string::npos);
}

TEST_CASE("cuda denoiser: a filter without memory is tried again, and what fails is told") {
  FakeLibrary library;
  const auto context = context_of(counting_driver());
  const auto denoiser = CudaDenoiser::create(*context, library.path);
  REQUIRE(denoiser);
  const Picture picture(5, 3, 0.5f);
  library.state.filter_error = "out of memory";
  REQUIRE((*denoiser)->denoise(picture.there()));
  CHECK(picture.is_filtered());
  CHECK(library.state.misuse == nullptr);
}

TEST_CASE("cuda denoiser: it needs the process's first context, and a lost one is left alone") {
  FakeLibrary library;
  Driver driver = counting_driver();
  {
    const auto context = context_of(driver);
    const auto denoiser = CudaDenoiser::create(*context, library.path);
    REQUIRE(denoiser);
    const Picture picture(5, 3, 0.5f);
    REQUIRE((*denoiser)->denoise(picture.there()));
    is_lost = true;
    CHECK_FALSE(context->wait());
    CHECK(context->is_lost());
  }
  CHECK((library.state.filters == 1 && library.state.devices == 1 && resets == 1));
  is_lost = false;
  is_primary_taken = true;
  {
    const auto context = context_of(driver);
    CHECK((own_contexts == 1 && !context->is_primary()));
    const auto denoiser = CudaDenoiser::create(*context, library.path);
    REQUIRE_FALSE(denoiser);
    CHECK(denoiser.error().message.find("restart the daemon") != std::string::npos);
  }
  CHECK((own_contexts == 0 && primary_users == 0 && resets == 1));
}
