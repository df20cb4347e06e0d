#include "renderer/backend/cuda/mirror.h"

namespace heliograph::cuda {

std::shared_ptr<const DeviceMemory> Mirror::find(const void* from, std::size_t bytes) const {
  const auto [begin, end] = known_.equal_range(from);
  for (auto known = begin; known != end; ++known)
    if (known->second.bytes == bytes)
      if (auto memory = known->second.memory.lock()) return memory;
  return nullptr;
}

void Mirror::know(const void* from, std::size_t bytes,
                  const std::shared_ptr<const DeviceMemory>& memory) {
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
  HELIO_TRY(context_->upload(memory->at(), host));
  auto kept = std::make_shared<const DeviceMemory>(*std::move(memory));
  know(host.data(), host.size(), kept);
  return kept;
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
void Copies::count(std::span<const std::byte> host) {
  Error& error = status_.error();
  if (error.needed > 0) error = no_device_memory(error.needed + host.size(), error.available);
}

const void* Copies::shared(std::span<const std::byte> host) {
  if (host.empty()) return nullptr;
  if (!status_) {
    if (!mirror_->has(host)) count(host);
    return nullptr;
  }
  const DeviceMemory* copy = hold(mirror_->copy(host));
  return copy ? copy->as<const void>() : nullptr;
}

const void* Copies::own(std::span<const std::byte> host) {
  if (host.empty()) return nullptr;
  if (!status_) return count(host), nullptr;
  auto made = mirror_->context().allocate(host.size());
  if (!made) return refuse(std::move(made).error()), nullptr;
  own_ += made->bytes();
  held_.push_back(std::make_shared<const DeviceMemory>(*std::move(made)));
  status_ = mirror_->context().upload(held_.back()->at(), host);
  return held_.back()->as<const void>();
}

}  // namespace heliograph::cuda
