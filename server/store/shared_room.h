// Accounting of the shared buffers of one session: their bytes, their numbers, and the messages to
// the client about them. Used by SharedFrames and Arenas.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <utility>

#include "renderer/frame/shared_memory.h"
#include "server/quota/budget.h"

namespace heliograph::server {

/// A range of a buffer, in use from lease() until the client returns it.
struct Lease {
  u64 buffer = 0;
  u64 generation = 0;
  u64 offset = 0;  // bytes from the buffer's start
  std::shared_ptr<SharedMemory> memory;
  std::span<std::byte> bytes;  // of memory
};

/// Thread: its owner's mutex guards it.
class SharedRoom {
 public:
  /// Announces a buffer to the client before its first use; null: the client forgets it. False when
  /// the socket accepts nothing.
  using Send = std::function<bool(u64 buffer, const SharedMemory* memory)>;
  /// Frees a buffer that is not leased; false when there is none.
  using LetGo = std::function<bool()>;

  struct Limits {
    u64 bytes = 0;  // of all buffers
    std::shared_ptr<Budget> budget;
    std::shared_ptr<Budget> descriptors;
  };
  SharedRoom(Limits limits, Send send, LetGo let_go)
      : limits_(std::move(limits)), send_(std::move(send)), let_go_(std::move(let_go)) {}

  /// Adds bytes to the charge of a buffer, freeing unused buffers as needed. False when limit or
  /// budget refuse and nothing is left to free.
  [[nodiscard]] bool take(Charge& charge, u64 bytes) {
    while (!take_now(charge, bytes))
      if (!let_go_()) return false;
    return true;
  }
  /// Charges one descriptor for a new buffer; none when nothing is left to free.
  [[nodiscard]] std::optional<Charge> take_descriptor() {
    for (;;) {
      if (auto one = Charge::take(limits_.descriptors, 1)) return *std::move(one);
      if (!let_go_()) return std::nullopt;
    }
  }
  /// Releases the bytes of a charge that got no buffer.
  void give_up(const Charge& charge) { used_ -= charge.amount(); }
  /// Announces a new buffer; returns its number, none when the socket accepts nothing.
  [[nodiscard]] std::optional<u64> announce(const SharedMemory& memory) {
    if (!send_(last_buffer_ + 1, &memory)) return std::nullopt;
    return ++last_buffer_;
  }
  /// Announces a buffer again. False when the socket accepts nothing.
  [[nodiscard]] bool announce_again(u64 buffer, const SharedMemory& memory) {
    return send_(buffer, &memory);
  }
  /// Ends a buffer and its charge. The client is sent a message unless it unmapped the buffer
  /// itself (is_known); if that message is lost, it maps the buffer until its session ends.
  void end(u64 buffer, const Charge& charge, bool is_known = false) {
    give_up(charge);
    if (!is_known) (void)send_(buffer, nullptr);
  }
  /// Returns the number of a new call or generation, above all earlier ones.
  [[nodiscard]] u64 next_number() { return ++last_number_; }

  [[nodiscard]] u64 limit() const { return limits_.bytes; }
  [[nodiscard]] u64 used() const { return used_; }
  [[nodiscard]] const std::shared_ptr<Budget>& budget() const { return limits_.budget; }

 private:
  [[nodiscard]] bool take_now(Charge& charge, u64 bytes) {
    if (bytes > limits_.bytes - std::min(used_, limits_.bytes)) return false;
    auto more = Charge::take(limits_.budget, bytes);
    if (!more) return false;
    charge.merge(*std::move(more));
    used_ += bytes;
    return true;
  }

  const Limits limits_;
  const Send send_;
  const LetGo let_go_;
  u64 used_ = 0;
  u64 last_buffer_ = 0;
  u64 last_number_ = 0;
};

}  // namespace heliograph::server
