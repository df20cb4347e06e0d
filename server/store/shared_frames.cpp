// Making, leasing and taking back buffers. Called by FrameCutter, the engine and the local channel.
#include "server/store/shared_frames.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>

namespace heliograph::server {

/// Returns the smallest free buffer that fits, of at most twice the size rounded up to a power of
/// two (or to the source's step). A returned buffer is not free while the recorder reads it.
SharedFrames::Buffers::iterator SharedFrames::smallest_free(u64 bytes, const Source& source) {
  const u64 most = 2 * std::max(std::bit_ceil(bytes), source->step());
  auto best = buffers_.end();
  for (auto it = buffers_.begin(); it != buffers_.end(); ++it) {
    const u64 size = it->second.memory->bytes().size();
    const bool is_free = it->second.call == 0 && it->second.memory.use_count() == 1;
    if (!is_free || it->second.source != source || size < bytes || size > most) continue;
    if (best == buffers_.end() || size < best->second.memory->bytes().size()) best = it;
  }
  return best;
}

std::shared_ptr<SharedMemory> SharedFrames::ask(u64 bytes, SharedMemorySource& source) {
  source.know(weak_from_this());
  maker_ = std::this_thread::get_id();
  auto memory = source.make(bytes);
  if (!memory && forget_free_of(source)) memory = source.make(bytes);
  maker_ = std::thread::id();
  return memory;
}

SharedFrames::Buffers::iterator SharedFrames::make(u64 bytes, const Source& source) {
  constexpr u64 kSteps = 8;  // sizes between two powers of two
  const u64 step = std::max<u64>(std::bit_floor(bytes) / kSteps, source->step());
  const u64 size = (bytes + step - 1) / step * step;
  forget_lost_ones(source);
  Charge charge;
  auto descriptor = room_.take_descriptor();
  if (!descriptor || !room_.take(charge, size)) return buffers_.end();
  auto memory = ask(size, *source);
  const auto number = memory ? room_.announce(*memory) : std::nullopt;
  if (!number) {
    room_.give_up(charge);
    return buffers_.end();
  }
  return buffers_
      .emplace(*number,
               Buffer{source, std::move(memory), std::move(charge), *std::move(descriptor)})
      .first;
}

void SharedFrames::forget(Buffers::iterator which) {
  room_.end(which->first, which->second.bytes);
  buffers_.erase(which);
}

bool SharedFrames::forget_free_one() {
  const auto unused = std::ranges::find_if(buffers_, [](auto& b) { return b.second.call == 0; });
  if (unused == buffers_.end()) return false;
  forget(unused);
  return true;
}

bool SharedFrames::let_go(const SharedMemorySource& source) {
  if (maker_ == std::this_thread::get_id()) return false;  // make() frees on its own
  const std::unique_lock lock(mutex_, std::try_to_lock);
  return lock && forget_free_of(source);
}

/// Frees the unused buffers of one source; false when there were none.
bool SharedFrames::forget_free_of(const SharedMemorySource& source) {
  const std::size_t before = buffers_.size();
  for (auto it = buffers_.begin(); it != buffers_.end();) {
    const auto here = it++;
    if (here->second.call == 0 && here->second.source.get() == &source) forget(here);
  }
  return buffers_.size() < before;
}

/// Frees unused buffers of other sources: their device was replaced.
void SharedFrames::forget_lost_ones(const Source& source) {
  for (auto it = buffers_.begin(); it != buffers_.end();) {
    const auto here = it++;
    const Buffer& buffer = here->second;
    if (buffer.call == 0 && buffer.source != source) forget(here);
  }
}

u64 SharedFrames::new_call() {
  const std::lock_guard lock(mutex_);
  return room_.next_number();
}

std::optional<Lease> SharedFrames::reuse(u64 bytes, u64 call, const Source& source) {
  if (!source) return arenas_.reuse(bytes, call);
  const auto found = smallest_free(bytes, source);
  if (found == buffers_.end()) return std::nullopt;
  return use(found, call);
}

Lease SharedFrames::use(Buffers::iterator found, u64 call) {
  Buffer& buffer = found->second;
  buffer.call = call;
  buffer.generation = room_.next_number();
  return {found->first, buffer.generation, 0, buffer.memory, buffer.memory->bytes()};
}

std::optional<Lease> SharedFrames::lease(u64 bytes, u64 call, Source source) {
  {
    const std::lock_guard lock(mutex_);
    if (auto lease = reuse(bytes, call, source)) return lease;
  }
  poll_();  // the client may have returned some, and the loop not have read it yet
  const std::lock_guard lock(mutex_);
  if (!source) return arenas_.lease(bytes, call);
  if (auto lease = reuse(bytes, call, source)) return lease;
  const auto made = make(bytes, source);
  if (made == buffers_.end()) return std::nullopt;
  return use(made, call);
}

void SharedFrames::give_back(u64 buffer, u64 generation) {
  const std::lock_guard lock(mutex_);
  const auto found = buffers_.find(buffer);
  if (found == buffers_.end()) return arenas_.give_back(buffer, generation);
  if (found->second.generation == generation) found->second.call = 0;
}

void SharedFrames::give_up(u64 generation) {
  const std::lock_guard lock(mutex_);
  if (arenas_.lose(generation)) return;
  const auto found = std::ranges::find_if(buffers_, [&](const auto& each) {
    return each.second.call != 0 && each.second.generation == generation;
  });
  if (found != buffers_.end()) forget(found);
}

std::shared_ptr<const SharedMemory> SharedFrames::unmapped(u64 buffer) {
  const std::lock_guard lock(mutex_);
  return arenas_.unmapped(buffer);
}

void SharedFrames::let_be(const Lease& lease, bool is_sent) {
  if (lease.memory->device()) {
    if (!is_sent) give_back(lease.buffer, lease.generation);
    return;
  }
  const std::lock_guard lock(mutex_);
  arenas_.let_be(lease.generation, is_sent);
}

Expected<std::shared_ptr<const LentMemory>> SharedFrames::lent(const v1::BufferRef& ref) const {
  std::shared_ptr<const LentMemory> memory;
  {
    const std::lock_guard lock(mutex_);
    const auto found = buffers_.find(ref.buffer());
    if (found != buffers_.end() && found->second.call != 0 &&
        found->second.generation == ref.generation())
      memory = std::dynamic_pointer_cast<const LentMemory>(found->second.memory);
  }
  if (!memory)
    return fail(Code::kNotFound, "buffer.generation",
                fmt::format("this session holds no use {} of a buffer {}; borrow one with "
                            "LendBuffer",
                            ref.generation(), ref.buffer()));
  const u64 bytes = memory->bytes().size();
  if (ref.offset() > bytes || ref.size() > bytes - ref.offset())
    return fail(Code::kInvalidArgument, "buffer.size",
                fmt::format("{} bytes from {} do not lie within the buffer's {}", ref.size(),
                            ref.offset(), bytes));
  return memory;
}

Status SharedFrames::read(const v1::BufferRef& ref, const TakePiece& take) const {
  const auto memory = lent(ref);
  if (!memory) return std::unexpected(memory.error());
  return (*memory)->read(ref.offset(), ref.size(), take);
}

Expected<BufferPtr> SharedFrames::take(const v1::BufferRef& ref, Numbers kind) const {
  const auto memory = lent(ref);
  if (!memory) return std::unexpected(memory.error());
  struct Counted {
    Charge charge;
    BufferPtr bytes;
  };
  auto charge = Charge::take(room_.budget(), kind == Numbers::kFloats ? ref.size() : 0);
  if (!charge) return std::unexpected(std::move(charge).error());
  auto taken = (*memory)->take(ref.offset(), ref.size(), kind);
  if (!taken || !*taken) return taken;
  const auto bytes = (*taken)->bytes();
  const auto pooled = heliograph::Buffer::Kind::kPooled;
  auto counted = std::make_shared<Counted>(*std::move(charge), *std::move(taken));
  return std::make_shared<const heliograph::Buffer>(std::move(counted), bytes, pooled);
}

Expected<BufferPtr> SharedFrames::copy(const v1::BufferRef& ref) const {
  const auto memory = lent(ref);
  if (!memory) return std::unexpected(memory.error());
  struct Copy {
    Charge charge;
    std::unique_ptr<std::byte[]> bytes;
  };
  auto charge = Charge::take(room_.budget(), ref.size());
  if (!charge) return std::unexpected(std::move(charge).error());
  auto copy = std::make_shared<Copy>(*std::move(charge),
                                     std::make_unique_for_overwrite<std::byte[]>(ref.size()));
  std::byte* to = copy->bytes.get();
  HELIO_TRY((*memory)->read(ref.offset(), ref.size(),
                            [to](u64 begin, auto piece) { std::ranges::copy(piece, to + begin); }));
  return std::make_shared<const heliograph::Buffer>(std::move(copy), std::span(to, ref.size()));
}

void SharedFrames::abandon(u64 call) {
  const std::lock_guard lock(mutex_);
  arenas_.abandon(call);
  for (auto it = buffers_.begin(); it != buffers_.end();) {
    const auto here = it++;
    if (here->second.call == call) forget(here);
  }
}

std::pair<u64, u32> SharedFrames::used() const {
  const std::lock_guard lock(mutex_);
  const auto leased = std::ranges::count_if(buffers_, [](auto& b) { return b.second.call != 0; });
  return {room_.used(), u32(arenas_.uses()) + u32(leased)};
}

}  // namespace heliograph::server
