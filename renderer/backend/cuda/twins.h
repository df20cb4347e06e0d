// Arrays that are there twice: in the host's memory and in the device's.
#pragma once

#include <map>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "renderer/backend/cuda/export_device.h"

namespace heliograph::cuda {

class Twins;

/// Room for an array on both sides.
struct Twin {
  std::byte* host = nullptr;     // page-locked
  DevicePointer host_there = 0;  // the same, as the device sees it
  DevicePointer device = 0;
  u64 bytes = 0;
  EventHandle read = nullptr;  // what renders has read the device's side
};

/// Keeps such room for later. The host's side outlives the device, whose side goes with it.
/// Thread: any.
class Twins : public std::enable_shared_from_this<Twins> {
 public:
  /// owner   keeps the device alive
  /// most    bytes of each side, whether they are in use or not
  Twins(std::shared_ptr<const void> owner, const ExportDevice& device, u64 most)
      : owner_(std::move(owner)), device_(device), most_(most) {}
  ~Twins();
  Twins(const Twins&) = delete;
  Twins& operator=(const Twins&) = delete;

  /// Room for so many bytes, for as long as it is held; null: there is no more.
  ///
  /// writer   a stream that writes there, after what renders has read what was there before
  [[nodiscard]] std::shared_ptr<const Twin> take(u64 bytes, StreamHandle writer);
  /// True if all of some bytes are in a twin.
  [[nodiscard]] bool has(std::span<const std::byte> host) const { return find(host).has_value(); }
  /// Copies the device's side of bytes that are, in the order of what renders. UNAVAILABLE, as the
  /// next call of the context reports, too. Thread: the device's.
  [[nodiscard]] Status copy(DevicePointer to, std::span<const std::byte> host) const;
  /// Frees what nobody uses; whether there was any.
  bool reclaim();

 private:
  [[nodiscard]] std::optional<Twin> find(std::span<const std::byte> host) const;
  [[nodiscard]] std::optional<Twin> find_unused(u64 bytes);
  [[nodiscard]] std::optional<Twin> open(u64 bytes);
  [[nodiscard]] bool allocate(Twin& twin);
  [[nodiscard]] bool comes_after(const Twin& twin, StreamHandle writer) const;
  void close(const Twin& twin);
  void give_back(const Twin& twin);

  const std::shared_ptr<const void> owner_;
  const ExportDevice device_;
  const u64 most_;
  mutable std::mutex mutex_;
  u64 bytes_ = 0;
  std::vector<Twin> unused_;                 // the last is the latest
  std::map<const std::byte*, Twin> in_use_;  // by where the host's side begins
};

}  // namespace heliograph::cuda
