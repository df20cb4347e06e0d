#include "renderer/backend/cuda/denoiser.h"

#include <array>

namespace heliograph::cuda {

Expected<std::unique_ptr<CudaDenoiser>> CudaDenoiser::create(Context& context,
                                                             const std::string& library) {
  if (!context.is_primary())
    return fail(Code::kUnimplemented, "planes",
                "Open Image Denoise works in the GPU's primary context, which something else of "
                "this process has; restart the daemon");
  auto device = OidnDevice::on_gpu(library, context.index(), context.stream());
  if (!device) return std::unexpected(std::move(device).error());
  return create(context, *std::move(device));
}

Expected<std::unique_ptr<CudaDenoiser>> CudaDenoiser::create(Context& context,
                                                             std::unique_ptr<OidnDevice> device) {
  std::unique_ptr<CudaDenoiser> made(new CudaDenoiser(context, std::move(device)));
  HELIO_TRY(made->test());
  return made;
}

CudaDenoiser::~CudaDenoiser() {
  if (context_.is_lost()) device_->abandon();
}

Status CudaDenoiser::test() {
  DenoiserTest test;
  const DenoiseTask task = test.task();
  std::vector<DeviceMemory> copies;
  for (const std::span<float> pixels : {test.beauty(), test.albedo(), test.normal(), test.out()}) {
    auto memory = context_.allocate(pixels.size_bytes());
    if (!memory) return std::unexpected(std::move(memory).error());
    HELIO_TRY(context_.upload(memory->at(), std::as_bytes(pixels)));
    copies.push_back(*std::move(memory));
  }
  HELIO_TRY(denoise(
      {task.width, task.height, copies[0].at(), copies[1].at(), copies[2].at(), copies[3].at()}));
  HELIO_TRY(context_.download(std::as_writable_bytes(test.out()), copies[3].at()));
  device_->forget();
  return test.passed(name());
}

/// Weights of a new filter come by copies that no stream of ours waits for.
Status CudaDenoiser::set(const DenoiseTask& task) {
  auto is_new = device_->set(task);
  if (!is_new) {  // most likely there was no memory for it
    context_.make_room();
    is_new = device_->set(task);
  }
  if (!is_new) return std::unexpected(std::move(is_new).error());
  return *is_new ? context_.wait_for_all() : Status{};
}

/// In place, as the library would make a copy of the output anyway, and alpha is there then.
Status CudaDenoiser::denoise(const DevicePicture& picture) {
  constexpr u64 kPixelBytes = 4 * sizeof(float);
  HELIO_TRY(context_.copy(picture.out, picture.beauty,
                          u64(picture.width) * picture.height * kPixelBytes));
  const auto at = [](DevicePointer pointer) { return reinterpret_cast<float*>(pointer); };
  HELIO_TRY(set({picture.width, picture.height, at(picture.out), at(picture.albedo),
                 at(picture.normal), at(picture.out)}));
  const Status status = device_->run({});
  if (!status) HELIO_TRY(context_.wait());  // where the device is lost, that is the reason
  return status;
}

}  // namespace heliograph::cuda
