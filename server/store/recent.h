// What a session brought, until nobody is likely to name it again. Used by Holdings.
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
  u64 seconds = 30;          // after it was brought or named
  u64 bytes = 128ull << 20;  // of all that was named; the last one is kept whatever its size
};

/// Things by kind and name. What was brought and not named yet stays until nothing was brought for
/// the grace time, so that a long row of uploads is there when its edit comes; what was named goes
/// after that time too, and when there is more of it, the longest unnamed first.
/// Thread: one at a time. What is let go is returned, to be freed where that may take its time.
class Recent {
 public:
  using Clock = std::chrono::steady_clock;
  using Thing = std::shared_ptr<const void>;
  using Things = std::vector<Thing>;
  enum class Kind : u8 { kBlob, kUpload, kBuffer, kAsset };

  explicit Recent(RecentLimits limits) : limits_(limits) {}

  /// Brought: nobody named it so far.
  void bring(Kind kind, const std::string& name, Thing thing, u64 bytes);
  /// Named by a call.
  void use(Kind kind, const std::string& name, Thing thing, u64 bytes);
  [[nodiscard]] Thing find(Kind kind, const std::string& name) const;
  /// Removes it.
  [[nodiscard]] Thing take(Kind kind, const std::string& name);

  /// Lets go what is too old, and what of the named is too much. is_bringing: more is on its way.
  [[nodiscard]] Things sweep(bool is_bringing, Clock::time_point now = Clock::now());
  /// Lets go all that was named.
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
  void let_go(Entries& list, Things& gone);  // its first

  const RecentLimits limits_;
  Entries brought_;
  Entries named_;  // the longest unnamed first
  std::map<Key, Place> places_;
  u64 named_bytes_ = 0;
  Clock::time_point last_brought_;
};

}  // namespace heliograph::server
