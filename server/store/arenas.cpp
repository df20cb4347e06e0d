// Choosing, growing and ending arenas. See arenas.h.
#include "server/store/arenas.h"

#include <algorithm>
#include <utility>

namespace heliograph::server {
namespace {

constexpr u64 kAlignment = 64;
constexpr u64 kPage = 4096;
constexpr u64 kSmallest = 1 << 20;  // bytes of an arena
constexpr u64 kLargest = 64 << 20;  // unless a single frame needs more
// Limit of a session's arenas, plus one per 32 MiB of its limit of shared bytes: enough for all
// frames unless leases are lost again and again.
constexpr u64 kArenas = 32;

constexpr u64 round_up(u64 bytes, u64 step) { return (bytes + step - 1) / step * step; }
constexpr u64 lease_size(u64 bytes) { return round_up(std::max<u64>(bytes, 1), kAlignment); }

}  // namespace

std::optional<u64> Arenas::take(Arena& arena, u64 bytes) {
  if (arena.is_retired) return std::nullopt;
  const auto offset = arena.free.take(bytes);
  if (!offset) return std::nullopt;
  ++arena.uses;  // before room is made, which ends unused arenas
  const u64 end = round_up(*offset + bytes, kPage);
  const u64 charged = arena.charge.amount();
  if (end <= charged || room_.take(arena.charge, end - charged)) return offset;
  --arena.uses;
  arena.free.give_back(*offset, bytes);
  return std::nullopt;
}

Arenas::Places::iterator Arenas::make(u64 bytes) {
  Charge charge;
  if (arenas_.size() >= kArenas + room_.limit() / (kLargest / 2)) return arenas_.end();
  auto descriptor = room_.take_descriptor();
  if (!descriptor || !room_.take(charge, round_up(bytes, kPage))) return arenas_.end();
  const u64 size = std::max(round_up(bytes, kPage), std::clamp(size_, kSmallest, kLargest));
  auto memory = SealedMemory::create(size);
  const auto number = memory ? room_.announce(*memory) : std::nullopt;
  if (!number) {
    room_.give_up(charge);
    return arenas_.end();
  }
  size_ += size;
  return arenas_
      .emplace(*number,
               Arena{std::move(memory), Ranges(size), std::move(charge), *std::move(descriptor)})
      .first;
}

Lease Arenas::use(Places::iterator arena, Use use) {
  const u64 generation = room_.next_number();
  use.arena = arena->first;
  uses_.emplace(generation, use);
  const auto& memory = arena->second.memory;
  return {use.arena, generation, use.offset, memory,
          memory->bytes().subspan(use.offset, use.bytes)};
}

std::optional<Lease> Arenas::reuse(u64 bytes, u64 call) {
  const u64 size = lease_size(bytes);
  for (auto arena = arenas_.begin(); arena != arenas_.end(); ++arena)
    if (const auto offset = take(arena->second, size))
      return use(arena, {.offset = *offset, .bytes = size, .call = call});
  return std::nullopt;
}

std::optional<Lease> Arenas::lease(u64 bytes, u64 call) {
  if (auto lease = reuse(bytes, call)) return lease;
  const u64 size = lease_size(bytes);
  const auto arena = make(size);
  if (arena == arenas_.end()) return std::nullopt;
  const auto offset = take(arena->second, size);
  if (!offset) return std::nullopt;
  return use(arena, {.offset = *offset, .bytes = size, .call = call});
}

void Arenas::end(Places::iterator arena, bool is_known) {
  size_ -= arena->second.memory->bytes().size();
  room_.end(arena->first, arena->second.charge, is_known);
  arenas_.erase(arena);
}

void Arenas::end_use(Places::iterator arena) {
  if (--arena->second.uses == 0 && arena->second.is_retired) end(arena);
}

void Arenas::end_if_over(Uses::iterator use) {
  const Use over = use->second;
  if (over.is_the_daemons || over.is_the_clients) return;
  const auto arena = arenas_.find(over.arena);
  uses_.erase(use);
  arena->second.free.give_back(over.offset, over.bytes);
  end_use(arena);
}

void Arenas::give_back(u64 buffer, u64 generation) {
  const auto use = uses_.find(generation);
  if (use == uses_.end() || use->second.arena != buffer) return;
  use->second.is_the_clients = false;
  end_if_over(use);
}

void Arenas::let_be(u64 generation, bool is_sent) {
  const auto use = uses_.find(generation);
  if (use == uses_.end()) return;
  use->second.is_the_daemons = false;
  if (!is_sent) use->second.is_the_clients = false;
  end_if_over(use);
}

Arenas::Uses::iterator Arenas::lose(Uses::iterator use) {
  const auto arena = arenas_.find(use->second.arena);
  arena->second.is_retired = true;
  const auto next = uses_.erase(use);
  end_use(arena);
  return next;
}

bool Arenas::lose(u64 generation) {
  const auto use = uses_.find(generation);
  if (use == uses_.end()) return false;
  lose(use);
  return true;
}

void Arenas::abandon(u64 call) {
  for (auto use = uses_.upper_bound(call); use != uses_.end();)
    use = use->second.call == call ? lose(use) : std::next(use);
}

std::shared_ptr<SealedMemory> Arenas::unmapped(u64 buffer) {
  const auto arena = arenas_.find(buffer);
  if (arena == arenas_.end()) return nullptr;
  auto memory = arena->second.memory;
  if (arena->second.uses == 0) {
    end(arena, true);
    return memory;
  }
  // Once per arena: a client cannot provoke descriptors without end.
  if (!std::exchange(arena->second.is_retired, true)) (void)room_.announce_again(buffer, *memory);
  return nullptr;
}

bool Arenas::let_go() {
  const auto unused =
      std::ranges::find_if(arenas_, [](const auto& each) { return each.second.uses == 0; });
  if (unused == arenas_.end()) return false;
  end(unused);
  return true;
}

}  // namespace heliograph::server
