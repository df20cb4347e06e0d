// Looking objects up by id and by name. Called by everything that reads a Snapshot.
#include "renderer/scene/snapshot.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <numeric>
#include <utility>

namespace heliograph {
namespace {

constexpr std::size_t kNearest = 3;
constexpr std::size_t kMostCompared = 10'000'000;  // pairs of letters, some 10 ms

/// Edits (insert, delete, substitute) between two words, or limit + 1 when there are more.
/// `row` is working memory.
///
/// Source: Wagner & Fischer 1974, "The String-to-String Correction Problem".
std::size_t edit_distance(std::string_view a, std::string_view b, std::size_t limit,
                          std::vector<std::size_t>& row) {
  if (std::max(a.size(), b.size()) - std::min(a.size(), b.size()) > limit) return limit + 1;
  row.resize(b.size() + 1);
  std::iota(row.begin(), row.end(), 0);
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = std::exchange(row[0], i);
    std::size_t smallest = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      row[j] = std::min({above + 1, row[j - 1] + 1, diagonal + (a[i - 1] != b[j - 1])});
      diagonal = above;
      smallest = std::min(smallest, row[j]);
    }
    if (smallest > limit) return limit + 1;
  }
  return std::min(row.back(), limit + 1);
}

std::vector<std::string> nearest_names(const Snapshot& snapshot, std::string_view name) {
  const std::size_t limit = std::max<std::size_t>(2, name.size() / 2);
  std::vector<std::pair<std::size_t, std::string>> found;
  std::vector<std::size_t> row;
  std::size_t compared = 0;
  snapshot.names.for_each([&](const std::string& candidate, Id) {
    if ((compared += name.size() * candidate.size()) > kMostCompared) return;
    if (std::ranges::any_of(found, [&](const auto& entry) { return entry.second == candidate; }))
      return;  // of another kind
    const bool full = found.size() == kNearest;
    const std::size_t bar = full ? found.back().first : limit;
    const std::size_t distance = edit_distance(name, candidate, bar, row);
    if (distance > bar || (full && distance == bar && candidate > found.back().second)) return;
    std::pair entry{distance, candidate};
    found.insert(std::ranges::upper_bound(found, entry), std::move(entry));
    if (full) found.pop_back();
  });
  std::vector<std::string> names;
  for (auto& [distance, candidate] : found) names.push_back(std::move(candidate));
  return names;
}

template <class Row>
std::string name_or_empty(const Row* row) {
  return row && row->name ? *row->name : std::string();
}

}  // namespace

bool Snapshot::alive(Id id) const {
  switch (id.kind()) {
    case Kind::kEntity:
      return find(EntityId(id));
    case Kind::kMesh:
      return find(MeshId(id));
    case Kind::kMaterial:
      return find(MaterialId(id));
    case Kind::kTexture:
      return find(TextureId(id));
    case Kind::kVolume:
      return find(VolumeId(id));
    case Kind::kNone:
      return false;
  }
  return false;
}

std::string Snapshot::name_of(Id id) const {
  switch (id.kind()) {
    case Kind::kEntity:
      return name_or_empty(find(EntityId(id)));
    case Kind::kMesh:
      return name_or_empty(find(MeshId(id)));
    case Kind::kMaterial:
      return name_or_empty(find(MaterialId(id)));
    case Kind::kTexture:
      return name_or_empty(find(TextureId(id)));
    case Kind::kVolume:
      return name_or_empty(find(VolumeId(id)));
    case Kind::kNone:
      return {};
  }
  return {};
}

Expected<Id> Snapshot::find(std::string_view name, Kind kind) const {
  const std::string key(name);
  if (const Id* id = names.find(key, kind)) return *id;
  if (const Id* other = names.find(key))
    return fail(Code::kInvalidArgument, "",
                fmt::format("{} '{}' is not of the kind {}", kind_name(other->kind()), name,
                            kind_name(kind)));
  Error error{.code = Code::kNotFound,
              .message = fmt::format("nothing in the scene is named '{}'", name),
              .where = {}};
  error.nearest = nearest_names(*this, name);
  if (!error.nearest.empty())
    error.message += fmt::format("; the nearest names are '{}'", fmt::join(error.nearest, "', '"));
  return std::unexpected(std::move(error));
}

std::set<std::string> light_groups(const Snapshot& snapshot) {
  std::set<std::string> names;
  snapshot.entities.for_each([&](u32, const Entity& entity) {
    if (entity.light_group) names.insert(*entity.light_group);
  });
  if (snapshot.dome && !snapshot.dome->light_group.empty())
    names.insert(snapshot.dome->light_group);
  return names;
}

}  // namespace heliograph
