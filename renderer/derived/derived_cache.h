// Derived data (acceleration structures, sampling tables) by the serials of the buffers it was made
// from; shared by all scenes and branches of a backend.
#pragma once

#include <array>
#include <list>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

#include "renderer/base/array.h"
#include "renderer/base/error.h"

namespace heliograph::resident {

enum class Derived : u64 {
  kAccelerator,
  kBounds,
  kParts,
  kMappedParts,
  kDome,
  kTextureMean,
  kVertices,
  kMips,
  kGrid,
  kProfile,
  kPortal,
  kStrands
};

/// Inputs that a piece of derived data is a pure function of.
struct DerivedKey {
  Derived kind;
  std::array<u64, 5> from{};
  friend auto operator<=>(const DerivedKey&, const DerivedKey&) = default;
};

/// The buffers that a value was made from. Without any, it lives while somebody uses it.
using Sources = std::vector<std::weak_ptr<const Buffer>>;

/// Owns: the values. One goes when a source of it is gone; the least recently used go when the
/// bytes exceed the limit and nobody else holds them. Thread: any; values are built outside the
/// lock, of two builders the first one wins.
class DerivedCache {
 public:
  explicit DerivedCache(u64 limit) : limit_(limit) {}

  /// T has `u64 bytes() const`. `build` returns a shared_ptr to T.
  template <class T, class Build>
  std::shared_ptr<const T> get(const DerivedKey& key, Sources sources, Build&& build) {
    if (auto found = find(key)) return std::static_pointer_cast<const T>(found);
    std::shared_ptr<const T> made = build();
    return std::static_pointer_cast<const T>(
        insert({key, made, made->bytes(), std::move(sources)}));
  }
  /// The same where building may fail; what failed is not kept.
  template <class T, class Build>
  Expected<std::shared_ptr<const T>> try_get(const DerivedKey& key, Sources sources,
                                             Build&& build) {
    if (auto found = find(key)) return std::static_pointer_cast<const T>(found);
    Expected<std::shared_ptr<const T>> made = build();
    if (!made) return made;
    return std::static_pointer_cast<const T>(
        insert({key, *made, (*made)->bytes(), std::move(sources)}));
  }
  /// Values to be freed without locks.
  using Gone = std::vector<std::shared_ptr<const void>>;
  /// Takes out what nobody else holds, the least recently used first, until the rest takes no more
  /// than that. The bytes that it takes.
  u64 shrink(u64 bytes, Gone& gone);
  [[nodiscard]] bool contains(const DerivedKey& key) const;
  [[nodiscard]] u64 bytes() const;

 private:
  using Value = std::shared_ptr<const void>;
  struct Entry {
    DerivedKey key;
    Value value;
    u64 bytes;
    Sources sources;
  };
  using Entries = std::list<Entry>;
  Value find(const DerivedKey& key);
  Value insert(Entry entry);
  void sweep(Gone& gone);
  void evict(u64 limit, Gone& gone);
  Entries::iterator erase(Entries::iterator entry, Gone& gone);

  const u64 limit_;
  mutable std::mutex mutex_;
  Entries entries_;  // most recently used first
  std::map<DerivedKey, Entries::iterator> index_;
  u64 bytes_ = 0;
  std::size_t next_sweep_ = 64;  // entries
};

}  // namespace heliograph::resident
