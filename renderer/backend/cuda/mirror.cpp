#include "renderer/backend/cuda/mirror.h"

#include <algorithm>
#include <cstring>

namespace heliograph::cuda {
namespace {

constexpr u64 kChunkBytes = 64 << 10;
constexpr u64 kMostInChunk = 16 << 10;
constexpr u64 kAlignment = 256;
constexpr std::size_t kBlock = 16 << 10;  // of what is compared

/// Joins pieces that lie together on both sides.
void add(std::vector<Upload>& pieces, const Upload& next) {
  if (!pieces.empty()) {
    Upload& last = pieces.back();
    const u64 size = last.from.size();
    if (last.to + size == next.to && last.from.data() + size == next.from.data()) {
      last.from = {last.from.data(), size + next.from.size()};
      return;
    }
  }
  pieces.push_back(next);
}

}  // namespace

std::shared_ptr<const DeviceMemory> Mirror::find(const void* from, std::size_t bytes) {
  const std::scoped_lock lock(mutex_);
  const auto [begin, end] = known_.equal_range(from);
  for (auto known = begin; known != end; ++known)
    if (known->second.bytes == bytes)
      if (auto memory = known->second.memory.lock()) return memory;
  return nullptr;
}

void Mirror::know(const void* from, std::size_t bytes,
                  const std::shared_ptr<const DeviceMemory>& memory) {
  const std::scoped_lock lock(mutex_);
  if (known_.size() >= next_sweep_) {
    std::erase_if(known_, [](const auto& known) { return known.second.memory.expired(); });
    next_sweep_ = std::max<std::size_t>(1024, 2 * known_.size());
  }
  known_.emplace(from, Known{bytes, memory});
}

Expected<std::shared_ptr<const DeviceMemory>> Mirror::copy(std::span<const std::byte> host) {
  if (auto memory = find(host.data(), host.size())) return memory;
  auto memory = context_->allocate(host.size());
  if (!memory) return std::unexpected(std::move(memory).error());
  HELIO_TRY(fill(memory->at(), host));
  auto kept = std::make_shared<const DeviceMemory>(*std::move(memory));
  know(host.data(), host.size(), kept);
  return kept;
}

Status Mirror::fill(DevicePointer to, std::span<const std::byte> host) const {
  return has_twin(host) ? twins_->copy(to, host) : context_->upload(to, host);
}

const DeviceMemory* Copies::hold(Expected<std::shared_ptr<const DeviceMemory>> memory) {
  if (!memory) {
    refuse(std::move(memory).error());
    return nullptr;
  }
  if (memory->use_count() == 1) own_ += (*memory)->bytes();
  held_.push_back(*std::move(memory));
  return held_.back().get();
}

void Copies::refuse(Error error) {
  if (error.needed > 0) error = no_device_memory(error.needed + own_, error.available + own_);
  status_ = std::unexpected(std::move(error));
}

/// After a refusal.
void Copies::count(u64 bytes) {
  Error& error = status_.error();
  if (error.needed > 0) error = no_device_memory(error.needed + bytes, error.available);
}

const void* Copies::shared(std::span<const std::byte> host) {
  if (host.empty()) return nullptr;
  if (!status_) {
    if (!mirror_->has(host)) count(host.size());
    return nullptr;
  }
  const DeviceMemory* copy = hold(mirror_->copy(host));
  return copy ? copy->as<const void>() : nullptr;
}

const void* Copies::own(std::span<const std::byte> host) {
  if (host.empty()) return nullptr;
  if (!status_) return count(host.size()), nullptr;
  if (host.size() > kMostInChunk) {
    const DeviceMemory* memory = hold(allocate(host.size()));
    if (memory) status_ = mirror_->context().upload(memory->at(), host);
    return memory ? memory->as<const void>() : nullptr;
  }
  u64 offset = (in_chunk_.size() + kAlignment - 1) / kAlignment * kAlignment;
  if (!chunk_ || offset + host.size() > kChunkBytes) {
    send();
    const DeviceMemory* memory = hold(allocate(kChunkBytes));
    if (!memory) return nullptr;
    chunk_ = memory->at();
    offset = 0;
  }
  in_chunk_.resize(offset);
  in_chunk_.insert(in_chunk_.end(), host.begin(), host.end());
  return reinterpret_cast<const void*>(chunk_ + offset);
}

void* Copies::bytes(u64 size) {
  if (size == 0) return nullptr;
  if (!status_) return count(size), nullptr;
  const DeviceMemory* memory = hold(allocate(size));
  return memory ? memory->as<void>() : nullptr;
}

const void* Copies::pieces(const std::vector<Piece>& all, u64 size, DevicePointer before) {
  void* made = bytes(size);
  if (!made) return nullptr;
  const auto at = DevicePointer(made);
  if (before) status_ = mirror_->context().copy(at, before, size);
  std::vector<Upload> uploads, twins;
  for (const Piece& piece : all) {
    if (mirror_->has_twin(piece.host)) {
      add(twins, {at + piece.offset, piece.host});
      continue;
    }
    for (u64 begin = 0; begin < piece.host.size(); begin += kBlock) {
      const auto block = piece.host.subspan(begin, std::min(kBlock, piece.host.size() - begin));
      if (piece.before && std::memcmp(block.data(), piece.before + begin, block.size()) == 0)
        continue;
      uploads.push_back({at + piece.offset + begin, block});
    }
  }
  if (status_) status_ = mirror_->context().upload(uploads);
  for (const Upload& twin : twins)
    if (status_) status_ = mirror_->fill(twin.to, twin.from);
  return made;
}

Expected<std::shared_ptr<const DeviceMemory>> Copies::allocate(u64 bytes) const {
  auto made = mirror_->context().allocate(bytes);
  if (!made) return std::unexpected(std::move(made).error());
  return std::make_shared<const DeviceMemory>(*std::move(made));
}

void Copies::send() {
  if (status_ && !in_chunk_.empty()) status_ = mirror_->context().upload(chunk_, in_chunk_);
  in_chunk_.clear();
  chunk_ = 0;
}

Status Copies::finish() {
  send();
  return status_;
}

}  // namespace heliograph::cuda
