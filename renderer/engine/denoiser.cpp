// Loads Open Image Denoise and calls it.
#include "renderer/engine/denoiser.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cmath>
#include <vector>

#include "kernels/hash.h"

namespace heliograph {
namespace {

// Of oidn.h, version 2: what is called here.
struct Device;
struct Filter;
enum DeviceType : int { kCpuDevice = 1 };
enum Format : int { kFloat3 = 3 };
enum OidnError : int { kNone = 0 };
using Monitor = bool (*)(void* user, double done);

constexpr const char* kRemedy =
    "install it (pip install pyoidn), or name libOpenImageDenoise.so.2 with heliographd --denoiser";

/// A grey wall of radiance 1 under noise.
class SelfTest {
 public:
  SelfTest() {
    for (u32 i = 0; i < 4 * kPixels; ++i)
      if (i % 4 < 3) beauty_[i] = 2 * kernels::unit_float(kernels::hash32(i));
    for (u32 i = 2; i < 3 * kPixels; i += 3) normal_[i] = 1;
  }
  [[nodiscard]] DenoiseTask task() {
    return {kSize, kSize, beauty_.data(), albedo_.data(), normal_.data(), out_.data()};
  }
  /// Whether nine tenths of the noise are gone.
  [[nodiscard]] bool passed() const { return deviation(out_) < 0.1 * deviation(beauty_); }

 private:
  static constexpr u32 kSize = 64, kPixels = kSize * kSize;

  static double deviation(const std::vector<float>& picture) {
    double sum = 0;
    for (u32 i = 0; i < 4 * kPixels; ++i)
      if (i % 4 < 3) sum += std::pow(double(picture[i]) - 1, 2);
    return std::sqrt(sum / (3 * kPixels));
  }

  std::vector<float> beauty_ = std::vector<float>(4ul * kPixels, 1.0f);
  std::vector<float> albedo_ = std::vector<float>(3ul * kPixels, 0.5f);
  std::vector<float> normal_ = std::vector<float>(3ul * kPixels);
  std::vector<float> out_ = std::vector<float>(4ul * kPixels);
};

}  // namespace

/// The functions of the library, and a device.
class Denoiser::Library {
 public:
  [[nodiscard]] static Expected<std::unique_ptr<Library>> open(const std::string& name,
                                                               u32 threads);
  ~Library() {
    if (device_) release_device_(device_);
    if (handle_) ::dlclose(handle_);
  }
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;

  [[nodiscard]] Status run(const DenoiseTask& task, const Interrupt& interrupt);

 private:
  Library() = default;
  [[nodiscard]] bool bind();
  template <class F>
  [[nodiscard]] bool bind(F& function, const char* name) {
    function = reinterpret_cast<F>(::dlsym(handle_, name));
    return function != nullptr;
  }
  [[nodiscard]] Status error(const char* what);

