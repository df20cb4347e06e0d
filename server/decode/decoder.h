// The daemon's side of heliograph-decode: sends a bundle to a child, receives an asset.
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
  BufferPtr bytes;  // null: a companion known to be missing
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
  u64 tenant = 0;    // for fair queueing; 0: the daemon itself
  /// Charges bytes of arrays before the child writes them. A refusal ends the decode; the returned
  /// object lives as long as any of the arrays.
  std::function<Expected<std::shared_ptr<const void>>(u64 bytes)> pay =
      [](u64) -> Expected<std::shared_ptr<const void>> { return nullptr; };
};

/// A decoded result, every number of it checked by the daemon; arrays lie in the child's sealed
/// memfd.
struct Decoded {
  std::shared_ptr<const Asset> asset;      // null for a lone picture, or when files are missing
  std::shared_ptr<const ImageData> image;  // a lone picture
  bool image_srgb = false;
  std::vector<std::string> missing;
  std::vector<std::string> warnings;
  vec3 bounds_min{0}, bounds_max{0};
  u64 bytes = 0;  // of the child's memfd
};

/// Layers of the sandbox that an operator may disable.
inline constexpr std::array kOptionalLayers = {"landlock", "namespaces"};

struct DecoderOptions {
  std::string program;            // heliograph-decode
  u64 memory_bytes = 2ull << 30;  // of a child's address space
  u32 cpu_seconds = 20;
  double deadline_seconds = 30;
  LoadLimits limits{};
  std::vector<std::string> without;  // of kOptionalLayers: layers to do without
  u64 processes = 4;                 // concurrent decodes
  u64 tenant_processes = 3;          // concurrent decodes per tenant
  u64 tenant_waiting = 256;          // waiting decodes per tenant
};

/// Confinement of decodes, as the latest child reported it.
struct DecoderState {
  std::vector<std::string> sandbox;  // layers in force
  // Layers that the kernel refused and the operator disabled: "landlock: reason".
  std::vector<std::string> refused;
  std::string versions;  // of libraries
  Status works = {};     // else the reason why no file can be decoded, with the remedy
};

/// Owns: its threads, and a spare child that is ready for the next job. Thread: any.
class Decoder {
 public:
  /// Starts the decoder. UNAVAILABLE when the program cannot be run.
  [[nodiscard]] static Expected<std::unique_ptr<Decoder>> create(const DecoderOptions& options);
  ~Decoder();

  /// Runs one job in a child of its own. `done` is called once, from a thread of the decoder or, at
  /// once, from this one. A child that dies gives INVALID_ARGUMENT naming the file and how it died.
  /// FAILED_PRECONDITION: the kernel refuses a layer of the sandbox.
  void decode(DecodeJob job, std::function<void(Expected<Decoded>)> done, std::stop_token stop);

  /// Calls `work`, which reads files that may be slow, from a thread of the decoder when it is the
  /// tenant's turn. Calls `refused` instead when too many wait or the decoder ends.
  void read(u64 tenant, std::function<void()> work, std::function<void(Status)> refused);

  /// Decodes a triangle, to test whether files can be decoded at all.
  void try_out(std::function<void(Status)> done);

  /// Returns the state; waits up to 5 s for the first child.
  [[nodiscard]] DecoderState state() const;

 private:
  class Impl;
  explicit Decoder(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace heliograph::server
