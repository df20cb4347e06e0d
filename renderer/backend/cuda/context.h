// A GPU as this backend uses it: one context, its streams, the programs, memory by the driver's
// pool.
#pragma once

#include <array>
#include <atomic>
#include <span>
#include <string_view>
#include <vector>

#include "renderer/backend/cuda/exports.h"
#include "renderer/backend/cuda/sender.h"

namespace heliograph::cuda {

class Context;

/// Owns: a piece of device memory. Freeing is ordered after the work that is on its way. Thread:
/// any, one at a time.
class DeviceMemory {
 public:
  DeviceMemory() = default;
  /// bytes   that were taken from the context's pool
  DeviceMemory(std::shared_ptr<Context> context, DevicePointer at, u64 bytes)
      : context_(std::move(context)), at_(at), bytes_(bytes) {}
  DeviceMemory(DeviceMemory&& other) noexcept { swap(other); }
  DeviceMemory& operator=(DeviceMemory&& other) noexcept {
    swap(other);
    return *this;
  }
  ~DeviceMemory();
  [[nodiscard]] DevicePointer at() const { return at_; }
  [[nodiscard]] u64 bytes() const { return bytes_; }
  template <class T>
  [[nodiscard]] T* as() const {
    return reinterpret_cast<T*>(at_);
  }

 private:
  void swap(DeviceMemory& other) noexcept {
    std::swap(context_, other.context_);
    std::swap(at_, other.at_);
    std::swap(bytes_, other.bytes_);
  }
  std::shared_ptr<Context> context_;
  DevicePointer at_ = 0;
  u64 bytes_ = 0;
};

/// A copy to the host.
struct Download {
  std::span<std::byte> to;
  DevicePointer from;
};

/// Blocks of threads.
struct LaunchSize {
  u32 blocks;
  u32 threads;
};

/// Queues of work. What lies aside of the other lane goes on at the same time as that.
enum class Lane : u8 { kMain, kAside };

/// Work goes to the device in the order of a lane's calls, the main one's unless stated; calls wait
/// for it where that is stated. Memory comes and goes with the main lane. Errors:
/// RESOURCE_EXHAUSTED without memory, which costs nothing but the call; everything else is
/// UNAVAILABLE, and the context is lost.
/// Thread: any that entered it; downloads and waits are of the device's.
class Context : public std::enable_shared_from_this<Context> {
 public:
  /// Fails with UNAVAILABLE; FAILED_PRECONDITION when no context of this process works any more.
  ///
  /// index    of the device, as the driver counts
  /// budget   bytes of its memory; 0: nine tenths of what is free when the programs are loaded
  [[nodiscard]] static Expected<std::shared_ptr<Context>> create(const Driver& driver, int index,
                                                                 u64 budget = 0);
  ~Context();
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;

  /// Destroys a lost context with all that it had, so that another one finds the device free. After
  /// it what came from it may only be destroyed.
  void abandon();
  /// Makes this the calling thread's context.
  [[nodiscard]] Status enter() const;
  /// Within the budget. RESOURCE_EXHAUSTED states what is needed and what there is.
  [[nodiscard]] Expected<DeviceMemory> allocate(u64 bytes);
  [[nodiscard]] Expected<DeviceMemory> zeroed(u64 bytes);
  /// The bytes may change as soon as it returns.
  [[nodiscard]] Status upload(DevicePointer to, std::span<const std::byte> from);
  [[nodiscard]] Status upload(std::span<const Upload> pieces);
  /// On the device.
  [[nodiscard]] Status copy(DevicePointer to, DevicePointer from, u64 bytes);
  [[nodiscard]] Status fill(DevicePointer at, u8 byte, u64 bytes, Lane lane = Lane::kMain);
  /// Waits.
  [[nodiscard]] Status download(std::span<const Download> pieces, Lane lane = Lane::kMain);
  [[nodiscard]] Status download(std::span<std::byte> to, DevicePointer from,
                                Lane lane = Lane::kMain);
  [[nodiscard]] Status wait();
  /// For the work of every stream.
  [[nodiscard]] Status wait_for_all();
  /// For what others ask of the driver: what nobody uses is given back to it.
  void make_room();
  [[nodiscard]] Expected<FunctionHandle> function(const char* name) const;
  /// arguments   of the program, one after the other
  [[nodiscard]] Status launch(FunctionHandle program, LaunchSize size, std::span<void*> arguments,
                              Lane lane = Lane::kMain);
  /// Makes what comes aside next come after what the main lane has so far.
  [[nodiscard]] Status fork();
  /// Makes what comes next come after what goes on aside. To be called before memory that it uses
  /// is freed; of a lost context nothing goes on. Thread: any, one at a time.
  [[nodiscard]] Status join();

