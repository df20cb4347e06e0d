// Cache of what a session brought (uploads, decoded assets) and recently named. Used by
// SessionArrays.
#pragma once

#include <chrono>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph::server {

struct RecentLimits {
  u64 seconds = 30;          // grace time after it was brought or named
  u64 bytes = 128ull << 20;  // of everything named; the last one is kept whatever its size
};

/// Things by kind and name. A brought thing that was not named yet stays until nothing was brought
/// for the grace time, so that a long series of uploads is complete when its edit comes. A named
/// thing goes after the grace time, and least recently named first when `bytes` is exceeded.
/// Evicted things are returned, so that the caller frees them where that may take long. Thread: one
/// at a time.
class Recent {
 public:
  using Clock = std::chrono::steady_clock;
  using Thing = std::shared_ptr<const void>;
  using Things = std::vector<Thing>;
  enum class Kind : u8 { kBlob, kUpload, kBuffer, kAsset };

  explicit Recent(RecentLimits limits) : limits_(limits) {}

  /// Adds a thing that no call has named yet.
  void bring(Kind kind, const std::string& name, Thing thing, u64 bytes);
  /// Records that a call named a thing.
  void use(Kind kind, const std::string& name, Thing thing, u64 bytes);
  [[nodiscard]] Thing find(Kind kind, const std::string& name) const;
  /// Removes a thing.
  [[nodiscard]] Thing take(Kind kind, const std::string& name);

  /// Evicts things that are too old, and named ones beyond `bytes`. is_bringing: an upload is in
  /// progress.
  [[nodiscard]] Things sweep(bool is_bringing, Clock::time_point now = Clock::now());
  /// Evicts everything named.
  [[nodiscard]] Things forget_named();

 private:
  using Key = std::pair<Kind, std::string>;
  struct Entry {
    Key key;
    Thing thing;
    u64 bytes;
    Clock::time_point named;
  };
  using Entries = std::list<Entry>;
  struct Place {
    Entries* list;
    Entries::iterator entry;
  };
  void put(Entries& list, Entry entry);
  [[nodiscard]] Thing remove(std::map<Key, Place>::iterator place);
  void let_go(Entries& list, Things& gone);  // evicts the first

  const RecentLimits limits_;
  Entries brought_;
  Entries named_;  // least recently named first
  std::map<Key, Place> places_;
  u64 named_bytes_ = 0;
  Clock::time_point last_brought_;
};

}  // namespace heliograph::server
