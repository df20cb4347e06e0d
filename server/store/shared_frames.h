// Frames in memory that a local client maps, handed over on the local channel: ranges of arenas in
// host memory, or buffers in a device's memory, pooled per session.
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
#include "renderer/frame/lent_memory.h"
#include "renderer/frame/pixels.h"
#include "renderer/frame/shared_memory.h"
#include "server/store/arenas.h"
#include "server/store/shared_room.h"

namespace heliograph::server {

/// Shared buffers of one session, leased to frames. A sent range is never rewritten: it is reused
/// once the client returns it, and abandoned (the client's mapping lives on) when it cannot be
/// known whether the client still reads it. Thread: any.
class SharedFrames final : public SharedMemoryKeeper,
                           public std::enable_shared_from_this<SharedFrames> {
 public:
  using Source = std::shared_ptr<SharedMemorySource>;
  using Send = SharedRoom::Send;
  using Poll = std::function<void()>;

  /// poll: delivers what the client has sent so far, such as the ends of leases
  SharedFrames(SharedRoom::Limits limits, Send send, Poll poll)
      : room_(std::move(limits), std::move(send),
              [this] { return forget_free_one() || arenas_.let_go(); }),
        poll_(std::move(poll)) {}

  /// Returns a number that no other call of the session has.
  [[nodiscard]] u64 new_call();
  /// Leases memory for a plane that `call` sends. None when limit, budget, source or socket refuse:
  /// the plane then travels as bytes, if the host can read it.
  ///
  /// source   the device's memory; null: the host's
  [[nodiscard]] std::optional<Lease> lease(u64 bytes, u64 call, Source source = nullptr);
  /// Reads what the client wrote into a buffer that it holds, piece by piece. NOT_FOUND when it
  /// does not hold that generation, INVALID_ARGUMENT for a range outside the buffer.
  [[nodiscard]] Status read(const v1::BufferRef& ref, const TakePiece& take) const;
  /// As LentMemory::take(). Floats are charged to the budget as by copy().
  [[nodiscard]] Expected<BufferPtr> take(const v1::BufferRef& ref, Numbers kind) const;
  /// Copies a range of a buffer that the client holds. Errors of read(), RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<BufferPtr> copy(const v1::BufferRef& ref) const;
  /// Ends a lease. A generation that is not the buffer's current one is ignored.
  void give_back(u64 buffer, u64 generation);
  /// Abandons a lease whose end will never be reported: its memory is not reused.
  void give_up(u64 generation);
  /// The client has unmapped an arena (Arenas::unmapped). Returns the memory to free, or null.
  [[nodiscard]] std::shared_ptr<const SharedMemory> unmapped(u64 buffer);
  /// The daemon is done with a lease: from now on it neither reads nor writes it. is_sent: the
  /// client has it and will return it.
  void let_be(const Lease& lease, bool is_sent);
  /// Abandons the leases of a call, which will never be returned: their memory is not reused.
  void abandon(u64 call);
  bool let_go(const SharedMemorySource& source) override;
  /// Bytes of all buffers, and the number of leases.
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
  /// Leases memory that is there; none where all is in use.
  [[nodiscard]] std::optional<Lease> reuse(u64 bytes, u64 call, const Source& source);
  [[nodiscard]] Lease use(Buffers::iterator found, u64 call);
  [[nodiscard]] Buffers::iterator smallest_free(u64 bytes, const Source& source);
  [[nodiscard]] Buffers::iterator make(u64 bytes, const Source& source);
  [[nodiscard]] std::shared_ptr<SharedMemory> ask(u64 bytes, SharedMemorySource& source);
  void forget(Buffers::iterator which);
  bool forget_free_one();
  [[nodiscard]] bool forget_free_of(const SharedMemorySource& source);
  void forget_lost_ones(const Source& source);

  mutable std::mutex mutex_;
  std::atomic<std::thread::id> maker_;  // thread that holds mutex_ while a source allocates
  SharedRoom room_;
  const Poll poll_;
  Arenas arenas_{room_};  // the host's
  Buffers buffers_;       // of devices
};

/// Pixels in leased memory. The destructor ends the lease unless it was sent.
class LeasedPixels final : public PixelMemory {
 public:
  LeasedPixels(std::shared_ptr<SharedFrames> frames, Lease lease)
      : frames_(std::move(frames)), lease_(std::move(lease)) {}
  LeasedPixels(const LeasedPixels&) = delete;
  LeasedPixels& operator=(const LeasedPixels&) = delete;
  ~LeasedPixels() override { frames_->let_be(lease_, is_sent_); }

  [[nodiscard]] std::span<std::byte> bytes() override { return lease_.bytes; }
  [[nodiscard]] bool is_on_device() const override { return lease_.memory->device() != nullptr; }
  /// Passes the lease to the client, which returns it.
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
