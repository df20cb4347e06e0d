#include "renderer/backend/cuda/mirror.h"

namespace heliograph::cuda {

Expected<std::shared_ptr<const DeviceMemory>> Mirror::copy(std::span<const std::byte> host) {
  const auto [begin, end] = known_.equal_range(host.data());
  for (auto known = begin; known != end; ++known)
    if (known->second.bytes == host.size())
      if (auto memory = known->second.memory.lock()) return memory;
  auto memory = context_->allocate(host.size());
  if (!memory) return std::unexpected(std::move(memory).error());
  HELIO_TRY(context_->upload(memory->at(), host));
  auto kept = std::make_shared<const DeviceMemory>(*std::move(memory));
  if (known_.size() >= next_sweep_) forget_expired();
  known_.emplace(host.data(), Known{host.size(), kept});
  return kept;
}

void Mirror::forget_expired() {
  std::erase_if(known_, [](const auto& known) { return known.second.memory.expired(); });
  next_sweep_ = std::max<std::size_t>(1024, 2 * known_.size());
}

const void* Copies::shared(std::span<const std::byte> host) {
  if (host.empty() || !status_) return nullptr;
  auto made = mirror_->copy(host);
  if (!made) {
    status_ = std::unexpected(std::move(made).error());
    return nullptr;
  }
  held_.push_back(*std::move(made));
  return held_.back()->as<const void>();
}

const void* Copies::own(std::span<const std::byte> host) {
  if (host.empty() || !status_) return nullptr;
  auto made = mirror_->context().allocate(host.size());
  if (!made) {
    status_ = std::unexpected(std::move(made).error());
    return nullptr;
  }
  held_.push_back(std::make_shared<const DeviceMemory>(*std::move(made)));
  status_ = mirror_->context().upload(held_.back()->at(), host);
  return held_.back()->as<const void>();
}

}  // namespace heliograph::cuda
