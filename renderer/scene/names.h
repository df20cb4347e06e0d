// Names of a scene's objects. Part of a Snapshot.
#pragma once

#include <array>
#include <string>

#include "renderer/scene/ids.h"
#include "renderer/scene/persistent_map.h"

namespace heliograph {

/// A name is unique per kind: a mesh, a material and an entity may share one. A copy costs a
/// pointer per kind. Thread: const access from any, writes from one.
class Names {
 public:
  /// kNone: any kind, entities first.
  [[nodiscard]] const Id* find(const std::string& name, Kind kind = Kind::kNone) const {
    if (kind != Kind::kNone) return of(kind).find(name);
    for (const Map& map : maps_)
      if (const Id* id = map.find(name)) return id;
    return nullptr;
  }
  void set(const std::string& name, Id id) { of(id.kind()).set(name, id); }
  void erase(const std::string& name, Kind kind) { of(kind).erase(name); }
  [[nodiscard]] u32 size() const {
    u32 size = 0;
    for (const Map& map : maps_) size += map.size();
    return size;
  }
  /// f(name, id) for all of them.
  template <class F>
  void for_each(F&& f) const {
    for (const Map& map : maps_) map.for_each(f);
  }

 private:
  using Map = PersistentMap<std::string, Id>;
  [[nodiscard]] const Map& of(Kind kind) const { return maps_[std::size_t(kind) - 1]; }
  [[nodiscard]] Map& of(Kind kind) { return maps_[std::size_t(kind) - 1]; }

  std::array<Map, std::size_t(Kind::kVolume)> maps_;  // by kind
};

}  // namespace heliograph
