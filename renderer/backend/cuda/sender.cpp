#include "renderer/backend/cuda/sender.h"

#include <algorithm>
#include <cstring>
#include <utility>
#include <vector>

#include "renderer/base/parallel.h"

namespace heliograph::cuda {
namespace {

constexpr u64 kStageBytes = 4 << 20;
constexpr u64 kPart = 64 << 10;    // of a piece; what a thread copies at once
constexpr unsigned kNoTiming = 2;  // CU_EVENT_DISABLE_TIMING

/// Pieces in parts that are not larger than kPart.
std::vector<Upload> parts_of(std::span<const Upload> pieces) {
  std::vector<Upload> parts;
  for (const Upload& piece : pieces)
    for (u64 begin = 0; begin < piece.from.size(); begin += kPart)
      parts.push_back({piece.to + begin,
                       piece.from.subspan(begin, std::min(kPart, piece.from.size() - begin))});
  return parts;
}

/// Number of first parts that a stage takes.
std::size_t that_fit(std::span<const Upload> parts) {
  u64 bytes = 0;
  std::size_t count = 0;
  while (count < parts.size() && bytes + parts[count].from.size() <= kStageBytes)
    bytes += parts[count++].from.size();
  return count;
}

}  // namespace

Result Sender::open(Stage& stage) const {
  if (stage.is_on_its_way) return driver_.wait_for_event(stage.sent);
  Result result = 0;
  if (!stage.memory) result = driver_.allocate_pinned(&stage.memory, kStageBytes, 0);
  if (result == 0 && !stage.sent) result = driver_.create_event(&stage.sent, kNoTiming);
  return result;
}

Result Sender::send(std::span<const Upload> pieces, StreamHandle stream) {
  const std::vector<Upload> parts = parts_of(pieces);
  const std::lock_guard lock(mutex_);
  std::span<const Upload> left = parts;
  for (u32 next = 0; !left.empty(); ++next) {
    const std::size_t count = that_fit(left);
    const Result result = send_stage(stages_[next % stages_.size()], left.first(count), stream);
    if (result != 0) return result;
    left = left.subspan(count);
  }
  return 0;
}

Result Sender::send_stage(Stage& stage, std::span<const Upload> parts, StreamHandle stream) const {
  Result result = open(stage);
  if (result != 0) return result;
  stage.is_on_its_way = false;
  auto* memory = static_cast<std::byte*>(stage.memory);
  std::vector<u64> offsets;
  u64 bytes = 0;
  for (const Upload& part : parts)
    offsets.push_back(std::exchange(bytes, bytes + part.from.size()));
  run_alone([&] {
    parallel_for(parts.size(), [&](std::size_t i) {
      std::memcpy(memory + offsets[i], parts[i].from.data(), parts[i].from.size());
    });
  });
  // Parts that lie together there go together.
  for (std::size_t begin = 0, end = 0; begin < parts.size() && result == 0; begin = end) {
    u64 size = 0;
    for (end = begin; end < parts.size() && parts[end].to == parts[begin].to + size; ++end)
      size += parts[end].from.size();
    result = driver_.upload(parts[begin].to, memory + offsets[begin], size, stream);
  }
  if (result == 0) result = driver_.record_event(stage.sent, stream);
  stage.is_on_its_way = result == 0;
  return result;
}

void Sender::close() {
  for (Stage& stage : stages_)
    if (stage.sent) (void)driver_.destroy_event(stage.sent);
  abandon();
}

void Sender::abandon() {
  for (Stage& stage : stages_) {
    if (stage.memory) (void)driver_.release_pinned(stage.memory);
    stage = {};
  }
}

}  // namespace heliograph::cuda
