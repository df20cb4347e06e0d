// Open Image Denoise 2 by its C interface, loaded at run time. Used by denoiser.cpp, and by
// backends that denoise where their pixels are.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "renderer/frame/interrupt.h"

namespace heliograph {

/// A picture and its guides: row-major, of the same size, where the device reads. beauty and out:
/// RGBA, premultiplied, and may be the same memory; albedo, normal: RGB.
struct DenoiseTask {
  u32 width, height;
  const float* beauty;
  const float* albedo;
  const float* normal;
  float* out;
};

/// A device of Open Image Denoise with its filter "RT" for high dynamic range.
///
/// Owns: the library, its device and a filter. Thread: one at a time. Fails with UNIMPLEMENTED and
/// the remedy when the library or its device is not there, with INTERNAL when it does not work.
/// Source: Afra 2025, "Intel Open Image Denoise", www.openimagedenoise.org.
class OidnDevice {
 public:
  /// library   a path, or a name that the loader finds
  /// threads   0: all
  [[nodiscard]] static Expected<std::unique_ptr<OidnDevice>> on_cpu(const std::string& library,
                                                                    u32 threads);
  /// Pictures lie in the GPU's memory, and work goes to a stream.
  ///
  /// index    of the GPU, as the driver counts
  /// stream   of the GPU's primary context: the library uses no other
  [[nodiscard]] static Expected<std::unique_ptr<OidnDevice>> on_gpu(const std::string& library,
                                                                    int index, void* stream);
  ~OidnDevice();
  OidnDevice(const OidnDevice&) = delete;
  OidnDevice& operator=(const OidnDevice&) = delete;

  /// Says what run() works on. Returns whether a filter was made, which waits and takes memory: one
  /// stays for as long as the size does.
  [[nodiscard]] Expected<bool> set(const DenoiseTask& task);
  /// Filters; alpha is left as it is in `out`. On a GPU it returns when the work is on its way.
  /// Fails with what `interrupt` reports, too, which is asked on the CPU alone.
  [[nodiscard]] Status run(const Interrupt& interrupt);
  /// Gives the filter's memory back.
  void forget();
  /// Gives nothing back, of a device that was lost: the library may end the process over it.
  void abandon();
  /// "Open Image Denoise 2.5.1 on the CPU".
  [[nodiscard]] const std::string& name() const { return name_; }

 private:
  struct Library;
  OidnDevice();
  [[nodiscard]] Status open(const std::string& library);
  [[nodiscard]] Status start(const char* place);
  [[nodiscard]] Status error(const char* what);

  std::string name_;
  bool is_on_gpu_ = false;
  u32 width_ = 0, height_ = 0;  // of the filter
  std::unique_ptr<Library> library_;
};

/// A grey wall of radiance 1 under noise, for a device to show that it denoises.
class DenoiserTest {
 public:
  DenoiserTest();
  /// In the host's memory.
  [[nodiscard]] DenoiseTask task();
  [[nodiscard]] std::span<float> beauty() { return beauty_; }
  [[nodiscard]] std::span<float> albedo() { return albedo_; }
  [[nodiscard]] std::span<float> normal() { return normal_; }
  [[nodiscard]] std::span<float> out() { return out_; }
  /// UNIMPLEMENTED, unless nine tenths of the noise are gone.
  ///
  /// name   of who denoised
  [[nodiscard]] Status passed(const std::string& name) const;

 private:
  std::vector<float> beauty_, albedo_, normal_, out_;
};

}  // namespace heliograph
