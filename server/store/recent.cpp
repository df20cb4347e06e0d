// See recent.h.
#include "server/store/recent.h"

namespace heliograph::server {

Recent::Thing Recent::remove(std::map<Key, Place>::iterator place) {
  const auto [list, entry] = place->second;
  Thing thing = std::move(entry->thing);
  if (list == &named_) named_bytes_ -= entry->bytes;
  list->erase(entry);
  places_.erase(place);
  return thing;
}

void Recent::put(Entries& list, Entry entry) {
  if (&list == &named_) named_bytes_ += entry.bytes;
  list.push_back(std::move(entry));
  const auto last = std::prev(list.end());
  places_.emplace(last->key, Place{&list, last});
}

void Recent::let_go(Entries& list, Things& gone) {
  gone.push_back(remove(places_.find(list.front().key)));
}

void Recent::bring(Kind kind, const std::string& name, Thing thing, u64 bytes) {
  Key key{kind, name};
  if (const auto found = places_.find(key); found != places_.end()) (void)remove(found);
  last_brought_ = Clock::now();
  put(brought_, {std::move(key), std::move(thing), bytes, {}});
}

void Recent::use(Kind kind, const std::string& name, Thing thing, u64 bytes) {
  Key key{kind, name};
  if (const auto found = places_.find(key); found != places_.end()) (void)remove(found);
  put(named_, {std::move(key), std::move(thing), bytes, Clock::now()});
}

Recent::Thing Recent::find(Kind kind, const std::string& name) const {
  const auto found = places_.find({kind, name});
  return found == places_.end() ? nullptr : found->second.entry->thing;
}

Recent::Thing Recent::take(Kind kind, const std::string& name) {
  const auto found = places_.find({kind, name});
  return found == places_.end() ? nullptr : remove(found);
}

Recent::Things Recent::sweep(bool is_bringing, Clock::time_point now) {
  const auto grace = std::chrono::seconds(limits_.seconds);
  Things gone;
  if (!is_bringing && last_brought_ + grace < now)
    while (!brought_.empty()) let_go(brought_, gone);
  while (named_.size() > 1 && named_bytes_ > limits_.bytes) let_go(named_, gone);
  while (!named_.empty() && named_.front().named + grace < now) let_go(named_, gone);
  return gone;
}

Recent::Things Recent::forget_named() {
  Things gone;
  while (!named_.empty()) let_go(named_, gone);
  return gone;
}

}  // namespace heliograph::server
