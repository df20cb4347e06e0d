// Memory through which many pieces of the host go to the device together.
#pragma once

#include <array>
#include <mutex>
#include <span>

#include "renderer/backend/cuda/driver.h"

namespace heliograph::cuda {

/// A copy to the device.
struct Upload {
  DevicePointer to;
  std::span<const std::byte> from;
};

/// Owns: pinned memory, from the first time on. Thread: any that entered the context.
class Sender {
 public:
  explicit Sender(const Driver& driver) : driver_(driver) {}
  Sender(const Sender&) = delete;
  Sender& operator=(const Sender&) = delete;

  /// In the stream's order. The bytes may change as soon as it returns. All threads gather them.
  [[nodiscard]] Result send(std::span<const Upload> pieces, StreamHandle stream);
  /// When nothing is on its way.
  void close();
  /// When the context is gone, and its events with it.
  void abandon();

 private:
  struct Stage {
    void* memory = nullptr;
    EventHandle sent = nullptr;
    bool is_on_its_way = false;
  };
  [[nodiscard]] Result open(Stage& stage) const;
  [[nodiscard]] Result send_stage(Stage& stage, std::span<const Upload> parts,
                                  StreamHandle stream) const;

  const Driver& driver_;
  std::mutex mutex_;
  std::array<Stage, 2> stages_;  // by mutex_
};

}  // namespace heliograph::cuda