  [[nodiscard]] const std::string& name() const { return name_; }
  /// As the driver counts.
  [[nodiscard]] Device index() const { return index_; }
  [[nodiscard]] StreamHandle stream() const { return stream_; }
  /// True if it is the one context of the process that libraries use by themselves.
  [[nodiscard]] bool is_primary() const { return is_primary_; }
  [[nodiscard]] u32 processors() const { return processors_; }
  [[nodiscard]] MemoryBudget& budget() { return pool_.budget(); }
  [[nodiscard]] const MemoryBudget& budget() const { return pool_.budget(); }
  /// Bytes of all uploads so far. Thread: any.
  [[nodiscard]] u64 uploaded_bytes() const { return uploaded_.load(std::memory_order_relaxed); }
  [[nodiscard]] bool is_lost() const { return lost_.load(std::memory_order_relaxed); }
  [[nodiscard]] ExportDevice export_device() {
    return {driver_, pool_, tenure_, device_, context_, stream_};
  }
  /// Blocks of so many threads that one processor runs at once.
  [[nodiscard]] u32 resident_blocks(FunctionHandle program, u32 threads) const;
  /// Threads of a block, as the program was compiled for.
  [[nodiscard]] Expected<u32> block_threads(FunctionHandle program) const;

 private:
  friend class DeviceMemory;
  explicit Context(const Driver& driver) : driver_(driver) {}
  [[nodiscard]] Status open(int index, u64 budget);
  [[nodiscard]] Status load_programs();
  [[nodiscard]] Status open_context();
  void destroy();
  [[nodiscard]] Status check(Result result, const char* what) const;
  void release(const DeviceMemory& memory);

  /// Memory that the device writes by itself, from where downloads are copied on.
  struct Stage {
    void* memory = nullptr;
    EventHandle written = nullptr;
    std::span<std::byte> to;  // of the copy on its way; empty: none is
  };
  [[nodiscard]] Status finish(Stage& stage);
  /// Makes what `after` does next wait for what `before` was given, which `event` marks as done.
  [[nodiscard]] Status order(StreamHandle before, StreamHandle after, EventHandle event);
  [[nodiscard]] StreamHandle stream_of(Lane lane) const {
    return lane == Lane::kMain ? stream_ : aside_;
  }

  const Driver driver_;
  int index_ = 0;
  Device device_ = 0;
  bool is_primary_ = false;
  ContextHandle context_ = nullptr;
  StreamHandle stream_ = nullptr, aside_ = nullptr;
  EventHandle aside_begins_ = nullptr, aside_ends_ = nullptr;
  std::vector<ModuleHandle> modules_;
  std::array<Stage, 2> stages_;
  Sender sender_{driver_};
  Pool pool_{driver_};
  Tenure tenure_;
  std::string name_;
  u32 processors_ = 0;
  std::atomic<u64> uploaded_{0};
  mutable std::atomic<bool> lost_{false};
  mutable std::atomic<bool> is_sticky_{false};  // lost, and so is what is made after it
};

}  // namespace heliograph::cuda
