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
    return chunks_[i / kRows]->rows()[i % kRows];
  }
  [[nodiscard]] T& write(u32 i) {
    assert(i < size_);
    return own(i / kRows)[i % kRows];
  }
  u32 push_back(T value) {
    if (size_ % kRows == 0) chunks_.push_back(std::make_shared<Chunk>());
    own_chunk(size_ / kRows).push_back(std::move(value));
    return size_++;
  }
  /// Calls f(index) for every row in a chunk that `before` does not share.
  template <class F>
  void for_each_changed(const ChunkedArray& before, F&& f) const {
    for (std::size_t c = 0; c < chunks_.size(); ++c) {
      if (c < before.chunks_.size() && before.chunks_[c] == chunks_[c]) continue;
      const u32 first = u32(c) * kRows;
      for (u32 i = 0; i < chunks_[c]->rows().size(); ++i) f(first + i);
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
  [[nodiscard]] std::span<const T> chunk(u32 c) const { return chunks_[c]->rows(); }
  /// True if both have a chunk, and it is the same one.
  [[nodiscard]] bool shares(u32 c, const ChunkedArray& other) const {
    return c < chunks_.size() && c < other.chunks_.size() && chunks_[c] == other.chunks_[c];
  }
  /// All rows of a chunk. Thread: several may write chunks, each another.
  [[nodiscard]] std::span<T> write_chunk(u32 c) {
    if (!chunks_[c])
      chunks_[c] = std::make_shared<Chunk>(std::vector<T>(std::min(kRows, size_ - c * kRows)));
    return own(c);
  }
  /// From now on another array's chunk, of as many rows, is this one's too.
  void share_chunk(u32 c, const ChunkedArray& other) { chunks_[c] = other.chunks_[c]; }
  /// The same as write_chunk(), of which these are the new values: as many as the chunk has.
  void put_chunk(u32 c, std::span<const T> rows) {
    chunks_[c] = std::make_shared<Chunk>(std::vector<T>(rows.begin(), rows.end()));
  }
  /// The same, of rows that stay as long as their owner does: without a copy.
  void put_chunk(u32 c, std::span<const T> rows, std::shared_ptr<const void> owner) {
    chunks_[c] = std::make_shared<Chunk>(rows, std::move(owner));
  }

 private:
  /// Rows of its own, or another's, which nobody writes.
  class Chunk {
   public:
    Chunk() = default;
    explicit Chunk(std::vector<T> rows) : own_(std::move(rows)), rows_(own_) {}
    Chunk(std::span<const T> rows, std::shared_ptr<const void> owner)
        : owner_(std::move(owner)), rows_(rows) {}
    Chunk(const Chunk&) = delete;
    Chunk& operator=(const Chunk&) = delete;
    [[nodiscard]] std::span<const T> rows() const { return rows_; }
    [[nodiscard]] bool is_own() const { return !owner_; }
    [[nodiscard]] std::span<T> own() { return own_; }
    void push_back(T value) {
      own_.reserve(kRows);
      own_.push_back(std::move(value));
      rows_ = own_;
    }

   private:
    std::vector<T> own_;
    std::shared_ptr<const void> owner_;  // null: the rows are its own
    std::span<const T> rows_;
  };
  /// The chunk, which nobody else has from now on.
  Chunk& own_chunk(u32 c) {
    auto& chunk = chunks_[c];
    if (chunk.use_count() > 1 || !chunk->is_own())
      chunk = std::make_shared<Chunk>(std::vector<T>(chunk->rows().begin(), chunk->rows().end()));
    return *chunk;
  }
  std::span<T> own(u32 c) { return own_chunk(c).own(); }

  std::vector<std::shared_ptr<Chunk>> chunks_;
  u32 size_ = 0;
};

/// Ids that a table gave out and will give: what makes another table give the same ones.
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
    for (const u32 version : ids.versions) table.push_back({version, kNone}, {});
    for (auto index = ids.order.rbegin(); index != ids.order.rend(); ++index)
      table.heads_.write(*index).next_free = std::exchange(table.free_, *index);
    return table;
  }
  [[nodiscard]] TableIds ids() const {
    TableIds ids;
    for (u32 i = 0; i < capacity(); ++i) {
      ids.versions.push_back(version(i));
      if (alive(i)) ids.order.push_back(i);
    }
    for (u32 i = free_; i != kNone; i = heads_[i].next_free) ids.order.push_back(i);
    return ids;
  }
  /// True if the id is neither stale nor unknown. Reads nothing of the row.
  [[nodiscard]] bool has(u32 version, u32 index) const {
    return alive(index) && heads_[index].version == version;
  }
  /// The row, or nullptr when the id is stale or unknown.
  [[nodiscard]] const T* find(u32 version, u32 index) const {
    return has(version, index) ? &rows_[index] : nullptr;
  }
  /// The row at an index that is alive.
  [[nodiscard]] const T& at(u32 index) const {
    assert(alive(index));
    return rows_[index];
  }
  [[nodiscard]] bool alive(u32 index) const {
    return index < capacity() && heads_[index].next_free == kAlive;
  }
  [[nodiscard]] u32 version(u32 index) const { return heads_[index].version; }
  [[nodiscard]] T& write(u32 index) {
    assert(alive(index));
    return rows_.write(index);
  }
  /// The index of the new row; its version is version(index).
  u32 insert(T value) {
    ++count_;
    if (free_ == kNone) return push_back({1, kAlive}, std::move(value));
    const u32 index = free_;
    free_ = std::exchange(heads_.write(index).next_free, kAlive);
    rows_.write(index) = std::move(value);
    return index;
  }
  void erase(u32 index) {
    assert(alive(index));
    Head& head = heads_.write(index);
    rows_.write(index) = T{};
    --count_;
    if (head.version == kLastVersion) {  // its ids are used up: the index retires
      head.next_free = kNone;
      return;
    }
    ++head.version;
    head.next_free = std::exchange(free_, index);
  }
  [[nodiscard]] u32 count() const { return count_; }            // rows alive
  [[nodiscard]] u32 capacity() const { return heads_.size(); }  // indices are below it
  template <class F>
  void for_each(F&& f) const {  // f(index, row), in index order
    for (u32 i = 0; i < capacity(); ++i)
      if (alive(i)) f(i, rows_[i]);
  }
  // Whatever changes a head writes its row too, so rows alone show what changed.
  /// f(index) for every index, alive or not, in a chunk that `before` does not share.
  template <class F>
  void for_each_changed(const Table& before, F&& f) const {
    rows_.for_each_changed(before.rows_, f);
  }
  [[nodiscard]] bool same(const Table& other) const { return rows_.same(other.rows_); }
  [[nodiscard]] u32 chunk_count() const { return rows_.chunk_count(); }
  /// True if the rows of a chunk, of as many as ChunkedArray has, are the same ones.
  [[nodiscard]] bool shares(u32 c, const Table& other) const {
    return rows_.shares(c, other.rows_);
  }

 private:
  static constexpr u32 kNone = ~0u;
  static constexpr u32 kAlive = kNone - 1;
  static constexpr u32 kLastVersion = 0xffffff;  // ids have 24 bits for it
  struct Head {
    u32 version = 1;
    u32 next_free = kNone;  // or kAlive
  };
  u32 push_back(Head head, T value) {
    heads_.push_back(head);
    return rows_.push_back(std::move(value));
  }

  ChunkedArray<Head> heads_;
  ChunkedArray<T> rows_;
  u32 free_ = kNone;
  u32 count_ = 0;
};

}  // namespace heliograph
