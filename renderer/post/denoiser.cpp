#include "renderer/post/denoiser.h"

namespace heliograph {
namespace {

/// Memory of a filter is given back: pictures are few beside what else the host keeps.
Status filter(OidnDevice& device, const DenoiseTask& task, const Interrupt& interrupt) {
  auto made = device.set(task);
  if (!made) return std::unexpected(std::move(made).error());
  const Status status = device.run(interrupt);
  device.forget();
  return status;
}

}  // namespace

Denoiser::Denoiser(std::string library, u32 threads)
    : library_(std::move(library)), threads_(threads) {}

Status Denoiser::load() {
  if (library_ == "off")
    return fail(Code::kUnimplemented, "planes",
                "DENOISED is off in this daemon; start heliographd without --denoiser off");
  auto device = OidnDevice::on_cpu(library_, threads_);
  if (!device) return std::unexpected(std::move(device).error());
  DenoiserTest test;
  HELIO_TRY(filter(**device, test.task(), {}));
  HELIO_TRY(test.passed(library_));
  device_ = *std::move(device);
  return {};
}

Status Denoiser::ready() {
  const std::scoped_lock lock(mutex_);
  if (!ready_) ready_ = load();
  return *ready_;
}

Expected<std::string> Denoiser::name() {
  HELIO_TRY(ready());
  return device_->name();
}

Status Denoiser::denoise(const DenoiseTask& task, const Interrupt& interrupt) {
  HELIO_TRY(ready());
  const std::scoped_lock lock(working_);
  HELIO_TRY(filter(*device_, task, interrupt));
  for (u64 i = 3; i < 4ull * task.width * task.height; i += 4) task.out[i] = task.beauty[i];
  return {};
}

}  // namespace heliograph
