// A persistent hash map: a copy is one pointer, and a change clones only what a copy shares.
// Names and labels of a Snapshot live here.
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// Source: Bagwell 2001, "Ideal Hash Trees", with a fan-out of 32 and small sorted buckets at the
/// leaves. The tree and its iteration order depend on the keys only, never on history.
/// Thread: const access from any, writes from one.
template <class K, class V, class Hash = std::hash<K>>
class PersistentMap {
 public:
  [[nodiscard]] const V* find(const K& key) const {
    const u64 h = hash(key);
    const Node* node = root_.get();
    for (u32 level = 0; node && !node->leaf(); ++level) node = node->children[slot(h, level)].get();
    if (!node) return nullptr;
    const auto entry = std::ranges::lower_bound(node->entries, key, {}, &Entry::first);
    return entry != node->entries.end() && entry->first == key ? &entry->second : nullptr;
  }
  void set(const K& key, V value) { insert(root_, hash(key), 0, {key, std::move(value)}); }
  void erase(const K& key) {
    if (find(key)) remove(root_, hash(key), 0, key);
  }
  [[nodiscard]] u32 size() const { return root_ ? root_->count : 0; }
  /// f(key, value) for all of them.
  template <class F>
  void for_each(F&& f) const {
    visit(root_.get(), f);
  }

 private:
  static constexpr u32 kFan = 32;
  static constexpr u32 kBucket = 8;     // a node of more entries has children
  static constexpr u32 kMaxLevel = 12;  // below it, equal hashes share a leaf
  using Entry = std::pair<K, V>;
  struct Node;
  using NodePtr = std::shared_ptr<Node>;
  struct Node {
    u32 count = 0;                  // entries here and beneath
    std::vector<Entry> entries;     // leaf: sorted by key
    std::vector<NodePtr> children;  // inner: kFan, some null

    [[nodiscard]] bool leaf() const { return children.empty(); }
  };

  static u64 hash(const K& key) {  // splitmix64's finaliser
    u64 x = Hash{}(key);
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
  }
  static u32 slot(u64 h, u32 level) { return u32(h >> (5 * level)) & (kFan - 1); }

  /// The node for writing: cloned when a copy shares it.
  static Node& own(NodePtr& node) {
    if (!node)
      node = std::make_shared<Node>();
    else if (node.use_count() > 1)
      node = std::make_shared<Node>(*node);
    return *node;
  }

  static bool insert(NodePtr& shared, u64 h, u32 level, Entry entry) {
    Node& node = own(shared);
    if (!node.leaf()) {
      const bool added = insert(node.children[slot(h, level)], h, level + 1, std::move(entry));
      node.count += added;
      return added;
    }
    const auto place = std::ranges::lower_bound(node.entries, entry.first, {}, &Entry::first);
    if (place != node.entries.end() && place->first == entry.first) {
      place->second = std::move(entry.second);
      return false;
    }
    node.entries.insert(place, std::move(entry));
    ++node.count;
    if (node.count > kBucket && level < kMaxLevel) split(node, level);
    return true;
  }
  static void split(Node& node, u32 level) {
    node.children.resize(kFan);
    for (Entry& entry : std::exchange(node.entries, {})) {
      const u64 h = hash(entry.first);
      insert(node.children[slot(h, level)], h, level + 1, std::move(entry));
    }
  }

  /// Removes a key that is there.
  static void remove(NodePtr& shared, u64 h, u32 level, const K& key) {
    Node& node = own(shared);
    if (node.leaf())
      node.entries.erase(std::ranges::lower_bound(node.entries, key, {}, &Entry::first));
    else
      remove(node.children[slot(h, level)], h, level + 1, key);
    if (--node.count == 0)
      shared = nullptr;
    else if (!node.leaf() && node.count <= kBucket)
      gather(node);
  }
  static void gather(Node& node) {
    const auto keep = [&](const K& key, const V& value) { node.entries.emplace_back(key, value); };
    for (const NodePtr& child : node.children) visit(child.get(), keep);
    node.children.clear();
    std::ranges::sort(node.entries, {}, &Entry::first);
  }

  template <class F>
  static void visit(const Node* node, F& f) {
    if (!node) return;
    for (const auto& [key, value] : node->entries) f(key, value);
    for (const NodePtr& child : node->children) visit(child.get(), f);
  }

  NodePtr root_;
};

}  // namespace heliograph
