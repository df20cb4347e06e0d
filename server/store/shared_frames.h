// Frames in memory that a local client maps, handed over on the second socket: ranges of arenas of
// the host, or buffers of a device's memory, pooled for each session.
#pragma once

#include <atomic>
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

/// The buffers of one session. What was sent is never rewritten: it comes back when the client
/// says so, and is abandoned (the client's mapping lives on) when nobody can tell whether it still
/// looks. Thread: any.
class SharedFrames final : public SharedMemoryKeeper,
                           public std::enable_shared_from_this<SharedFrames> {
 public:
  using Source = std::shared_ptr<SharedMemorySource>;
  using Tell = SharedRoom::Tell;

  SharedFrames(SharedRoom::Limits limits, Tell tell)
      : room_(std::move(limits), std::move(tell),
              [this] { return forget_free_one() || arenas_.let_go(); }) {}

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
  /// Nobody can tell when this use is over: what it is of is not used again.
  void give_up(u64 generation);
  /// The client maps an arena no more (Arenas::unmapped). What is to be freed then, or null.
  [[nodiscard]] std::shared_ptr<const SharedMemory> unmapped(u64 buffer);
  /// The daemon neither reads nor writes it any more, and has sent it, or never will.
  void let_be(const Lease& lease, bool is_sent);
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
  [[nodiscard]] std::shared_ptr<SharedMemory> ask(u64 bytes, SharedMemorySource& source);
  [[nodiscard]] std::optional<Lease> lease_of(u64 bytes, u64 call, const Source& source);
  void forget(Buffers::iterator which);
  bool forget_free_one();
  [[nodiscard]] bool forget_free_of(const SharedMemorySource& source);
  void forget_lost_ones(const Source& source);

  mutable std::mutex mutex_;
  std::atomic<std::thread::id> maker_;  // has the mutex while it asks a source for more
  SharedRoom room_;
  Arenas arenas_{room_};  // the host's
  Buffers buffers_;       // of devices
};

/// Pixels in a lease, which ends with them unless it was sent.
class LeasedPixels final : public PixelMemory {
 public:
  LeasedPixels(std::shared_ptr<SharedFrames> frames, Lease lease)
      : frames_(std::move(frames)), lease_(std::move(lease)) {}
  LeasedPixels(const LeasedPixels&) = delete;
  LeasedPixels& operator=(const LeasedPixels&) = delete;
  ~LeasedPixels() override { frames_->let_be(lease_, is_sent_); }

  [[nodiscard]] std::span<std::byte> bytes() override { return lease_.bytes; }
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
