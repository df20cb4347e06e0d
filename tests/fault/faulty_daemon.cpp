// heliographd with a device that fails when it is told to, for tests/fault/device_lost.py, and
// whose memory is memfds that stand for a GPU's, for tests/integration/test_device_frames.py; it
// denoises by itself, unless HELIOGRAPH_TEST_DENOISER has the reason why not. With `--backend cuda`
// it is a GPU, for tests/gpu/lost.py. It differs from the real one in make_backend() alone.
//
// SIGUSR1: the device is lost, once the backend is next called; a GPU by a program that reads where
// there is no memory. It comes back, unless HELIOGRAPH_TEST_LOSS is set: then not in this process,
// as most GPUs do. SIGUSR2: it hangs there, until the next SIGUSR2. While there is a file of the
// name in HELIOGRAPH_TEST_FREEZE the event loop stands still; of the name in HELIOGRAPH_TEST_DISK
// the disk does, for who reads a file or waits for what was written.
#include <signal.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <thread>

#include "renderer/backend/cuda/cuda_backend.h"
#include "renderer/backend/cuda/driver.h"
#include "renderer/backend/cuda/launch.h"
#include "renderer/backend/cuda/programs.h"
#include "renderer/backend/embree/embree_backend.h"
#include "renderer/device/backend.h"
#include "renderer/frame/film_planes.h"
#include "renderer/frame/lent_memory.h"
#include "renderer/host/film.h"
#include "renderer/post/denoiser.h"
#include "server/app/lifecycle.h"
#include "server/app/probe.h"

namespace heliograph {
namespace {

std::atomic<bool> lose_device = false;
std::atomic<bool> hang = false;
std::atomic<bool> was_lost = false;
std::atomic<bool> is_taken = false;  // by a lost backend, until that is told to give it up

/// As tests/python/stub_cuda.c has it.
constexpr DeviceUuid kUuid{'h', 'e', 'l', 'i', 'o', 'g', 'r', 'a', 'p', 'h', 0, 1, 2, 3, 4, 5};

/// As on a GPU, both sides may write.
class DeviceMemory final : public LentMemory {
 public:
  explicit DeviceMemory(u64 bytes) : fd_(::memfd_create("device", MFD_CLOEXEC)), size_(bytes) {
    if (::ftruncate(fd_, off_t(bytes)) != 0) std::abort();
    start_ = ::mmap(nullptr, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, fd_, 0);
  }
  ~DeviceMemory() override {
    ::munmap(start_, size_);
    ::close(fd_);
  }
  [[nodiscard]] int fd() const override { return fd_; }
  [[nodiscard]] std::span<std::byte> bytes() const override {
    return {static_cast<std::byte*>(start_), size_};
  }
  [[nodiscard]] const DeviceUuid* device() const override { return &kUuid; }
  [[nodiscard]] Status read(u64 offset, u64 size, const TakePiece& take) const override {
    take(0, bytes().subspan(offset, size));
    return {};
  }

 private:
  const int fd_;
  const u64 size_;
  void* start_;
};

class DeviceSource final : public SharedMemorySource {
 public:
  [[nodiscard]] std::shared_ptr<SharedMemory> make(u64 bytes) override {
    return std::make_shared<DeviceMemory>(bytes);
  }
  void know(const std::weak_ptr<SharedMemoryKeeper>&) override {}  // there is always more
  [[nodiscard]] u64 step() const override { return 2 << 20; }
  [[nodiscard]] const DeviceUuid* device() const override { return &kUuid; }
};

Expected<std::vector<PlaneData>> on_device(const RenderJob& job, std::vector<PlaneData> planes,
                                           u64 pixels) {
  std::erase_if(planes, [&](const PlaneData& made) {
    return std::ranges::count(job.planes, made.plane) == 0;
  });
  for (PlaneData& plane : planes) {
    auto moved = new_device_plane(job, plane.plane, pixels);
    if (!moved) return std::unexpected(std::move(moved).error());
    std::ranges::copy_n(plane.pixels.data(), i64(plane.pixels.size()), moved->pixels.data());
    plane = *std::move(moved);
  }
  return planes;
}

/// One whose memory is the host's is lost when it is told to.
class FaultyBackend : public Backend {
 public:
  FaultyBackend(std::unique_ptr<Backend> inner, const BackendOptions& options)
      : inner_(std::move(inner)),
        denoiser_(options.denoiser, options.threads),
        info_{.name = inner_->info().name,
              .cpu_features = inner_->info().cpu_features,
              .shared_memory = std::make_shared<DeviceSource>()} {}

