// Copies of the host's immutable arrays in device memory, made once for all scenes that have them.
#pragma once

#include <mutex>
#include <unordered_map>
#include <vector>

#include "renderer/backend/cuda/context.h"
#include "renderer/scene/table.h"

namespace heliograph::cuda {

/// Knows the copies that are in use. Thread: any.
class Mirror {
 public:
  /// twins   or null
  explicit Mirror(std::shared_ptr<Context> context, std::shared_ptr<const Twins> twins = nullptr)
      : context_(std::move(context)), twins_(std::move(twins)) {}

  /// A copy of an array that stays where it is, and what it is, for as long as the copy is held.
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> copy(std::span<const std::byte> host);
  /// The same of what make() makes on the device from something that stays as an array does.
  template <class F>
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> made(const void* from, F&& make) {
    if (auto memory = find(from, kMade)) return memory;
    auto made = make();
    if (made) know(from, kMade, *made);
    return made;
  }
  [[nodiscard]] bool has(std::span<const std::byte> host) {
    return find(host.data(), host.size()) != nullptr;
  }
  [[nodiscard]] Context& context() const { return *context_; }
  /// True if bytes of the host have a twin, so that fill() takes them from there.
  [[nodiscard]] bool has_twin(std::span<const std::byte> host) const {
    return twins_ && twins_->has(host);
  }
  /// From their twin, or else from the host.
  [[nodiscard]] Status fill(DevicePointer to, std::span<const std::byte> host) const;

 private:
  struct Known {
    std::size_t bytes;
    std::weak_ptr<const DeviceMemory> memory;
  };
  static constexpr std::size_t kMade = 0;  // of no array
  [[nodiscard]] std::shared_ptr<const DeviceMemory> find(const void* from, std::size_t bytes);
  void know(const void* from, std::size_t bytes, const std::shared_ptr<const DeviceMemory>& memory);

  std::shared_ptr<Context> context_;
  std::shared_ptr<const Twins> twins_;
  std::mutex mutex_;
  std::unordered_multimap<const void*, Known> known_;  // by where the array lies
  std::size_t next_sweep_ = 1024;
};

/// Makes copies and holds them: small ones that nobody else has lie together. They are there once
/// finish() was called; after a failure the pointers mean nothing.
class Copies {
 public:
  explicit Copies(Mirror& mirror) : mirror_(&mirror) {}

  /// Place of the copy of an array that lives as long as these copies.
  template <class T>
  [[nodiscard]] const T* of(const T* host, u64 count) {
    return static_cast<const T*>(shared(std::as_bytes(std::span(host, host ? count : 0))));
  }
  /// The same of an array that does not.
  template <class T>
  [[nodiscard]] const T* of_own(std::span<const T> host) {
    return static_cast<const T*>(own(std::as_bytes(host)));
  }
  /// The same of chunked rows, one after the other.
  template <class T>
  [[nodiscard]] const T* of_own(const ChunkedArray<T>& rows) {
    if (rows.chunk_count() == 1) return of_own(rows.chunk(0));
    return static_cast<const T*>(pieces(pieces_of<T>(rows, nullptr), rows.size() * sizeof(T), 0));
  }
  /// The same where others have as many: of chunks that are not theirs only what differs is sent.
  ///
  /// before   theirs, on the host and on the device
  template <class T>
  [[nodiscard]] const T* of_changed(const ChunkedArray<T>& rows, const ChunkedArray<T>& before_rows,
                                    const T* before) {
    return static_cast<const T*>(
        pieces(pieces_of(rows, &before_rows), rows.size() * sizeof(T), DevicePointer(before)));
  }
  /// Room for what the device makes.
  template <class T>
  [[nodiscard]] T* room(u64 count) {
    return static_cast<T*>(bytes(count * sizeof(T)));
  }
  /// Place of Mirror::made().
  template <class F>
  [[nodiscard]] const DeviceMemory* made(const void* from, F&& make) {
    return status_ ? hold(mirror_->made(from, make)) : nullptr;
  }
  /// Sends what waits to the device, for its next work.
  void send();
  /// A refusal counts what the scene needs beside what was there already, as far as it is known:
  /// what is built on the device is not.
  [[nodiscard]] Status finish();

 private:
  const void* shared(std::span<const std::byte> host);
  void refuse(Error error);
  void count(u64 bytes);
  const void* own(std::span<const std::byte> host);
  void* bytes(u64 size);
  /// Rows that go to a place in an array.
  struct Piece {
    u64 offset;
    std::span<const std::byte> host;
    const std::byte* before;  // what is there, or null
  };
  template <class T>
  static std::vector<Piece> pieces_of(const ChunkedArray<T>& rows, const ChunkedArray<T>* before) {
    std::vector<Piece> made;
    for (u32 c = 0; c < rows.chunk_count(); ++c) {
      if (before && rows.shares(c, *before)) continue;
      const void* theirs = before ? before->chunk(c).data() : nullptr;
      made.push_back({u64(c) * ChunkedArray<T>::kRows * sizeof(T), std::as_bytes(rows.chunk(c)),
                      static_cast<const std::byte*>(theirs)});
    }
    return made;
  }
  /// before   what the array begins as, on the device; 0: nothing
  const void* pieces(const std::vector<Piece>& all, u64 size, DevicePointer before);
  [[nodiscard]] Expected<std::shared_ptr<const DeviceMemory>> allocate(u64 bytes) const;
  const DeviceMemory* hold(Expected<std::shared_ptr<const DeviceMemory>> memory);

  Mirror* mirror_;
  std::vector<std::shared_ptr<const DeviceMemory>> held_;
  DevicePointer chunk_ = 0;          // where small copies go
  std::vector<std::byte> in_chunk_;  // that wait for finish()
  Status status_;
  u64 own_ = 0;  // bytes of those that nobody had before
};

}  // namespace heliograph::cuda
