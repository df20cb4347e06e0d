// Arrays that a local client wrote into memory of its own and handed over on the local channel.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <mutex>

#include "heliograph/v1/types.pb.h"
#include "renderer/base/array.h"
#include "renderer/base/error.h"
#include "renderer/frame/lent_memory.h"
#include "server/os/unique_fd.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// Buffers that the client of one session handed over and no request has used yet. Buffers of 1 MiB
/// and more are mapped, not copied: their seals keep the client from changing them after the check.
/// Thread: any.
class SharedUploads {
 public:
  /// budget   bytes of the session's tenant
  explicit SharedUploads(std::shared_ptr<Budget> budget) : budget_(std::move(budget)) {}

  /// Sets the function that delivers pending messages of the local channel: a buffer that was sent
  /// before a request may still wait there. Called before the client knows the session.
  void set_poll(std::function<void()> poll) { poll_ = std::move(poll); }

  /// Access to buffers that the daemon lent to the client (SharedFrames).
  struct Lender {
    std::function<Expected<BufferPtr>(const v1::BufferRef&)> copy;
    std::function<Status(const v1::BufferRef&, const TakePiece&)> read;
    std::function<Expected<BufferPtr>(const v1::BufferRef&, Numbers)> take;
  };
  /// Called before the client knows the session.
  void lend(Lender lender) { lender_ = std::move(lender); }

  /// Takes over the bytes of a memfd sealed against writing and resizing; `fd` stays the caller's.
  /// False when it is refused; the request that names the buffer gets the error.
  bool take(u64 buffer, u64 bytes, int fd);
  /// Returns the bytes that an array names and forgets the buffer. INVALID_ARGUMENT, NOT_FOUND,
  /// RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<BufferPtr> use(const v1::BufferRef& ref);
  /// Reads the bytes that an array names in a lent buffer; false: the buffer is not a lent one.
  [[nodiscard]] Expected<bool> read_lent(const v1::BufferRef& ref, const TakePiece& take) const;
  /// As LentMemory::take() for an array in a lent buffer; null: not a lent one, or not possible.
  [[nodiscard]] Expected<BufferPtr> take_lent(const v1::BufferRef& ref, Numbers kind) const;

 private:
  struct Memory;
  using Taken = Expected<std::shared_ptr<const Memory>>;

  [[nodiscard]] Taken read(u64 bytes, int fd) const;
  [[nodiscard]] std::shared_ptr<const Taken> extract(u64 buffer);

  const std::shared_ptr<Budget> budget_;
  std::function<void()> poll_;
  Lender lender_;
  std::mutex mutex_;
  std::map<u64, std::shared_ptr<const Taken>> taken_;
};

}  // namespace heliograph::server
