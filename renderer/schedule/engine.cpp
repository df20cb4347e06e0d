// Checks of jobs, and an engine's report of its devices.
#include "renderer/schedule/engine.h"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

#include "renderer/frame/check.h"
#include "renderer/schedule/engine_impl.h"

namespace heliograph {
namespace {

u64 sum_of(const std::vector<std::shared_ptr<Backend>>& backends, u64 DeviceUse::* of) {
  const auto add = [of](u64 sum, const auto& backend) { return sum + backend->use().*of; };
  return std::accumulate(backends.begin(), backends.end(), u64(0), add);
}

}  // namespace

Expected<std::unique_ptr<Engine>> Engine::create(const EngineOptions& options) {
  const auto there = device_count(options.backend);
  if (!there) return std::unexpected(there.error());
  std::vector<std::unique_ptr<Backend>> backends;
  const u32 count = options.devices > 0 ? options.devices : *there;
  for (u32 i = 0; i < count; ++i) {
    BackendOptions own = options.device;
    own.index = i;
    own.cache_bytes /= count;
    auto backend = make_backend(options.backend, own);
    if (!backend) return std::unexpected(std::move(backend).error());
    backends.push_back(*std::move(backend));
  }
  return std::unique_ptr<Engine>(new Engine(std::make_unique<Impl>(std::move(backends), options)));
}

Engine::Engine(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
Engine::~Engine() = default;

Status Engine::submit(std::shared_ptr<const RenderJob> job, std::shared_ptr<JobSink> sink,
                      std::stop_token stop) {
  HELIO_TRY(check_job(*job, impl_->options().limits));
  if (std::ranges::count(job->planes, Plane::DENOISED) > 0) HELIO_TRY(impl_->denoiser().ready());
  if (job->on_device && !shared_memory())
    return fail(Code::kFailedPrecondition, "memory",
                fmt::format("this daemon renders with the backend {}, which has no memory of a GPU "
                            "to share; start it with --backend cuda, or ask for planes on the host",
                            backend_name()));
  impl_->submit(std::make_unique<RenderWork>(std::move(job), std::move(sink), std::move(stop)));
  return {};
}

void Engine::submit(std::shared_ptr<const QueryJob> query,
                    std::function<void(Expected<QueryResult>)> done, std::stop_token stop) {
  impl_->submit(std::make_unique<QueryWork>(std::move(query), std::move(done), std::move(stop)));
}

std::string_view Engine::backend_name() const { return impl_->backends().front()->info().name; }
std::string Engine::cpu_features() const { return impl_->backends().front()->info().cpu_features; }
u32 Engine::devices() const { return u32(impl_->backends().size()); }
u64 Engine::derived_bytes() const { return sum_of(impl_->backends(), &DeviceUse::derived_bytes); }
u64 Engine::scenes_made_again() const {
  return sum_of(impl_->backends(), &DeviceUse::scenes_made_again);
}
u64 Engine::uploaded_bytes() const { return sum_of(impl_->backends(), &DeviceUse::uploaded_bytes); }
MemoryUse Engine::memory() const {
  MemoryUse all;
  for (const auto& backend : impl_->backends()) {
    const MemoryUse one = backend->use().memory;
    all.used += one.used;
    all.budget += one.budget;
  }
  return all;
}
Load Engine::load() const { return impl_->load(); }
std::shared_ptr<SharedMemorySource> Engine::shared_memory() const {
  return impl_->backends().front()->info().shared_memory;
}

}  // namespace heliograph
