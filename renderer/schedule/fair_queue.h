// Who runs next on one of several devices: weighted fair queuing. The order only; the engine has
// the lock and the clock.
#pragma once

#include <algorithm>
#include <iterator>
#include <list>
#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "renderer/frame/job.h"

namespace heliograph {

/// Work that waits or runs, in a tree of shares: tenants, in each its lanes, in each its sessions,
/// in each its scenes, in each a line. Start-time fair queuing (Goyal, Vin and Cheng 1996) at each
/// level: the child that used least for its weight goes first, and one that comes back after it had
/// nothing to do starts where the others are, less `credit`. So who asks for less than its share is
/// served at once, and nobody saves up more than the credit. Among equals the one that was served
/// goes on until it is a `turn` ahead, as what it works on is in the caches; one that used less,
/// and `little` since it came, does not wait for that.
///
/// A lane is a priority, and whether the work is short (labels, queries): a higher priority goes
/// first always; short work shares evenly with long work, whatever the number of long jobs.
///
/// T is movable. Thread: one at a time.
template <class T>
class FairQueue {
  struct Share;

 public:
  /// An item whose turn it is, which stays in the queue. Lifetime: until it is popped or taken.
  class Turn {
   public:
    [[nodiscard]] T& item() const { return *item_; }

   private:
    friend FairQueue;
    Turn(Share* line, typename std::list<T>::iterator item) : line_(line), item_(item) {}
    Share* line_;
    typename std::list<T>::iterator item_;
  };

  /// Seconds of the device.
  FairQueue(double credit, double turn, double little)
      : credit_(credit), turn_(turn), little_(little) {}

  /// first   it was here before: it goes before what its scene has, and brings no credit from where
  ///         others worked for it
  /// Returns whether nothing of its scene is before it.
  bool push(const Origin& origin, bool is_short, T item, bool first = false) {
    Share* tenant = child(root_, origin.tenant);
    tenant->weight = origin.weight;
    Share* lane = child(*tenant, lane_key(origin.priority, is_short));
    lane->rank = origin.priority;
    Share* session = child(*lane, origin.session);
    Share* line = child(*session, origin.scene);
    for (Share* share : {tenant, lane, session, line}) {
      if (share->count++ > 0) continue;
      share->used = std::max(share->used, share->parent->reached - (first ? 0 : credit_));
      share->is_served = false;  // its turn ended when it left
      share->came = share->used;
    }
    ++root_.count;
    const bool is_next = first || line->items.empty();
    line->items.insert(first ? line->items.begin() : line->items.end(), std::move(item));
    return is_next;
  }

  [[nodiscard]] bool empty() const { return root_.count == 0; }
  [[nodiscard]] std::size_t size() const { return root_.count; }

  /// Turn of the next among those of which `may(item)` holds, if there is one.
  template <class May>
  [[nodiscard]] std::optional<Turn> next(const May& may) {
    return next_in(root_, may);
  }

  /// Charges the cost of a turn, in seconds of the device.
  void charge(const Turn& turn, double cost) {
    for (Share* share = turn.line_; share != &root_; share = share->parent)
      share->used += cost / share->weight;
  }

  T pop(const Turn& turn) {
    T item = std::move(*turn.item_);
    turn.line_->items.erase(turn.item_);
    left(turn.line_, 1);
    forget(root_);
    return item;
  }

  /// Takes out everything for which `wanted(item)` holds.
  template <class Wanted>
  [[nodiscard]] std::vector<T> take_if(const Wanted& wanted) {
    std::vector<T> taken;
    take_from(root_, wanted, taken);
    if (!taken.empty()) forget(root_);
    return taken;
  }

 private:
  struct Share {
    Share* parent = nullptr;
    i32 rank = 0;
    double weight = 1;
    double used = 0;     // cost over weight: its virtual time
    double came = 0;     // the same when it last began to have something to do
    double reached = 0;  // the virtual time of its children
    std::size_t count = 0;
    bool is_served = false;  // the last of its parent's children to be
    std::map<u64, Share> children;
    std::list<T> items;  // of a line
  };

  static u64 lane_key(i32 priority, bool is_short) {
    return 2 * u64(i64(priority) + (i64(1) << 31)) + (is_short ? 1 : 0);
  }
  static Share* child(Share& parent, u64 key) {
    Share& found = parent.children[key];
    found.parent = &parent;
    return &found;
  }
  /// Amount that it used, less the turn that it may finish.
  [[nodiscard]] double place(const Share& share) const {
    return share.used - (share.is_served ? turn_ / share.weight : 0);
  }
  [[nodiscard]] bool goes_before(const Share& a, const Share& b) const {
    return a.rank != b.rank ? a.rank > b.rank : place(a) < place(b);
  }
  /// Puts who has had little yet, and used less, before whose turn it is. Sorted.
  void let_in(std::vector<Share*>& waiting) const {
    if (waiting.empty() || !waiting.front()->is_served) return;
    const Share& served = *waiting.front();
    const auto first = std::ranges::find_if(waiting, [&](const Share* each) {
      return each->used - each->came <= little_ / each->weight && each->rank == served.rank &&
             each->used < served.used;
    });
    if (first != waiting.end()) std::rotate(waiting.begin(), first, first + 1);
  }
  template <class May>
  std::optional<Turn> next_in(Share& share, const May& may) {
    if (share.children.empty()) {
      const auto found = std::ranges::find_if(share.items, may);
      return found == share.items.end() ? std::nullopt : std::optional(Turn(&share, found));
    }
    std::vector<Share*> waiting;
    for (auto& [key, each] : share.children)
      if (each.count > 0) waiting.push_back(&each);
    std::ranges::stable_sort(waiting,
                             [&](const Share* a, const Share* b) { return goes_before(*a, *b); });
    let_in(waiting);
    for (Share* each : waiting) {
      const auto found = next_in(*each, may);
      if (!found) continue;
      share.reached = std::max(share.reached, each->used);
      for (auto& [key, other] : share.children) other.is_served = &other == each;
      return found;
    }
    return std::nullopt;
  }
  static void left(Share* line, std::size_t count) {
    for (Share* share = line; share != nullptr; share = share->parent) share->count -= count;
  }
  template <class Wanted>
  static void take_from(Share& share, const Wanted& wanted, std::vector<T>& taken) {
    for (auto& [key, each] : share.children) take_from(each, wanted, taken);
    const std::size_t before = share.items.size();
    std::erase_if(share.items, [&](T& item) {
      if (!wanted(item)) return false;
      taken.push_back(std::move(item));
      return true;
    });
    left(&share, before - share.items.size());
  }
  /// Drops shares that would start like new ones: beneath one that has nothing to do all are equal.
  void forget(Share& share) {
    if (share.count == 0) return share.children.clear();
    for (auto each = share.children.begin(); each != share.children.end();) {
      Share& one = each->second;
      forget(one);
      const bool is_new = one.count == 0 && one.used <= share.reached - credit_;
      each = is_new ? share.children.erase(each) : std::next(each);
    }
  }

  const double credit_, turn_, little_;
  Share root_;
};

}  // namespace heliograph
