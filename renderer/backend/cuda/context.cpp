#include "renderer/backend/cuda/context.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>

#include "renderer/backend/cuda/programs.h"
#include "renderer/base/parallel.h"

namespace heliograph::cuda {
namespace {

constexpr unsigned kNonBlocking = 1;   // CU_STREAM_NON_BLOCKING
constexpr unsigned kScheduleAuto = 0;  // CU_CTX_SCHED_AUTO: waits spin where there are cores
constexpr unsigned kNoTiming = 2;      // CU_EVENT_DISABLE_TIMING
constexpr u64 kStageBytes = 4 << 20;
// The driver takes pieces of this size at once; for larger ones it waits until the device gets to
// them. What has many goes through pinned memory.
constexpr u64 kPiece = 64 << 10;
constexpr u64 kFewBytes = 1 << 20;     // less is not worth many threads
constexpr u64 kCopyGrain = 256 << 10;  // bytes of a thread's share

}  // namespace

DeviceMemory::~DeviceMemory() {
  if (at_) context_->release(*this);
}

Expected<std::shared_ptr<Context>> Context::create(const Driver& driver, int index, u64 budget) {
  std::shared_ptr<Context> context(new Context(driver));
  Status opened = context->open(index, budget);
  if (opened) return context;
  if (context->is_sticky_) opened.error().code = Code::kFailedPrecondition;
  return std::unexpected(std::move(opened).error());
}

Status Context::open(int index, u64 budget) {
  int devices = 0;
  index_ = index;
  HELIO_TRY(check(driver_.device_count(&devices), "counting GPUs"));
  if (index >= devices)
    return fail(Code::kUnavailable, "backend",
                fmt::format("there is no GPU {}; the driver shows {}", index, devices));
  HELIO_TRY(check(driver_.device_at(&device_, index), "opening the GPU"));
  char name[256] = {};
  HELIO_TRY(check(driver_.device_name(name, sizeof name, device_), "asking for the GPU's name"));
  const auto attribute = [&](Attribute which) {
    int value = 0;
    (void)driver_.device_attribute(&value, int(which), device_);
    return value;
  };
  name_ =
      fmt::format("{} sm_{}{}", name, attribute(Attribute::kMajor), attribute(Attribute::kMinor));
  processors_ = u32(attribute(Attribute::kProcessors));
  HELIO_TRY(open_context());
  for (StreamHandle* stream : {&stream_, &aside_})
    HELIO_TRY(check(driver_.create_stream(stream, kNonBlocking), "making a stream"));
  for (EventHandle* event : {&aside_begins_, &aside_ends_})
    HELIO_TRY(check(driver_.create_event(event, kNoTiming), "making an event"));
  HELIO_TRY(check(pool_.open({device_, context_, stream_}), "opening the memory pool"));
  for (Stage& stage : stages_) {
    HELIO_TRY(check(driver_.allocate_pinned(&stage.memory, kStageBytes, 0), "a copy's memory"));
    HELIO_TRY(check(driver_.create_event(&stage.written, kNoTiming), "making an event"));
  }
  HELIO_TRY(load_programs());
  std::size_t free = 0, total = 0;
  HELIO_TRY(check(driver_.memory_info(&free, &total), "asking for the GPU's memory"));
  pool_.budget().set_bytes(budget > 0 ? budget : free / 10 * 9);
  return {};
}

Status Context::load_programs() {
  for (const std::byte* program : programs()) {
    ModuleHandle module = nullptr;
    HELIO_TRY(check(driver_.load_module(&module, program), "loading the GPU programs"));
    modules_.push_back(module);
  }
  return {};
}

/// The primary context, unless somebody else of this process has it.
Status Context::open_context() {
  unsigned flags = 0;
  int is_taken = 0;
  HELIO_TRY(check(driver_.primary_state(device_, &flags, &is_taken), "asking for contexts"));
  if (is_taken)
    return check(driver_.create_context(&context_, kScheduleAuto, device_), "making a context");
  HELIO_TRY(check(driver_.retain_primary(&context_, device_), "making a context"));
  is_primary_ = true;
  return enter();
}

Context::~Context() {
  if (!context_) return;
  (void)driver_.set_context(context_);
  for (StreamHandle stream : {aside_, stream_})
    if (stream) (void)driver_.wait_for_stream(stream);
  for (Stage& stage : stages_) {
    if (stage.written) (void)driver_.destroy_event(stage.written);
    if (stage.memory) (void)driver_.release_pinned(stage.memory);
  }
  sender_.close();
  for (ModuleHandle module : modules_) (void)driver_.unload_module(module);
  for (EventHandle event : {aside_begins_, aside_ends_})
    if (event) (void)driver_.destroy_event(event);
  for (StreamHandle stream : {aside_, stream_})
    if (stream) (void)driver_.destroy_stream(stream);
  destroy();
}

/// A lost one goes even where a library has it, too: it is of use to nobody.
void Context::destroy() {
  if (!is_primary_)
    (void)driver_.destroy_context(context_);
  else
    (void)(is_lost() ? driver_.reset_primary(device_) : driver_.release_primary(device_));
}

/// The pool is the device's: what it gave a context it keeps when that is gone, and takes back from
/// another one. Where none can be made, nothing can be rendered either, and the process ends.
void Context::abandon() {
  tenure_.end();
  const std::vector<DevicePointer> left = pool_.close();
  for (Stage& stage : stages_) (void)driver_.release_pinned(std::exchange(stage.memory, nullptr));
  sender_.abandon();
  destroy();
  context_ = nullptr;
  ContextHandle other = nullptr;
  if (driver_.create_context(&other, kScheduleAuto, device_) != 0) return;
  for (const DevicePointer at : left) (void)driver_.release(at, nullptr);
  (void)driver_.wait_for_stream(nullptr);
  (void)driver_.trim_pool(pool_.handle(), 0);
  (void)driver_.destroy_context(other);
}

Status Context::check(Result result, const char* what) const {
  if (result == 0) return {};
  if (result == kOutOfMemory)
    return fail(
        Code::kResourceExhausted, "",
        fmt::format("the GPU has no memory left for {}; render smaller images or scenes", what));
  lost_ = true;
  if (is_sticky(result)) is_sticky_ = true;
  return fail(Code::kUnavailable, "", fmt::format("{} failed: {}", what, driver_.describe(result)));
}

Status Context::enter() const { return check(driver_.set_context(context_), "entering the GPU"); }

Expected<DeviceMemory> Context::allocate(u64 bytes) {
  if (bytes == 0) return DeviceMemory();
  HELIO_TRY(pool_.take(bytes));
  DevicePointer at = 0;
  const Result result = pool_.allocate(&at, bytes);
  if (result == 0) return DeviceMemory(shared_from_this(), at, bytes);
  pool_.give_back(bytes);
  std::size_t free = 0, total = 0;
  if (result == kOutOfMemory && driver_.memory_info(&free, &total) == 0)
    return std::unexpected(no_device_memory(bytes, free));
  return std::unexpected(check(result, "a buffer").error());
}

Expected<DeviceMemory> Context::zeroed(u64 bytes) {
  auto memory = allocate(bytes);
  if (memory && bytes > 0) HELIO_TRY(fill(memory->at(), 0, bytes));
  return memory;
}

void Context::release(const DeviceMemory& memory) { pool_.release(memory.at(), memory.bytes()); }

Status Context::upload(DevicePointer to, std::span<const std::byte> from) {
  if (from.size() >= kFewBytes) {
    const Upload all{to, from};
    return upload(std::span(&all, 1));
  }
  uploaded_.fetch_add(from.size(), std::memory_order_relaxed);
  for (u64 begin = 0; begin < from.size(); begin += kPiece) {
    const auto piece = from.subspan(begin, std::min<u64>(kPiece, from.size() - begin));
    HELIO_TRY(check(driver_.upload(to + begin, piece.data(), piece.size(), stream_), "an upload"));
  }
  return {};
}

Status Context::upload(std::span<const Upload> pieces) {
  u64 bytes = 0;
  for (const Upload& piece : pieces) bytes += piece.from.size();
  if (bytes < kFewBytes) {
    for (const Upload& piece : pieces) HELIO_TRY(upload(piece.to, piece.from));
    return {};
  }
  uploaded_.fetch_add(bytes, std::memory_order_relaxed);
  return check(sender_.send(pieces, stream_), "an upload");
}

Status Context::copy(DevicePointer to, DevicePointer from, u64 bytes) {
  return check(driver_.copy(to, from, bytes, stream_), "a copy");
}

Status Context::fill(DevicePointer at, u8 byte, u64 bytes, Lane lane) {
  return check(driver_.fill(at, byte, bytes, stream_of(lane)), "filling memory");
}

Status Context::download(std::span<const Download> pieces, Lane lane) {
  const StreamHandle stream = stream_of(lane);
  u32 next = 0;
  for (const Download& piece : pieces) {
    for (u64 begin = 0; begin < piece.to.size(); begin += kStageBytes) {
      Stage& stage = stages_[next++ % stages_.size()];
      HELIO_TRY(finish(stage));
      const u64 bytes = std::min(kStageBytes, piece.to.size() - begin);
      HELIO_TRY(
          check(driver_.download(stage.memory, piece.from + begin, bytes, stream), "a download"));
      HELIO_TRY(check(driver_.record_event(stage.written, stream), "a download"));
      stage.to = piece.to.subspan(begin, bytes);
    }
  }
  for (u32 i = 0; i < stages_.size(); ++i) HELIO_TRY(finish(stages_[next++ % stages_.size()]));
  return {};
}

Status Context::download(std::span<std::byte> to, DevicePointer from, Lane lane) {
  const Download piece{to, from};
  return download(std::span(&piece, 1), lane);
}

Status Context::finish(Stage& stage) {
  const auto to = std::exchange(stage.to, {});
  if (to.empty()) return {};
  HELIO_TRY(check(driver_.wait_for_event(stage.written), "work on the GPU"));
  const auto* from = static_cast<const std::byte*>(stage.memory);
  parallel_ranges(to.size(), kCopyGrain, [&](u64 begin, u64 end) {
    std::memcpy(to.data() + begin, from + begin, end - begin);
  });
  return {};
}

Status Context::wait() { return check(driver_.wait_for_stream(stream_), "work on the GPU"); }

Status Context::wait_for_all() { return check(driver_.wait_for_context(), "work on the GPU"); }

void Context::make_room() {
  pool_.budget().give_up();
  pool_.trim();
}

Expected<FunctionHandle> Context::function(const char* name) const {
  FunctionHandle function = nullptr;
  for (ModuleHandle module : modules_)
    if (driver_.function_in(&function, module, name) == 0) return function;
  return fail(Code::kUnavailable, "backend",
              fmt::format("this daemon was built without the GPU program {}", name));
}

Status Context::fork() { return order(stream_, aside_, aside_begins_); }

Status Context::join() {
  if (is_lost()) return {};
  HELIO_TRY(enter());
  return order(aside_, stream_, aside_ends_);
}

Status Context::order(StreamHandle before, StreamHandle after, EventHandle event) {
  HELIO_TRY(check(driver_.record_event(event, before), "ordering work on the GPU"));
  return check(driver_.let_stream_wait(after, event, 0), "ordering work on the GPU");
}

Status Context::launch(FunctionHandle program, LaunchSize size, std::span<void*> arguments,
                       Lane lane) {
  if (size.blocks == 0) return {};
  return check(driver_.launch(program, size.blocks, 1, 1, size.threads, 1, 1, 0, stream_of(lane),
                              arguments.data(), nullptr),
               "starting work on the GPU");
}

Expected<u32> Context::block_threads(FunctionHandle program) const {
  int threads = 0;
  HELIO_TRY(check(driver_.function_attribute(&threads, kMostThreads, program),
                  "asking for a program's block"));
  return u32(threads);
}

u32 Context::resident_blocks(FunctionHandle program, u32 threads) const {
  int blocks = 0;
  (void)driver_.blocks_per_processor(&blocks, program, int(threads), 0);
  return u32(std::max(blocks, 1));
}

}  // namespace heliograph::cuda