  void* handle_ = nullptr;
  Device* device_ = nullptr;
  Device* (*new_device_)(DeviceType) = nullptr;
  void (*set_device_int_)(Device*, const char*, int) = nullptr;
  void (*commit_device_)(Device*) = nullptr;
  void (*release_device_)(Device*) = nullptr;
  OidnError (*device_error_)(Device*, const char**) = nullptr;
  Filter* (*new_filter_)(Device*, const char*) = nullptr;
  void (*set_image_)(Filter*, const char*, void*, Format, size_t, size_t, size_t, size_t,
                     size_t) = nullptr;
  void (*set_bool_)(Filter*, const char*, bool) = nullptr;
  void (*set_monitor_)(Filter*, Monitor, void*) = nullptr;
  void (*commit_filter_)(Filter*) = nullptr;
  void (*execute_filter_)(Filter*) = nullptr;
  void (*release_filter_)(Filter*) = nullptr;
};

bool Denoiser::Library::bind() {
  return bind(new_device_, "oidnNewDevice") && bind(set_device_int_, "oidnSetDeviceInt") &&
         bind(commit_device_, "oidnCommitDevice") && bind(release_device_, "oidnReleaseDevice") &&
         bind(device_error_, "oidnGetDeviceError") && bind(new_filter_, "oidnNewFilter") &&
         bind(set_image_, "oidnSetSharedFilterImage") && bind(set_bool_, "oidnSetFilterBool") &&
         bind(set_monitor_, "oidnSetFilterProgressMonitorFunction") &&
         bind(commit_filter_, "oidnCommitFilter") && bind(execute_filter_, "oidnExecuteFilter") &&
         bind(release_filter_, "oidnReleaseFilter");
}

Status Denoiser::Library::error(const char* what) {
  const char* text = nullptr;
  if (device_error_(device_, &text) == kNone) return {};
  return fail(Code::kInternal, "planes",
              fmt::format("Open Image Denoise failed to {}: {}", what, text ? text : "unknown"));
}

Expected<std::unique_ptr<Denoiser::Library>> Denoiser::Library::open(const std::string& name,
                                                                     u32 threads) {
  const auto missing = [](const std::string& why) {
    return fail(Code::kUnimplemented, "planes",
                fmt::format("DENOISED needs Open Image Denoise 2, which is not there ({}); {}", why,
                            kRemedy));
  };
  // TBB would load it with RTLD_DEEPBIND: it would free with the C library what the daemon's own
  // heap allocated. What is loaded already stays as it is.
  (void)::dlopen("libhwloc.so.15", RTLD_NOW | RTLD_LOCAL);
  std::unique_ptr<Library> library(new Library);
  library->handle_ = ::dlopen(name.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library->handle_) return missing(::dlerror());
  if (!library->bind()) return missing(name + " is not version 2");
  library->device_ = library->new_device_(kCpuDevice);
  if (!library->device_) return missing("it has no CPU device");
  if (threads > 0) library->set_device_int_(library->device_, "numThreads", int(threads));
  library->commit_device_(library->device_);
  if (const Status status = library->error("start"); !status)
    return missing(status.error().message);
  return library;
}

Status Denoiser::Library::run(const DenoiseTask& task, const Interrupt& interrupt) {
  const std::unique_ptr<Filter, void (*)(Filter*)> filter(new_filter_(device_, "RT"),
                                                          release_filter_);
  const auto image = [&](const char* name, const float* pixels, size_t channels) {
    set_image_(filter.get(), name, const_cast<float*>(pixels), kFloat3, task.width, task.height, 0,
               channels * sizeof(float), 0);
  };
  image("color", task.beauty, 4);
  image("albedo", task.albedo, 3);
  image("normal", task.normal, 3);
  image("output", task.out, 4);
  set_bool_(filter.get(), "hdr", true);
  const auto goes_on = [](void* user, double) {
    return !static_cast<const Interrupt*>(user)->requested();
  };
  set_monitor_(filter.get(), goes_on, const_cast<Interrupt*>(&interrupt));
  commit_filter_(filter.get());
  execute_filter_(filter.get());
  const Status status = error("denoise");
  HELIO_TRY(interrupt.status());
  return status;
}

Denoiser::Denoiser(std::string library, u32 threads)
    : name_(std::move(library)), threads_(threads) {}
Denoiser::~Denoiser() = default;

Status Denoiser::load() {
  if (name_ == "off")
    return fail(Code::kUnimplemented, "planes",
                "DENOISED is off in this daemon; start heliographd without --denoiser off");
  auto library = Library::open(name_, threads_);
  if (!library) return std::unexpected(std::move(library).error());
  SelfTest test;
  HELIO_TRY((*library)->run(test.task(), {}));
  if (!test.passed())
    return fail(Code::kUnimplemented, "planes",
                fmt::format("DENOISED: {} did not denoise a test picture; {}", name_, kRemedy));
  library_ = *std::move(library);
  return {};
}

Status Denoiser::ready() {
  const std::scoped_lock lock(mutex_);
  if (!ready_) ready_ = load();
  return *ready_;
}

Status Denoiser::denoise(const DenoiseTask& task, const Interrupt& interrupt) {
  HELIO_TRY(ready());
  const std::scoped_lock lock(mutex_);
  HELIO_TRY(library_->run(task, interrupt));
  for (u64 i = 3; i < 4ull * task.width * task.height; i += 4) task.out[i] = task.beauty[i];
  return {};
}

}  // namespace heliograph