  [[nodiscard]] const DeviceInfo& info() const override { return info_; }
  [[nodiscard]] DeviceUse use() const override {
    DeviceUse use = inner_->use();
    use.is_lost = is_lost_;
    return use;
  }
  void run(const std::function<void()>& f) override { inner_->run(f); }
  [[nodiscard]] Preparation preparation(const SceneAt& scene) const override {
    return inner_->preparation(scene);
  }
  [[nodiscard]] Expected<DeviceScenes> prepare(std::span<const SceneAt> scenes,
                                               const Interrupt& interrupt) override {
    return inner_->prepare(scenes, interrupt);
  }
  [[nodiscard]] Expected<std::unique_ptr<Film>> begin(std::span<const Shot> shots) override {
    return inner_->begin(shots);
  }
  [[nodiscard]] Expected<bool> render(Film& film, const WorkRange& range, const Slice& slice,
                                      const Interrupt& interrupt) override {
    HELIO_TRY(fault());
    return inner_->render(film, range, slice, interrupt);
  }
  [[nodiscard]] Expected<bool> probe(Film& film, const Slice& slice,
                                     const Interrupt& interrupt) override {
    HELIO_TRY(fault());
    return inner_->probe(film, slice, interrupt);
  }
  [[nodiscard]] Expected<std::vector<std::vector<Column>>> labels(
      Film& film, const Interrupt& interrupt) override {
    return inner_->labels(film, interrupt);
  }
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override {
    const auto& own = static_cast<const host::HostFilm&>(film);
    auto planes = inner_->resolve(film);
    if (planes && denoiser() && std::ranges::count(own.job().planes, Plane::DENOISED) > 0)
      HELIO_TRY(denoise(own, *planes));
    if (!planes || !own.job().on_device) return planes;
    return on_device(own.job(), *std::move(planes), u64(own.view().width) * own.view().height);
  }
  [[nodiscard]] Expected<std::string> denoiser() override {
    const char* reason = std::getenv("HELIOGRAPH_TEST_DENOISER");
    if (reason) return fail(Code::kUnimplemented, "planes", reason);
    return "a test's device";
  }
  [[nodiscard]] Expected<QueryResult> query(const QueryJob& job,
                                            const Interrupt& interrupt) override {
    HELIO_TRY(fault());
    return inner_->query(job, interrupt);
  }
  void abandon() override { is_taken = false; }

 protected:
  [[nodiscard]] Backend& inner() const { return *inner_; }
  virtual void lose() { is_lost_ = is_taken = was_lost = true; }

 private:
  Status denoise(const host::HostFilm& film, std::vector<PlaneData>& planes) {
    const auto floats = [&](Plane plane) {
      return reinterpret_cast<float*>(
          std::ranges::find(planes, plane, &PlaneData::plane)->pixels.data());
    };
    const auto [width, height] = std::pair(film.view().width, film.view().height);
    planes.push_back(new_plane(film.job(), Plane::DENOISED, u64(width) * height));
    const DenoiseTask task{.width = width,
                           .height = height,
                           .beauty = floats(Plane::BEAUTY),
                           .albedo = floats(Plane::ALBEDO_MEAN),
                           .normal = floats(Plane::NORMAL_MEAN),
                           .out = floats(Plane::DENOISED)};
    HELIO_TRY(denoiser_.denoise(task, {}));
    std::erase_if(planes, [&](const PlaneData& made) {
      return made.plane != Plane::DENOISED && !is_read_beside(film.job(), made.plane);
    });
    return {};
  }
  Status fault() {
    while (hang) std::this_thread::sleep_for(std::chrono::milliseconds(10));
    if (lose_device.exchange(false)) lose();
    if (is_lost_) return fail(Code::kInternal, "", "injected: the device is lost");
    return {};
  }

