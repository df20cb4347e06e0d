// What is left of the state directory's disk, and who may have it. Used by the journal and its
// files.
#pragma once

#include <atomic>
#include <chrono>
#include <mutex>
#include <string>

#include "renderer/base/error.h"

namespace heliograph::server {

/// Keeps two kinds of room. A reserve, a file that is given up when the disk is full, so that
/// scenes can still be deleted; and spare room, which tenants with much on the disk leave to those
/// with little: one that fills the disk stops itself. Both are small parts of a small disk. Thread:
/// any.
class DiskRoom {
 public:
  struct Options {
    std::string folder;
    u64 reserve = 16ull << 20;  // bytes; a sixteenth of the disk at most
    u64 spare = 1ull << 30;     // an eighth at most
  };
  /// The folder is there.
  explicit DiskRoom(Options options);

  /// Whether an owner who uses `used` bytes may write these; RESOURCE_EXHAUSTED with a retry time.
  [[nodiscard]] Status admit(u64 bytes, u64 used);
  /// The same of a part of a snapshot, which takes the place of another one.
  [[nodiscard]] Status admit_snapshot(u64 bytes);
  /// The next snapshot has about so many bytes: room that edits leave to it.
  void expect_snapshot(u64 bytes) { snapshot_ = bytes; }
  /// Takes the reserve when there is that much, and a quarter more: RESOURCE_EXHAUSTED otherwise.
  [[nodiscard]] Status take_reserve();
  void release_reserve();
  [[nodiscard]] u64 reserve() const { return reserve_; }
  /// Of the disk.
  [[nodiscard]] u64 size() const { return size_; }

 private:
  /// `kept`: bytes that are not for this.
  [[nodiscard]] Status admit_beside(u64 needed, u64 kept);
  [[nodiscard]] u64 left();  // under mutex_

  const Options options_;
  u64 size_ = 0;
  u64 reserve_ = 0;
  u64 spare_ = 0;
  std::atomic<u64> snapshot_ = 0;
  std::mutex mutex_;
  u64 free_ = 0;     // when it was looked at
  u64 written_ = 0;  // since
  std::chrono::steady_clock::time_point looked_{};
};

}  // namespace heliograph::server
