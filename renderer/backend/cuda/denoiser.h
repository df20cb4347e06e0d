// The denoiser of pictures in the GPU's memory. Made by the backend.
#pragma once

#include "renderer/backend/cuda/context.h"
#include "renderer/post/oidn.h"

namespace heliograph::cuda {

/// A picture and its guides as DenoiseTask has them, in device memory.
struct DevicePicture {
  u32 width, height;
  DevicePointer beauty, albedo, normal, out;
};

/// Open Image Denoise on its CUDA device.
///
/// Owns: the device, and its filter's memory for pictures of the latest size. Thread: the device's.
class CudaDenoiser {
 public:
  /// Tests it on a noisy picture. UNIMPLEMENTED and why, where the library has no such device, the
  /// driver is too old for it, or the context is not the GPU's primary one.
  [[nodiscard]] static Expected<std::unique_ptr<CudaDenoiser>> create(Context& context,
                                                                      const std::string& library);
  /// With a device that works on the context's memory.
  [[nodiscard]] static Expected<std::unique_ptr<CudaDenoiser>> create(
      Context& context, std::unique_ptr<OidnDevice> device);
  ~CudaDenoiser();
  CudaDenoiser(const CudaDenoiser&) = delete;
  CudaDenoiser& operator=(const CudaDenoiser&) = delete;

  [[nodiscard]] const std::string& name() const { return device_->name(); }
  /// Comes after what is on its way, and before what follows. Alpha is copied.
  [[nodiscard]] Status denoise(const DevicePicture& picture);

 private:
  CudaDenoiser(Context& context, std::unique_ptr<OidnDevice> device)
      : context_(context), device_(std::move(device)) {}
  [[nodiscard]] Status test();
  [[nodiscard]] Status set(const DenoiseTask& task);

  Context& context_;
  std::unique_ptr<OidnDevice> device_;
};

}  // namespace heliograph::cuda
