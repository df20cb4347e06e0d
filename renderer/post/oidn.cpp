// The functions of Open Image Denoise that are used, as its oidn.h declares them.
#include "renderer/post/oidn.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <cmath>

#include "kernels/core/hash.h"

namespace heliograph {
namespace {

struct Device;
struct Filter;
enum DeviceType : int { kCpuDevice = 1 };
enum Format : int { kFloat3 = 3 };
enum OidnError : int { kNone = 0 };
using Monitor = bool (*)(void* user, double done);
using Stream = void*;

constexpr u32 kTestSide = 64;
constexpr const char* kRemedy =
    "install it (pip install pyoidn), or name libOpenImageDenoise.so.2 with heliographd --denoiser";

std::unexpected<Error> missing(const std::string& why) {
  return fail(Code::kUnimplemented, "planes",
              fmt::format("DENOISED needs Open Image Denoise 2, which is not there ({}); {}", why,
                          kRemedy));
}

}  // namespace

struct OidnDevice::Library {
  Library() = default;
  Library(const Library&) = delete;
  Library& operator=(const Library&) = delete;
  ~Library() {
    if (filter) release_filter(filter);
    if (device) release_device(device);
    if (handle) ::dlclose(handle);
  }
  [[nodiscard]] bool bind();
  template <class F>
  [[nodiscard]] bool bind(F& function, const char* symbol) {
    function = reinterpret_cast<F>(::dlsym(handle, symbol));
    return function != nullptr;
  }
  /// Report of the library on its latest call, which it then forgets; empty: it did well.
  [[nodiscard]] std::string complaint() {
    const char* text = nullptr;
    if (device_error(device, &text) == kNone) return {};
    return text ? text : "unknown";
  }

