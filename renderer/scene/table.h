// Chunked copy-on-write rows: a copy shares every chunk, a write clones one. Owned by Snapshots.
#pragma once

#include <algorithm>
#include <cassert>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// A growing array in chunks of 256 rows. Copying costs one pointer a chunk; a chunk that another
/// copy shares is cloned on the first write. Thread: const access from any, writes from one.
template <class T>
class ChunkedArray {
 public:
  static constexpr u32 kRows = 256;

  [[nodiscard]] u32 size() const { return size_; }
  [[nodiscard]] const T& operator[](u32 i) const {
    assert(i < size_);
    return (*chunks_[i / kRows])[i % kRows];
  }
  [[nodiscard]] T& write(u32 i) {
    assert(i < size_);
    auto& chunk = chunks_[i / kRows];
    if (chunk.use_count() > 1) chunk = std::make_shared<Chunk>(*chunk);
    return (*chunk)[i % kRows];
  }
  u32 push_back(T value) {
    if (size_ % kRows == 0) {
      auto chunk = std::make_shared<Chunk>();
      chunk->reserve(kRows);
      chunks_.push_back(std::move(chunk));
    } else if (auto& last = chunks_.back(); last.use_count() > 1) {
      auto clone = std::make_shared<Chunk>();
      clone->reserve(kRows);
      *clone = *last;
      last = std::move(clone);
    }
    chunks_.back()->push_back(std::move(value));
    return size_++;
  }
  /// Calls f(index) for every row in a chunk that `before` does not share.
  template <class F>
  void for_each_changed(const ChunkedArray& before, F&& f) const {
    for (std::size_t c = 0; c < chunks_.size(); ++c) {
      if (c < before.chunks_.size() && before.chunks_[c] == chunks_[c]) continue;
      const u32 first = u32(c) * kRows;
      for (u32 i = 0; i < chunks_[c]->size(); ++i) f(first + i);
    }
  }
  [[nodiscard]] bool same(const ChunkedArray& other) const {
    return size_ == other.size_ && chunks_ == other.chunks_;
  }

  /// So many rows, each chunk of which is to be written before it is read.
  [[nodiscard]] static ChunkedArray unwritten(u32 size) {
    ChunkedArray array;
    array.size_ = size;
    array.chunks_.resize((size + kRows - 1) / kRows);
    return array;
  }
  [[nodiscard]] u32 chunk_count() const { return u32(chunks_.size()); }
  [[nodiscard]] std::span<const T> chunk(u32 c) const { return *chunks_[c]; }
  /// Whether both have a chunk, and it is the same one.
  [[nodiscard]] bool shares(u32 c, const ChunkedArray& other) const {
    return c < chunks_.size() && c < other.chunks_.size() && chunks_[c] == other.chunks_[c];
  }
  /// All rows of a chunk. Thread: several may write chunks, each another.
  [[nodiscard]] std::span<T> write_chunk(u32 c) {
    auto& chunk = chunks_[c];
    if (!chunk)
      chunk = std::make_shared<Chunk>(std::min(kRows, size_ - c * kRows));
    else if (chunk.use_count() > 1)
      chunk = std::make_shared<Chunk>(*chunk);
    return *chunk;
  }

 private:
  using Chunk = std::vector<T>;
  std::vector<std::shared_ptr<Chunk>> chunks_;
  u32 size_ = 0;
};

/// Which ids a table gave out and will give: what makes another table give the same ones.
struct TableIds {
  std::vector<u32> versions;  // by index
  std::vector<u32> order;     // of insertion: the indices alive, ascending, then the free ones
};

/// Rows with versions: an index is used again only under a new version, so stale ids are detected.
template <class T>
class Table {
 public:
  /// A table without rows, whose insertions take these ids. Every index in `order` is below the
  /// number of versions, and there once.
  [[nodiscard]] static Table reserved(const TableIds& ids) {
    Table table;
    for (const u32 version : ids.versions) table.slots_.push_back({.version = version});
    for (auto index = ids.order.rbegin(); index != ids.order.rend(); ++index)
      table.slots_.write(*index).next_free = std::exchange(table.free_, *index);
    return table;
  }
  [[nodiscard]] TableIds ids() const {
    TableIds ids;
    for (u32 i = 0; i < slots_.size(); ++i) {
      ids.versions.push_back(slots_[i].version);
      if (slots_[i].alive) ids.order.push_back(i);
    }
    for (u32 i = free_; i != kNone; i = slots_[i].next_free) ids.order.push_back(i);
    return ids;
  }
  /// The row, or nullptr when the id is stale or unknown.
  [[nodiscard]] const T* find(u32 version, u32 index) const {
    if (index >= slots_.size()) return nullptr;
    const Slot& slot = slots_[index];
    return slot.alive && slot.version == version ? &slot.value : nullptr;
  }
  /// The row at an index that is alive.
  [[nodiscard]] const T& at(u32 index) const {
    assert(alive(index));
    return slots_[index].value;
  }
  [[nodiscard]] bool alive(u32 index) const { return index < slots_.size() && slots_[index].alive; }
  [[nodiscard]] u32 version(u32 index) const { return slots_[index].version; }
  [[nodiscard]] T& write(u32 index) {
    assert(alive(index));
    return slots_.write(index).value;
  }
  /// The index of the new row; its version is version(index).
  u32 insert(T value) {
    ++count_;
    if (free_ == kNone) return slots_.push_back({1, true, kNone, std::move(value)});
    const u32 index = free_;
    Slot& slot = slots_.write(index);
    free_ = slot.next_free;
    slot.alive = true;
    slot.value = std::move(value);
    return index;
  }
  void erase(u32 index) {
    assert(alive(index));
    Slot& slot = slots_.write(index);
    slot.alive = false;
    slot.value = T{};
    --count_;
    if (slot.version == kLastVersion) return;  // its ids are used up: the index retires
    ++slot.version;
    slot.next_free = free_;
    free_ = index;
  }
  [[nodiscard]] u32 count() const { return count_; }            // rows alive
  [[nodiscard]] u32 capacity() const { return slots_.size(); }  // indices are below it
  template <class F>
  void for_each(F&& f) const {  // f(index, row), in index order
    for (u32 i = 0; i < slots_.size(); ++i)
      if (slots_[i].alive) f(i, slots_[i].value);
  }
  /// f(index) for every index, alive or not, in a chunk that `before` does not share.
  template <class F>
  void for_each_changed(const Table& before, F&& f) const {
    slots_.for_each_changed(before.slots_, f);
  }
  [[nodiscard]] bool same(const Table& other) const { return slots_.same(other.slots_); }
  [[nodiscard]] u32 chunk_count() const { return slots_.chunk_count(); }
  /// Whether the rows of a chunk, of as many as ChunkedArray has, are the same ones.
  [[nodiscard]] bool shares(u32 c, const Table& other) const {
    return slots_.shares(c, other.slots_);
  }

 private:
  static constexpr u32 kNone = ~0u;
  static constexpr u32 kLastVersion = 0xffffff;  // ids have 24 bits for it
  struct Slot {
    u32 version = 1;
    bool alive = false;
    u32 next_free = kNone;
    T value{};
  };
  ChunkedArray<Slot> slots_;
  u32 free_ = kNone;
  u32 count_ = 0;
};

}  // namespace heliograph
