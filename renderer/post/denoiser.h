// The denoiser of pictures in the host's memory. Used by post.cpp; made by the engine.
#pragma once

#include <mutex>
#include <optional>

#include "renderer/post/oidn.h"

namespace heliograph {

/// Open Image Denoise on its CPU device.
///
/// Owns: the library and its device. Thread: any; one picture is denoised at a time.
class Denoiser {
 public:
  /// library: a path, a name that the loader finds, or "off". Nothing is loaded yet.
  Denoiser(std::string library, u32 threads);

  /// Loads the library and tests it on a noisy picture, the first time.
  /// Fails with UNIMPLEMENTED and the remedy when it is not there or does not denoise.
  [[nodiscard]] Status ready();
  /// Alpha is copied. Fails like ready(), and with what `interrupt` reports.
  [[nodiscard]] Status denoise(const DenoiseTask& task, const Interrupt& interrupt);
  /// OidnDevice::name(); fails like ready().
  [[nodiscard]] Expected<std::string> name();

 private:
  [[nodiscard]] Status load();

  const std::string library_;
  const u32 threads_;
  std::mutex mutex_;    // of ready_ and device_
  std::mutex working_;  // held while device_ filters
  std::optional<Status> ready_;
  std::unique_ptr<OidnDevice> device_;
};

}  // namespace heliograph