  void* handle = nullptr;
  Device* device = nullptr;
  Filter* filter = nullptr;
  Device* (*new_device)(DeviceType) = nullptr;
  Device* (*new_cuda_device)(const int* devices, const Stream* streams, int pairs) = nullptr;
  void (*set_device_int)(Device*, const char*, int) = nullptr;
  int (*device_int)(Device*, const char*) = nullptr;
  void (*commit_device)(Device*) = nullptr;
  void (*release_device)(Device*) = nullptr;
  OidnError (*device_error)(Device*, const char**) = nullptr;
  Filter* (*new_filter)(Device*, const char*) = nullptr;
  void (*set_image)(Filter*, const char*, void*, Format, size_t, size_t, size_t, size_t,
                    size_t) = nullptr;
  void (*set_bool)(Filter*, const char*, bool) = nullptr;
  void (*set_monitor)(Filter*, Monitor, void*) = nullptr;
  void (*commit_filter)(Filter*) = nullptr;
  void (*execute_filter)(Filter*) = nullptr;
  void (*execute_filter_async)(Filter*) = nullptr;
  void (*release_filter)(Filter*) = nullptr;
};

bool OidnDevice::Library::bind() {
  return bind(new_device, "oidnNewDevice") && bind(new_cuda_device, "oidnNewCUDADevice") &&
         bind(set_device_int, "oidnSetDeviceInt") && bind(device_int, "oidnGetDeviceInt") &&
         bind(commit_device, "oidnCommitDevice") && bind(release_device, "oidnReleaseDevice") &&
         bind(device_error, "oidnGetDeviceError") && bind(new_filter, "oidnNewFilter") &&
         bind(set_image, "oidnSetSharedFilterImage") && bind(set_bool, "oidnSetFilterBool") &&
         bind(set_monitor, "oidnSetFilterProgressMonitorFunction") &&
         bind(commit_filter, "oidnCommitFilter") && bind(execute_filter, "oidnExecuteFilter") &&
         bind(execute_filter_async, "oidnExecuteFilterAsync") &&
         bind(release_filter, "oidnReleaseFilter");
}

OidnDevice::OidnDevice() : library_(std::make_unique<Library>()) {}
OidnDevice::~OidnDevice() = default;

Status OidnDevice::open(const std::string& library) {
  // TBB would load it with RTLD_DEEPBIND: it would free with the C library what the daemon's own
  // heap allocated. What is loaded already stays as it is.
  (void)::dlopen("libhwloc.so.15", RTLD_NOW | RTLD_LOCAL);
  library_->handle = ::dlopen(library.c_str(), RTLD_NOW | RTLD_LOCAL);
  if (!library_->handle) return missing(::dlerror());
  if (!library_->bind()) return missing(library + " is not version 2");
  return {};
}

Status OidnDevice::start(const char* place) {
  if (!library_->device)
    return missing(fmt::format("it has no device on {}: {}", place, library_->complaint()));
  library_->commit_device(library_->device);
  if (const std::string why = library_->complaint(); !why.empty())
    return missing(fmt::format("its device on {} does not start: {}", place, why));
  const int version = library_->device_int(library_->device, "version");  // 10000 major + 100 minor
  name_ = fmt::format("Open Image Denoise {}.{}.{} on {}", version / 10000, version / 100 % 100,
                      version % 100, place);
  return {};
}

Expected<std::unique_ptr<OidnDevice>> OidnDevice::on_cpu(const std::string& library, u32 threads) {
  std::unique_ptr<OidnDevice> made(new OidnDevice);
  HELIO_TRY(made->open(library));
  Library& oidn = *made->library_;
  oidn.device = oidn.new_device(kCpuDevice);
  if (oidn.device && threads > 0) oidn.set_device_int(oidn.device, "numThreads", int(threads));
  HELIO_TRY(made->start("the CPU"));
  return made;
}

Expected<std::unique_ptr<OidnDevice>> OidnDevice::on_gpu(const std::string& library, int index,
                                                         void* stream) {
  std::unique_ptr<OidnDevice> made(new OidnDevice);
  HELIO_TRY(made->open(library));
  made->is_on_gpu_ = true;
  made->library_->device = made->library_->new_cuda_device(&index, &stream, 1);
  HELIO_TRY(made->start("the GPU"));
  return made;
}

Status OidnDevice::error(const char* what) {
  const std::string why = library_->complaint();
  if (why.empty()) return {};
  return fail(Code::kInternal, "planes",
              fmt::format("Open Image Denoise failed to {}: {}", what, why));
}

Expected<bool> OidnDevice::set(const DenoiseTask& task) {
  Library& oidn = *library_;
  const bool is_new = !oidn.filter || task.width != width_ || task.height != height_;
  if (is_new) {
    forget();
    oidn.filter = oidn.new_filter(oidn.device, "RT");
    HELIO_TRY(error("make its filter"));
    oidn.set_bool(oidn.filter, "hdr", true);
  }
  const auto image = [&](const char* name, const float* pixels, size_t channels) {
    oidn.set_image(oidn.filter, name, const_cast<float*>(pixels), kFloat3, task.width, task.height,
                   0, channels * sizeof(float), 0);
  };
  image("color", task.beauty, 4);
  image("albedo", task.albedo, 3);
  image("normal", task.normal, 3);
  image("output", task.out, 4);
  oidn.commit_filter(oidn.filter);
  const Status status = error("prepare");
  if (!status) {
    forget();
    return std::unexpected(status.error());
  }
  width_ = task.width;
  height_ = task.height;
  return is_new;
}

Status OidnDevice::run(const Interrupt& interrupt) {
  Library& oidn = *library_;
  if (is_on_gpu_) {
    oidn.execute_filter_async(oidn.filter);
    return error("denoise");
  }
  const auto goes_on = [](void* user, double) {
    return !static_cast<const Interrupt*>(user)->requested();
  };
  oidn.set_monitor(oidn.filter, goes_on, const_cast<Interrupt*>(&interrupt));
  oidn.commit_filter(oidn.filter);
  oidn.execute_filter(oidn.filter);
  const Status status = error("denoise");
  HELIO_TRY(interrupt.status());
  return status;
}

void OidnDevice::forget() {
  if (library_->filter) library_->release_filter(library_->filter);
  library_->filter = nullptr;
}

void OidnDevice::abandon() {
  library_->filter = nullptr;
  library_->device = nullptr;
  library_->handle = nullptr;  // the library stays, as the device is its
}

DenoiserTest::DenoiserTest()
    : beauty_(4ul * kTestSide * kTestSide, 1.0f),
      albedo_(3ul * kTestSide * kTestSide, 0.5f),
      normal_(3ul * kTestSide * kTestSide),
      out_(4ul * kTestSide * kTestSide) {
  for (u32 i = 0; i < beauty_.size(); ++i)
    if (i % 4 < 3) beauty_[i] = 2 * kernels::unit_float(kernels::hash32(i));
  for (u32 i = 2; i < normal_.size(); i += 3) normal_[i] = 1;
}

DenoiseTask DenoiserTest::task() {
  return {kTestSide, kTestSide, beauty_.data(), albedo_.data(), normal_.data(), out_.data()};
}

Status DenoiserTest::passed(const std::string& name) const {
  const auto deviation = [](const std::vector<float>& picture) {
    double sum = 0;
    for (u32 i = 0; i < picture.size(); ++i)
      if (i % 4 < 3) sum += std::pow(double(picture[i]) - 1, 2);
    return std::sqrt(sum);
  };
  if (deviation(out_) < 0.1 * deviation(beauty_)) return {};
  return fail(Code::kUnimplemented, "planes",
              fmt::format("DENOISED: {} did not denoise a test picture; {}", name, kRemedy));
}

}  // namespace heliograph
