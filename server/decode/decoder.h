// The daemon's side of heliograph-decode: sends a bundle to a child, gets an asset back.
#pragma once

#include <array>
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
  BufferPtr bytes;  // null: a companion that nobody has
};
struct DecodeJob {
  std::vector<DecodeFile> files;  // the first is the model
  std::string format;
  std::string up;
  double units = 0;
  std::string layer;
  std::string variant;
  bool surface = false;
  std::string hash;  // becomes Asset::hash
  u64 tenant = 0;    // whose turn it takes; 0: the daemon's own
  /// Pays for so many bytes of arrays, before the child writes them: a refusal ends the decode,
  /// what it returns lives as long as any of them.
  std::function<Expected<std::shared_ptr<const void>>(u64 bytes)> pay =
      [](u64) -> Expected<std::shared_ptr<const void>> { return nullptr; };
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

/// Layers of the sandbox that an operator may do without.
inline constexpr std::array kOptionalLayers = {"landlock", "namespaces"};

struct DecoderOptions {
  std::string program;            // heliograph-decode
  u64 memory_bytes = 2ull << 30;  // of a child's address space
  u32 cpu_seconds = 20;
  double deadline_seconds = 30;
  LoadLimits limits{};
  std::vector<std::string> without;  // of kOptionalLayers: where the kernel refuses them
  u64 processes = 4;                 // at work at a time
  u64 tenant_processes = 3;          // those of one tenant
  u64 tenant_waiting = 256;          // decodes of one tenant that wait
};

/// What confines decodes, as the latest child found it.
struct DecoderState {
  std::vector<std::string> sandbox;  // layers in force
  std::vector<std::string> refused;  // by the kernel, and done without: "landlock: why"
  std::string versions;              // of libraries
  Status works = {};                 // why no file can be decoded, and what to do
};

/// Owns: its threads, and a child that is ready for the next job. Thread: any.
class Decoder {
 public:
  /// Fails with UNAVAILABLE when the program cannot be run.
  [[nodiscard]] static Expected<std::unique_ptr<Decoder>> create(const DecoderOptions& options);
  ~Decoder();

  /// Runs one job in a child of its own. `done` is called once, from a thread of the decoder or, at
  /// once, from this one. A child that dies gives INVALID_ARGUMENT naming the file and how it died.
  /// FAILED_PRECONDITION: the kernel refuses a layer of the sandbox.
  void decode(DecodeJob job, std::function<void(Expected<Decoded>)> done, std::stop_token stop);

  /// Calls `work`, which reads files that may be slow, when it is the tenant's turn. `refused` is
  /// called in its place when too many wait or the decoder ends.
  void read(u64 tenant, std::function<void()> work, std::function<void(Status)> refused);

  /// Decodes a triangle: whether files can be decoded at all.
  void try_out(std::function<void(Status)> done);

  /// Waits for the first child at most 5 s.
  [[nodiscard]] DecoderState state() const;

 private:
  class Impl;
  explicit Decoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace heliograph::server
