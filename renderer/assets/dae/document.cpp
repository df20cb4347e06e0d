#include "renderer/assets/dae/document.h"

#include <algorithm>
#include <limits>

#include "renderer/assets/text_scan.h"

namespace heliograph::assets::dae {
namespace {

constexpr int kDeepest = 256;

/// Notes the elements that have an id.
struct Indexer : pugi::xml_tree_walker {
  std::unordered_map<std::string_view, std::vector<Node>>& ids;
  explicit Indexer(std::unordered_map<std::string_view, std::vector<Node>>& target) : ids(target) {}

  bool for_each(Node& node) override {
    if (depth() > kDeepest)
      refuse(place(node), fmt::format("is nested deeper than {} elements", kDeepest));
    const pugi::xml_attribute id = node.attribute("id");
    if (id) ids[id.value()].push_back(node);
    return true;
  }
};

u64 words_in(std::string_view text) {
  u64 count = 0;
  bool within = false;
  for (const char c : text) {
    const bool blank = is_space(c);
    count += !blank && !within;
    within = !blank;
  }
  return count;
}

/// The numbers of a node's text, as `take` takes one off it.
template <class T, class Take>
std::vector<T> read_all(const Node& node, Budget& budget, const Take& take) {
  std::string_view text = node.text().get();
  const u64 count = words_in(text);
  const std::string where = place(node);
  budget.take(count, sizeof(T), where);
  std::vector<T> numbers;
  numbers.reserve(count);
  for (u64 i = 0; i < count; ++i) numbers.push_back(take(text, where));
  return numbers;
}

/// A number; programs in some languages write 0,5.
double take_any(std::string_view& text, const std::string& where) {
  std::string word(take_word(text));
  std::ranges::replace(word, ',', '.');
  std::string_view rest = word;
  return take_double(rest, where);
}

}  // namespace

Document::Document(Builder& builder) {
  const BundleFile& model = builder.bundle.model();
  const std::string_view text = as_text(model.bytes);
  // Most that pugixml allocates: a copy, a node for each tag and each text before one, and the
  // attributes.
  constexpr u64 kNodeBytes = 96;
  builder.budget.take(text.size(), 1, model.path);
  builder.budget.take(u64(std::ranges::count(text, '<')), 2 * kNodeBytes, model.path);
  builder.budget.take(u64(std::ranges::count(text, '=')), kNodeBytes, model.path);
  const pugi::xml_parse_result result =
      xml_.load_buffer(model.bytes.data(), model.bytes.size(), pugi::parse_default);
  if (result.status == pugi::status_out_of_memory) throw std::bad_alloc();
  if (!result)
    refuse(fmt::format("byte {}", result.offset),
           fmt::format("is no XML: {}", result.description()));
  if (std::string_view(root().name()) != "COLLADA")
    refuse(place(root()), "the root element must be COLLADA");
  Indexer indexer(ids_);
  xml_.traverse(indexer);
}

Node Document::find(std::string_view id, const char* tag) const {
  const auto found = ids_.find(id);
  if (found == ids_.end()) return {};
  const auto fits = [&](const Node& node) { return std::string_view(node.name()) == tag; };
  const auto at = std::ranges::find_if(found->second, fits);
  return at == found->second.end() ? Node() : *at;
}

Node Document::linked(std::string_view url, const char* tag, const std::string& where) const {
  if (url.empty()) refuse(where, fmt::format("names no <{}>", tag));
  if (!url.starts_with('#'))
    refuse_unimplemented(where, fmt::format("refers to '{}': only elements of the same file are "
                                            "read; merge the files",
                                            clean_name(url, "")));
  const Node node = find(url.substr(1), tag);
  if (!node)
    refuse(where, fmt::format("there is no <{}> '{}'", tag, clean_name(url.substr(1), "")));
  return node;
}

std::string place(const Node& node) {
  for (Node at = node; at; at = at.parent()) {
    const std::string_view id = at.attribute("id").value();
    if (!id.empty()) return fmt::format("{} '{}'", at.name(), clean_name(id, "?"));
  }
  return fmt::format("<{}>", clean_name(node.name(), "?"));
}

std::string_view name_of(const Node& node) {
  const std::string_view name = node.attribute("name").value();
  return name.empty() ? node.attribute("id").value() : name;
}

std::vector<double> read_doubles(const Node& node, Budget& budget) {
  return read_all<double>(node, budget, [](std::string_view& text, const std::string& where) {
    std::string_view ahead = text;
    if (!is_no_number(take_word(ahead))) return take_any(text, where);
    text = ahead;
    return std::numeric_limits<double>::quiet_NaN();
  });
}

std::vector<float> read_floats(const Node& node, Budget& budget) {
  return read_all<float>(node, budget, [](std::string_view& text, const std::string& where) {
    return float(take_any(text, where));
  });
}

std::vector<float> read_floats(const Node& node, std::size_t count, Budget& budget) {
  std::vector<float> numbers = read_floats(node, budget);
  if (numbers.size() != count)
    refuse(place(node),
           fmt::format("<{}> has {} numbers, not {}", node.name(), numbers.size(), count));
  return numbers;
}

std::vector<u32> read_indices(const Node& node, Budget& budget, bool may_be_none) {
  return read_all<u32>(node, budget, [&](std::string_view& text, const std::string& where) {
    const std::string_view word = take_word(text);
    if (may_be_none && word == "-1") return kNone;
    const auto index = parse<u32>(word);
    if (!index) refuse(where, fmt::format("'{}' is no index", clean_name(word, "")));
    return *index;
  });
}

u32 whole_attribute(const Node& node, const char* name, u32 absent) {
  const pugi::xml_attribute attribute = node.attribute(name);
  if (!attribute) return absent;
  const std::string_view text = trimmed(attribute.value());
  const auto value = parse<u32>(text);
  if (!value)
    refuse(place(node), fmt::format("{}=\"{}\" is no whole number", name, clean_name(text, "")));
  return *value;
}

u32 offset_of(const Node& input) {
  constexpr u32 kMost = 64;
  const u32 offset = whole_attribute(input, "offset", 0);
  if (offset >= kMost) refuse(place(input), "an <input> has an offset above 63");
  return offset;
}

}  // namespace heliograph::assets::dae
