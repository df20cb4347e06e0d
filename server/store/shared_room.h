// What all shared buffers of one session have in common: how many bytes they may have, their
// numbers, and how the client hears of them. Used by SharedFrames and Arenas.
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

/// One use of a range of a buffer, until the client returns it.
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
  /// Tells the client about a buffer before its first use; null: about one to be forgotten. False
  /// when the socket takes nothing.
  using Tell = std::function<bool(u64 buffer, const SharedMemory* memory)>;
  /// Lets go of a buffer that nobody uses; false when there is none.
  using LetGo = std::function<bool()>;

  struct Limits {
    u64 bytes = 0;  // of all buffers
    std::shared_ptr<Budget> budget;
    std::shared_ptr<Budget> descriptors;
  };
  SharedRoom(Limits limits, Tell tell, LetGo let_go)
      : limits_(std::move(limits)), tell_(std::move(tell)), let_go_(std::move(let_go)) {}

  /// Adds bytes to the charge of a buffer. False when limit or budget have none, and nothing is
  /// left to let go of.
  [[nodiscard]] bool take(Charge& charge, u64 bytes) {
    while (!take_now(charge, bytes))
      if (!let_go_()) return false;
    return true;
  }
  /// One for a new buffer; none when nothing is left to let go of.
  [[nodiscard]] std::optional<Charge> take_descriptor() {
    for (;;) {
      if (auto one = Charge::take(limits_.descriptors, 1)) return *std::move(one);
      if (!let_go_()) return std::nullopt;
    }
  }
  /// A charge that was taken ends without a buffer.
  void give_up(const Charge& charge) { used_ -= charge.amount(); }
  /// Tells the client of a new buffer; its number. None when the socket takes nothing.
  [[nodiscard]] std::optional<u64> announce(const SharedMemory& memory) {
    if (!tell_(last_buffer_ + 1, &memory)) return std::nullopt;
    return ++last_buffer_;
  }
  /// Tells it once more.
  [[nodiscard]] bool announce_again(u64 buffer, const SharedMemory& memory) {
    return tell_(buffer, &memory);
  }
  /// A buffer with this charge ends, and the client is told unless it knows. Unsaid, it maps the
  /// buffer until its session ends.
  void end(u64 buffer, const Charge& charge, bool is_known = false) {
    give_up(charge);
    if (!is_known) (void)tell_(buffer, nullptr);
  }
  /// Of a call, or a generation: above all before it.
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
  const Tell tell_;
  const LetGo let_go_;
  u64 used_ = 0;
  u64 last_buffer_ = 0;
  u64 last_number_ = 0;
};

}  // namespace heliograph::server
