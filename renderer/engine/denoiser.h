// Open Image Denoise, loaded at run time. Used by post.cpp; made by the engine.
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <string>

#include "renderer/engine/backend.h"

namespace heliograph {

/// A picture and its guides: row-major, of the same size. beauty and out: RGBA, premultiplied;
/// albedo, normal: RGB.
struct DenoiseTask {
  u32 width, height;
  const float* beauty;
  const float* albedo;
  const float* normal;
  float* out;
};

/// The filter "RT" of Open Image Denoise 2 for high dynamic range, on its CPU device.
///
/// Owns: the library and its device. Thread: any; one call is served at a time.
/// Source: Afra 2025, "Intel Open Image Denoise", www.openimagedenoise.org.
class Denoiser {
 public:
  /// library: a path, a name that the loader finds, or "off". Nothing is loaded yet.
  Denoiser(std::string library, u32 threads);
  ~Denoiser();
  Denoiser(const Denoiser&) = delete;
  Denoiser& operator=(const Denoiser&) = delete;

  /// Loads the library and tests it on a noisy picture, the first time.
  /// Fails with UNIMPLEMENTED and the remedy when it is not there or does not denoise.
  [[nodiscard]] Status ready();
  /// Alpha is copied. Fails like ready(), and with what `interrupt` says.
  [[nodiscard]] Status denoise(const DenoiseTask& task, const Interrupt& interrupt);

 private:
  class Library;
  [[nodiscard]] Status load();

  const std::string name_;
  const u32 threads_;
  std::mutex mutex_;
  std::optional<Status> ready_;
  std::unique_ptr<Library> library_;
};

}  // namespace heliograph
