// Frames in memory that a local client maps: sealed memfds, or a device's memory, handed over on
// the second socket and pooled for each session.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <unordered_map>

#include "heliograph/v1/types.pb.h"
#include "renderer/base/array.h"
#include "renderer/engine/lent_memory.h"
#include "renderer/engine/pixels.h"
#include "renderer/engine/shared_memory.h"
#include "server/os/unique_fd.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Pages of a memfd that this process writes and its peer only reads.
class SealedMemory final : public SharedMemory {
 public:
  /// Null when the kernel has no more.
  [[nodiscard]] static std::shared_ptr<SealedMemory> create(u64 bytes);
  ~SealedMemory() override;

  /// Sealed: its size is final, and nobody else can map it for writing.
  [[nodiscard]] int fd() const override { return fd_.get(); }
  [[nodiscard]] std::span<std::byte> bytes() const override { return bytes_; }
  [[nodiscard]] const DeviceUuid* device() const override { return nullptr; }

 private:
  SealedMemory(UniqueFd fd, std::span<std::byte> bytes) : fd_(std::move(fd)), bytes_(bytes) {}

  const UniqueFd fd_;
  const std::span<std::byte> bytes_;
};

class SealedMemorySource final : public SharedMemorySource {
 public:
  [[nodiscard]] std::shared_ptr<SharedMemory> make(u64 bytes) override {
    return SealedMemory::create(bytes);
  }
  void know(const std::weak_ptr<SharedMemoryKeeper>&) override {}  // the kernel has its own ways
  [[nodiscard]] u64 step() const override { return 4096; }
  [[nodiscard]] const DeviceUuid* device() const override { return nullptr; }
};

/// One use of a buffer, until the client returns it.
struct Lease {
  u64 buffer = 0;
  u64 generation = 0;
  std::shared_ptr<SharedMemory> memory;
};

/// The buffers of one session. One that was sent is never rewritten: it comes back when the client
/// says so, and is abandoned (the client's mapping lives on) when nobody can tell whether it still
/// looks. Thread: any.
class SharedFrames final : public SharedMemoryKeeper,
                           public std::enable_shared_from_this<SharedFrames> {
 public:
  using Source = std::shared_ptr<SharedMemorySource>;
  /// Tells the client about a buffer before its first use; null: about one to be forgotten. False
  /// when the socket takes nothing.
  using Tell = std::function<bool(u64 buffer, const SharedMemory* memory)>;

  /// What its buffers may take.
  struct Room {
    u64 limit = 0;  // bytes of all of them
    std::shared_ptr<Budget> bytes;
    std::shared_ptr<Budget> descriptors;
  };
  SharedFrames(Room room, Tell tell) : room_(std::move(room)), tell_(std::move(tell)) {}

  /// A number that no other call of the session has.
  [[nodiscard]] u64 new_call();
  /// Room for a plane that `call` sends; none where limit, budget, source or socket have none: it
  /// then travels as bytes, if the host can read it.
  ///
  /// source   of a device's memory; absent: the host's
  [[nodiscard]] std::optional<Lease> lease(u64 bytes, u64 call, Source source = nullptr);
  /// What the client has written into a buffer that it holds. NOT_FOUND when it does not hold that
  /// use of it, INVALID_ARGUMENT.
  [[nodiscard]] Status read(const v1::BufferRef& ref, const TakePiece& take) const;
  /// As LentMemory::take(). Floats are counted as copy() counts them.
  [[nodiscard]] Expected<BufferPtr> take(const v1::BufferRef& ref, Numbers kind) const;
  /// A copy of it. RESOURCE_EXHAUSTED, too.
  [[nodiscard]] Expected<BufferPtr> copy(const v1::BufferRef& ref) const;
  /// A use of a buffer is over; what names another use is ignored.
  void give_back(u64 buffer, u64 generation);
  /// Nobody can tell when it is over: it is not used again.
  void give_up(u64 buffer);
  /// Nobody will say so for those of a call: they are not used again.
  void abandon(u64 call);
  bool let_go(const SharedMemorySource& source) override;
  /// Bytes of all buffers, and how many are leased.
  [[nodiscard]] std::pair<u64, u32> used() const;

 private:
  struct Buffer {
    Source source;
    std::shared_ptr<SharedMemory> memory;
    Charge bytes;
    Charge descriptor;
    u64 generation = 0;
    u64 call = 0;  // 0: free
  };
  using Buffers = std::unordered_map<u64, Buffer>;

  [[nodiscard]] Expected<std::shared_ptr<const LentMemory>> lent(const v1::BufferRef& ref) const;
  [[nodiscard]] Buffers::iterator smallest_free(u64 bytes, const Source& source);
  [[nodiscard]] Buffers::iterator make(u64 bytes, const Source& source);
  void forget(Buffers::iterator which);
  void forget_free_ones(u64 bytes_needed);
  [[nodiscard]] bool forget_free_of(const SharedMemorySource& source);
  void forget_lost_ones(const Source& source);

  const Room room_;
  const Tell tell_;
  const Source host_ = std::make_shared<SealedMemorySource>();
  mutable std::mutex mutex_;
  std::atomic<std::thread::id> maker_;  // has the mutex while it asks a source for more
  Buffers buffers_;
  u64 bytes_ = 0;
  u64 last_buffer_ = 0;
  u64 last_generation_ = 0;
  u64 last_call_ = 0;
};

/// Pixels in a lease, which ends with them unless it was sent.
class LeasedPixels final : public PixelMemory {
 public:
  LeasedPixels(std::shared_ptr<SharedFrames> frames, Lease lease)
      : frames_(std::move(frames)), lease_(std::move(lease)) {}
  LeasedPixels(const LeasedPixels&) = delete;
  LeasedPixels& operator=(const LeasedPixels&) = delete;
  ~LeasedPixels() override {
    if (!is_sent_) frames_->give_back(lease_.buffer, lease_.generation);
  }

  [[nodiscard]] std::span<std::byte> bytes() override { return lease_.memory->bytes(); }
  [[nodiscard]] bool is_on_device() const override { return lease_.memory->device() != nullptr; }
  /// From now on the client ends it.
  [[nodiscard]] const Lease& send() {
    is_sent_ = true;
    return lease_;
  }

 private:
  const std::shared_ptr<SharedFrames> frames_;
  const Lease lease_;
  std::atomic<bool> is_sent_ = false;
};

}  // namespace heliograph::server
