// Bookkeeping of derived data.
#include "renderer/derived/derived_cache.h"

#include <algorithm>

namespace heliograph::resident {

bool DerivedCache::contains(const DerivedKey& key) const {
  const std::scoped_lock lock(mutex_);
  return index_.contains(key);
}

u64 DerivedCache::bytes() const {
  const std::scoped_lock lock(mutex_);
  return bytes_;
}

DerivedCache::Value DerivedCache::find(const DerivedKey& key) {
  const std::scoped_lock lock(mutex_);
  const auto found = index_.find(key);
  if (found == index_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found->second);
  return found->second->value;
}

DerivedCache::Value DerivedCache::insert(Entry entry) {
  Gone gone;
  const std::scoped_lock lock(mutex_);
  if (const auto found = index_.find(entry.key); found != index_.end()) return found->second->value;
  const Value value = entry.value;
  bytes_ += entry.bytes;
  entries_.push_front(std::move(entry));
  index_[entries_.front().key] = entries_.begin();
  if (entries_.size() >= next_sweep_) sweep(gone);
  evict(limit_, gone);
  return value;
}

DerivedCache::Entries::iterator DerivedCache::erase(Entries::iterator entry, Gone& gone) {
  gone.push_back(std::move(entry->value));
  bytes_ -= entry->bytes;
  index_.erase(entry->key);
  return entries_.erase(entry);
}

void DerivedCache::sweep(Gone& gone) {
  for (auto entry = entries_.begin(); entry != entries_.end();) {
    const bool orphan =
        entry->sources.empty()
            ? entry->value.use_count() == 1
            : std::ranges::any_of(entry->sources, [](const auto& s) { return s.expired(); });
    entry = orphan ? erase(entry, gone) : std::next(entry);
  }
  next_sweep_ = std::max<std::size_t>(64, entries_.size() * 5 / 4);
}

u64 DerivedCache::shrink(u64 bytes, Gone& gone) {
  const std::scoped_lock lock(mutex_);
  evict(bytes, gone);
  return bytes_;
}

void DerivedCache::evict(u64 limit, Gone& gone) {
  if (bytes_ > limit) sweep(gone);
  for (auto entry = entries_.end(); bytes_ > limit && entry != entries_.begin();) {
    --entry;
    if (entry->value.use_count() == 1) entry = erase(entry, gone);
  }
}

}  // namespace heliograph::resident