  std::unique_ptr<Backend> inner_;
  Denoiser denoiser_;
  const DeviceInfo info_;
  std::atomic<bool> is_lost_ = false;
};

/// A GPU: what becomes of it is the driver's business.
class FaultyGpu final : public FaultyBackend {
 public:
  using FaultyBackend::FaultyBackend;
  [[nodiscard]] Expected<std::vector<PlaneData>> resolve(Film& film) override {
    return inner().resolve(film);
  }
  [[nodiscard]] Expected<std::string> denoiser() override { return inner().denoiser(); }
  [[nodiscard]] const DeviceInfo& info() const override { return inner().info(); }
  [[nodiscard]] DeviceUse use() const override { return inner().use(); }
  void abandon() override { inner().abandon(); }

 protected:
  /// Reads a film's size at address 0, in the calling thread's context.
  void lose() override {
    const auto driver = cuda::load_driver();
    if (!driver) std::abort();
    cuda::ResolveLaunch launch{};
    launch.pictures = 1;
    void* arguments[] = {&launch};
    for (const std::byte* program : cuda::programs()) {
      cuda::ModuleHandle module = nullptr;
      cuda::FunctionHandle resolve = nullptr;
      if (driver->load_module(&module, program) == 0 &&
          driver->function_in(&resolve, module, "film_resolve") == 0)
        (void)driver->launch(resolve, 1, 1, 1, 32, 1, 1, 0, nullptr, arguments, nullptr);
    }
  }
};

}  // namespace

Expected<u32> device_count(std::string_view name) {
  return name == "cuda" ? cuda::gpu_count() : Expected<u32>(1);
}

Expected<std::unique_ptr<Backend>> make_backend(std::string_view name,
                                                const BackendOptions& options) {
  const bool is_gpu = name == "cuda";
  if (is_taken) return fail(Code::kUnavailable, "backend", "injected: the device is still taken");
  if (was_lost && std::getenv("HELIOGRAPH_TEST_LOSS"))
    return fail(Code::kFailedPrecondition, "backend", "injected: CUDA_ERROR_ILLEGAL_ADDRESS");
  auto inner = is_gpu ? cuda::make_cuda_backend(options) : embree::make_embree_backend(options);
  if (!inner) return inner;
  if (is_gpu) return std::make_unique<FaultyGpu>(*std::move(inner), options);
  return std::make_unique<FaultyBackend>(*std::move(inner), options);
}

std::vector<std::string_view> backend_names() { return {"embree", "cuda"}; }

}  // namespace heliograph

namespace {

void wait_while_there(const char* file) {
  while (file && ::access(file, F_OK) == 0)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
}

void wait_for_disk() {
  static const char* const file = std::getenv("HELIOGRAPH_TEST_DISK");
  wait_while_there(file);
}

bool is_on_disk(int fd) {
  struct stat info{};
  return ::fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
}

}  // namespace

/// The C library's, which the event loop waits in: of the main thread it does not return while
/// there is such a file.
extern "C" int epoll_wait(int epoll, epoll_event* events, int most, int milliseconds) {
  const long count =
      ::syscall(SYS_epoll_pwait, epoll, events, most, milliseconds, nullptr, sizeof(long));
  static const char* const freeze = std::getenv("HELIOGRAPH_TEST_FREEZE");
  if (::syscall(SYS_gettid) == ::getpid()) wait_while_there(freeze);
  return int(count);
}

extern "C" ssize_t read(int fd, void* bytes, size_t size) {
  if (is_on_disk(fd)) wait_for_disk();
  return ::syscall(SYS_read, fd, bytes, size);
}

extern "C" int fsync(int fd) {
  wait_for_disk();
  return int(::syscall(SYS_fsync, fd));
}

extern "C" int fdatasync(int fd) {
  wait_for_disk();
  return int(::syscall(SYS_fdatasync, fd));
}

int main(int argc, char** argv) {
  using namespace heliograph::server;
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGUSR1, [](int) { heliograph::lose_device = true; });
  std::signal(SIGUSR2, [](int) { heliograph::hang = !heliograph::hang; });
  auto config = parse_config(argc, argv);
  if (!config) return config.error();
  if (!config->probe.empty()) return probe(*config);
  std::_Exit(run(std::move(*config)));
}
