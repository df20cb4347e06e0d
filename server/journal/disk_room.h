// Free space of the state directory's disk, and its allotment. Used by the journal and its files.
#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Keeps two kinds of room: a reserve, a file that is released when the disk is full, so that
/// scenes can still be deleted; and spare room, which tenants with much on the disk leave to those
/// with little, so that one that fills the disk stops only itself. On a small disk both are small
/// parts of it. Thread: any.
class DiskRoom {
 public:
  struct Options {
    std::string folder;
    u64 reserve = 16ull << 20;  // bytes; at most 1/16 of the disk
    u64 spare = 1ull << 30;     // bytes; at most 1/8 of the disk
  };
  /// The folder must exist.
  explicit DiskRoom(Options options);

  /// Checks that an owner with `used` bytes on the disk may write these. RESOURCE_EXHAUSTED with a
  /// retry time.
  [[nodiscard]] Status admit(u64 bytes, u64 used);
  /// The same for a part of a snapshot, which replaces an earlier one.
  [[nodiscard]] Status admit_snapshot(u64 bytes);
  /// Sets the expected size of the next snapshot: edits leave room for it.
  void expect_snapshot(u64 bytes) { snapshot_ = bytes; }
  /// Allocates the reserve when 1.25 times its size is free. RESOURCE_EXHAUSTED otherwise.
  [[nodiscard]] Status take_reserve();
  void release_reserve();
  [[nodiscard]] u64 reserve() const { return reserve_; }
  /// Size of the disk, bytes.
  [[nodiscard]] u64 size() const { return size_; }

 private:
  /// kept   bytes reserved for other uses
  [[nodiscard]] Status admit_beside(u64 needed, u64 kept);
  [[nodiscard]] u64 left();  // under mutex_

  const Options options_;
  u64 size_ = 0;
  u64 reserve_ = 0;
  u64 spare_ = 0;
  std::atomic<u64> snapshot_ = 0;
  std::mutex mutex_;
  u64 free_ = 0;     // free bytes at the last measurement
  u64 written_ = 0;  // written since then
  std::chrono::steady_clock::time_point looked_{};
};

}  // namespace heliograph::server
