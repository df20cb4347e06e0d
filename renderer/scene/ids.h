// Object ids: 64 bits of kind, version and index. A stale id is never another object.
#pragma once

#include <array>
#include <compare>
#include <functional>
#include <string_view>

#include "renderer/base/types.h"

namespace heliograph {

enum class Kind : u8 { kNone, kEntity, kMesh, kMaterial, kTexture, kVolume };

/// "unknown": of an id that somebody made up.
constexpr std::string_view kind_name(Kind kind) {
  constexpr std::array<std::string_view, 6> kNames{"nothing",  "entity",  "mesh",
                                                   "material", "texture", "volume"};
  return std::size_t(kind) < kNames.size() ? kNames[std::size_t(kind)] : "unknown";
}

/// Any object: kind (8 bits), version (24 bits), index (32 bits). 0 is nothing.
struct Id {
  u64 value = 0;

  static constexpr Id make(Kind kind, u32 version, u32 index) {
    return {(u64(kind) << 56) | (u64(version & 0xffffffu) << 32) | index};
  }
  [[nodiscard]] constexpr Kind kind() const { return Kind(value >> 56); }
  [[nodiscard]] constexpr u32 version() const { return u32(value >> 32) & 0xffffffu; }
  [[nodiscard]] constexpr u32 index() const { return u32(value); }
  explicit constexpr operator bool() const { return value != 0; }
  friend constexpr auto operator<=>(Id, Id) = default;
};

/// An id whose kind is known.
template <Kind K>
struct TypedId : Id {
  constexpr TypedId() = default;
  explicit constexpr TypedId(Id id) : Id(id.kind() == K ? id : Id{}) {}
  static constexpr TypedId make(u32 version, u32 index) {
    return TypedId(Id::make(K, version, index));
  }
};

using EntityId = TypedId<Kind::kEntity>;
using MeshId = TypedId<Kind::kMesh>;
using MaterialId = TypedId<Kind::kMaterial>;
using TextureId = TypedId<Kind::kTexture>;
using VolumeId = TypedId<Kind::kVolume>;

using Revision = u64;
using Time = double;  // seconds

}  // namespace heliograph

template <>
struct std::hash<heliograph::Id> {
  std::size_t operator()(heliograph::Id id) const noexcept {
    return std::hash<heliograph::u64>{}(id.value);
  }
};
