// Arrays that a local client wrote into memory of its own and handed over on the second socket.
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

/// The buffers that one session handed over and did not use yet. Large ones are mapped, not
/// copied: their seals keep the client from changing what was checked. Thread: any.
class SharedUploads {
 public:
  /// `budget`: of the owner's bytes.
  explicit SharedUploads(std::shared_ptr<Budget> budget) : budget_(std::move(budget)) {}

  /// What the client sent before a request may still wait in the second socket: `hear` reads it.
  /// Called before the session is known to its client.
  void listen(std::function<void()> hear) { hear_ = std::move(hear); }

  /// What an array names that lies in a buffer which the client was lent.
  struct Lender {
    std::function<Expected<BufferPtr>(const v1::BufferRef&)> copy;
    std::function<Status(const v1::BufferRef&, const TakePiece&)> read;
    std::function<Expected<BufferPtr>(const v1::BufferRef&, Numbers)> take;
  };
  /// Called before the session is known to its client, too.
  void lend(Lender lender) { lender_ = std::move(lender); }

  /// `fd`: a memfd that is sealed against writing and changes of its size. It stays the caller's.
  /// What is wrong with it is told to the request that names it; false: something is.
  bool take(u64 buffer, u64 bytes, int fd);
  /// The bytes that an array names; used up. INVALID_ARGUMENT, NOT_FOUND, RESOURCE_EXHAUSTED.
  [[nodiscard]] Expected<BufferPtr> use(const v1::BufferRef& ref);
  /// The bytes that an array names in a buffer that was lent; false: in another.
  [[nodiscard]] Expected<bool> read_lent(const v1::BufferRef& ref, const TakePiece& take) const;
  /// The numbers that an array names there as LentMemory::take() has them; null where it has not.
  [[nodiscard]] Expected<BufferPtr> take_lent(const v1::BufferRef& ref, Numbers kind) const;

 private:
  struct Memory;
  using Taken = Expected<std::shared_ptr<const Memory>>;

  [[nodiscard]] Taken read(u64 bytes, int fd) const;
  [[nodiscard]] std::shared_ptr<const Taken> extract(u64 buffer);

  const std::shared_ptr<Budget> budget_;
  std::function<void()> hear_;
  Lender lender_;
  std::mutex mutex_;
  std::map<u64, std::shared_ptr<const Taken>> taken_;
};

}  // namespace heliograph::server
