#include "renderer/assets/builder.h"

#include <cassert>

namespace heliograph::assets {

std::string Builder::claim_name(std::string_view wanted, std::string_view fallback) {
  const std::string base = clean_name(wanted, fallback);
  if (names_.insert(base).second) return base;
  for (u32 number = 2;; ++number) {
    std::string name = fmt::format("{}_{}", base, number);
    if (names_.insert(name).second) return name;
  }
}

Ref Builder::library(const std::string& name, Action action) {
  assert(loaded.asset.entities.empty());
  auto& edits = loaded.asset.library;
  edits.push_back({.mode = Mode::kUpsert, .target = name, .action = std::move(action)});
  return CreatedByEdit{u32(edits.size() - 1)};
}

u32 Builder::entity(const std::string& name, PutEntity put) {
  auto& edits = loaded.asset.entities;
  Budget::check(edits.size() + 1, options.limits.entities, "entities", "nodes");
  Ref target;
  if (!edits.empty()) target = name;
  edits.push_back({.mode = Mode::kUpsert, .target = target, .action = std::move(put)});
  return u32(edits.size() - 1);
}

u32 Builder::turned_root(const mat4x3& world_from_file) {
  const u32 root = entity("", PutEntity{});
  return entity(claim_name("z_up", "z_up"),
                {.parent = entity_ref(root), .pose = constant_pose(world_from_file)});
}

Ref Builder::entity_ref(u32 index) const {
  return CreatedByEdit{u32(loaded.asset.library.size()) + index};
}

PutEntity& Builder::entity_at(u32 index) {
  return std::get<PutEntity>(loaded.asset.entities[index].action);
}

void Builder::warn(const std::string& warning) {
  constexpr std::size_t kLongest = 500;
  if (warned_.insert(warning).second) loaded.warnings.push_back(clean_text(warning, kLongest));
}

void Builder::missing(const std::string& path) {
  if (bundle.lacks(path)) {
    return warn(
        fmt::format("there is no file '{}': it is left out; put it beside the model, or give "
                    "the folder that it is in (folders=)",
                    path));
  }
  if (missing_.insert(path).second) loaded.missing.push_back(path);
}

}  // namespace heliograph::assets
