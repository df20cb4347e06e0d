// The daemon's side of heliograph-decode: sends a bundle to the zygote, gets an asset back.
#pragma once

#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <vector>

#include "renderer/assets/load.h"
#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "renderer/scene/transaction.h"

namespace heliograph::server {

struct DecodeFile {
  std::string path;
  BufferPtr bytes;
};
struct DecodeJob {
  std::vector<DecodeFile> files;  // the first is the model
  std::string format;
  std::string up;
  double units = 0;
  std::string hash;  // becomes Asset::hash
  /// Pays for so many bytes of arrays that come back, before they are touched; what it returns
  /// lives as long as any of them.
  std::function<Expected<std::shared_ptr<const void>>(u64 bytes)> pay;
};

/// What came back, every number in it checked by the daemon; arrays lie in the child's sealed
/// memfd.
struct Decoded {
  std::shared_ptr<const Asset> asset;      // null for a picture, or when files are missing
  std::shared_ptr<const ImageData> image;  // a lone picture
  bool image_srgb = false;
  std::vector<std::string> missing;
  std::vector<std::string> warnings;
  vec3 bounds_min{0}, bounds_max{0};
  u64 bytes = 0;  // of the child's memfd
};

struct DecoderOptions {
  std::string program;            // heliograph-decode
  u64 memory_bytes = 2ull << 30;  // of a child's address space
  u32 cpu_seconds = 20;
  double deadline_seconds = 30;
  LoadLimits limits{};
};

/// Owns: the zygote process and the decode pool. Thread: any.
class Decoder {
 public:
  /// Starts the zygote; its libraries load while the caller goes on.
  [[nodiscard]] static Expected<std::unique_ptr<Decoder>> create(const DecoderOptions& options);
  ~Decoder();

  /// Runs one job in a child of its own. `done` is called once, from the decode pool. A child that
  /// dies gives INVALID_ARGUMENT naming the file and how it died; a killed zygote is started again.
  void decode(DecodeJob job, std::function<void(Expected<Decoded>)> done, std::stop_token stop);

  /// What the sandbox has: "seccomp", "namespaces", "landlock", "rlimits"; and what the kernel
  /// refused.
  [[nodiscard]] std::vector<std::string> sandbox() const;
  [[nodiscard]] std::vector<std::string> refused() const;
  [[nodiscard]] std::string versions() const;

 private:
  class Impl;
  explicit Decoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace heliograph::server
