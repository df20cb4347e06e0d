// A persistent hash map: a copy is one pointer, an insertion clones a path of at most a few nodes.
// Names and labels of a Snapshot live here.
#pragma once

#include <array>
#include <functional>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "renderer/base/types.h"

namespace heliograph {

/// Source: Bagwell 2001, "Ideal Hash Trees", with a fan-out of 32 and small sorted buckets of equal
/// hash prefixes at the leaves. Iteration order depends on the keys only, never on history.
template <class K, class V, class Hash = std::hash<K>>
class PersistentMap {
 public:
  [[nodiscard]] const V* find(const K& key) const {
    const u64 h = mix(Hash{}(key));
    const Node* node = root_.get();
    for (u32 level = 0; node; ++level) {
      if (node->leaf) {
        for (const auto& [k, v] : node->entries)
          if (k == key) return &v;
        return nullptr;
      }
      node = node->children[slot(h, level)].get();
    }
    return nullptr;
  }
  void set(const K& key, V value) {
    bool added = false;
    root_ = set(root_, mix(Hash{}(key)), 0, key, std::move(value), added);
    size_ += added;
  }
  void erase(const K& key) {
    bool removed = false;
    root_ = erase(root_, mix(Hash{}(key)), 0, key, removed);
    size_ -= removed;
  }
  [[nodiscard]] u32 size() const { return size_; }
  template <class F>
  void for_each(F&& f) const {
    visit(root_.get(), f);
  }

 private:
  static constexpr u32 kBucket = 8;
  static constexpr u32 kMaxLevel = 12;
  struct Node;
  using NodePtr = std::shared_ptr<const Node>;
  struct Node {
    bool leaf = true;
    std::vector<std::pair<K, V>> entries;
    std::array<NodePtr, 32> children;
  };

  static u64 mix(u64 x) {  // splitmix64 finaliser
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ull;
    x = (x ^ (x >> 27)) * 0x94d049bb133111ebull;
    return x ^ (x >> 31);
  }
  static u32 slot(u64 h, u32 level) { return u32(h >> (5 * level)) & 31u; }

  static NodePtr set(const NodePtr& node, u64 h, u32 level, const K& key, V value, bool& added) {
    auto out = node ? std::make_shared<Node>(*node) : std::make_shared<Node>();
    if (out->leaf) {
      for (auto& [k, v] : out->entries)
        if (k == key) {
          v = std::move(value);
          return out;
        }
      added = true;
      out->entries.emplace_back(key, std::move(value));
      if (out->entries.size() <= kBucket || level == kMaxLevel) return out;
      auto entries = std::move(out->entries);
      out->entries.clear();
      out->leaf = false;
      for (auto& [k, v] : entries) {
        const u64 hk = mix(Hash{}(k));
        NodePtr& child = out->children[slot(hk, level)];
        bool again = false;
        child = set(child, hk, level + 1, k, std::move(v), again);
      }
      return out;
    }
    NodePtr& child = out->children[slot(h, level)];
    child = set(child, h, level + 1, key, std::move(value), added);
    return out;
  }
  static NodePtr erase(const NodePtr& node, u64 h, u32 level, const K& key, bool& removed) {
    if (!node) return node;
    if (node->leaf) {
      for (std::size_t i = 0; i < node->entries.size(); ++i)
        if (node->entries[i].first == key) {
          removed = true;
          auto out = std::make_shared<Node>(*node);
          out->entries.erase(out->entries.begin() + std::ptrdiff_t(i));
          return out->entries.empty() ? nullptr : NodePtr(out);
        }
      return node;
    }
    const NodePtr& child = node->children[slot(h, level)];
    NodePtr smaller = erase(child, h, level + 1, key, removed);
    if (!removed) return node;
    auto out = std::make_shared<Node>(*node);
    out->children[slot(h, level)] = std::move(smaller);
    return out;
  }
  template <class F>
  static void visit(const Node* node, F& f) {
    if (!node) return;
    for (const auto& [k, v] : node->entries) f(k, v);
    for (const NodePtr& child : node->children) visit(child.get(), f);
  }

  NodePtr root_;
  u32 size_ = 0;
};

}  // namespace heliograph
