// A glTF 2.0 document: its JSON, its buffers, and typed reads of its accessors, every range
// checked. Source: Khronos, glTF 2.0 Specification (2021).
#pragma once

#include <list>
#include <map>

#include "renderer/assets/builder.h"
#include "renderer/assets/gltf/value.h"

namespace heliograph::assets::gltf {

using Bytes = std::span<const std::byte>;

/// componentType, as OpenGL numbers it.
enum class Component : u32 {
  kI8 = 5120,
  kU8 = 5121,
  kI16 = 5122,
  kU16 = 5123,
  kU32 = 5125,
  kF32 = 5126,
};
/// Calls f with a number of the type, whatever its value.
template <class F>
void with_type(Component type, const F& f) {
  switch (type) {
    case Component::kI8:
      return f(std::int8_t());
    case Component::kU8:
      return f(u8());
    case Component::kI16:
      return f(std::int16_t());
    case Component::kU16:
      return f(u16());
    case Component::kU32:
      return f(u32());
    case Component::kF32:
      return f(float());
  }
}
[[nodiscard]] u32 bytes_of(Component type);

/// Elements, without gaps, of an accessor that was packed.
struct Unpacked {
  std::vector<std::byte> bytes;
  u64 count = 0;
  Component type = Component::kF32;
};

/// Owns: the JSON and decoded data URIs. Borrows: the bundle.
class Document {
 public:
  /// Parses the model of the bundle (.gltf or .glb) and refuses what it requires and we lack.
  /// Missing companions are reported to the builder; then only `builder.complete()` matters.
  explicit Document(Builder& builder);

  [[nodiscard]] Value root() const { return {json_, ""}; }
  /// The top-level array `key`; empty when absent.
  [[nodiscard]] std::size_t count(const std::string& key) const;
  [[nodiscard]] auto items(const std::string& key) const {
    static const nlohmann::json kNone = nlohmann::json::array();
    return root().find(key).value_or(Value(kNone, key)).elements();
  }
  [[nodiscard]] Value item(const std::string& key, u32 index) const;
  /// The item of that array whose index this value is.
  [[nodiscard]] Value named(const std::string& key, const Value& index) const;

  /// Bytes [offset, offset + size) of a buffer view, unpacked; `view` holds its index.
  [[nodiscard]] Bytes view_bytes(const Value& view, u64 offset, u64 size) const;
  [[nodiscard]] u64 view_stride(const Value& view) const;  // 0: tightly packed
  [[nodiscard]] Bytes whole_view(const Value& view) const;

  /// From now on the accessor that this value names has these elements, whatever its view holds.
  void unpacked(const Value& accessor, Unpacked elements);
  /// Elements of an accessor that unpacked() has set; null: those of its view.
  [[nodiscard]] const Unpacked* find_unpacked(const Value& accessor) const;

  /// The bytes of an image or a light profile, whose `uri` or `bufferView` locates them, and
  /// the media type or file name that gives what they are; nullopt when the bundle lacks the file
  /// (reported as missing).
  struct LinkedBytes {
    Bytes bytes;
    std::string name;
  };
  [[nodiscard]] std::optional<LinkedBytes> linked_bytes(const Value& value);
  /// Nobody has the file of an image or a light profile: it is left out, with a warning.
  [[nodiscard]] bool is_lacking(const Value& value);

 private:
  void parse_container(Bytes file);
  void check_extensions() const;
  void load_buffers();
  void unpack_views();
  /// The bytes of a buffer that `value` names by buffer, byteOffset and byteLength.
  [[nodiscard]] Bytes range_of(const Value& value) const;
  /// The bytes within a data URI; nullopt: it is none.
  [[nodiscard]] std::optional<LinkedBytes> own_data(const Value& uri);
  /// nullopt: missing, reported.
  [[nodiscard]] std::optional<LinkedBytes> file_bytes(const std::string& path);
  /// The bundle path of an image or profile; "": it names none.
  [[nodiscard]] std::string companion(const Value& uri) const;

  Builder& builder_;
  nlohmann::json json_;
  std::optional<Bytes> glb_chunk_;
  std::vector<Bytes> buffers_;
  std::list<std::vector<std::byte>> owned_;
  std::map<u32, Bytes> views_;  // those that were packed
  std::map<u32, Unpacked> accessors_;
};

/// Decodes what a buffer view with EXT_meshopt_compression, which `value` is, packs into `bytes`.
[[nodiscard]] std::vector<std::byte> decode_meshopt(const Value& value, Bytes bytes,
                                                    Budget& budget);

// ---------------------------------------------------------------- accessors

/// Component counts by accessor type, SCALAR .. MAT4.
struct Shape {
  u32 components;
  const char* name;
};

/// Treatment of an element with a number that is NaN or infinite.
enum class NonFinite : u8 { kRefused, kZeros };

/// All components as floats, normalised integers mapped to [0, 1] or [-1, 1]; finite.
///
/// accessor   holds the accessor's index
/// components how many an element must have
[[nodiscard]] std::vector<float> read_floats(const Document& document, const Value& accessor,
                                             u32 components, Budget& budget);
/// Floats as vectors: vec2, vec3, vec4 or mat4.
template <class T>
[[nodiscard]] std::vector<T> read_as(const Document& document, const Value& accessor,
                                     Budget& budget, NonFinite non_finite = NonFinite::kRefused);
/// Unsigned integers as they are: one by one, or in threes as uvec3, the last filled up with zeros.
template <class T = u32>
[[nodiscard]] std::vector<T> read_integers(const Document& document, const Value& accessor,
                                           u32 components, Budget& budget);
[[nodiscard]] u64 accessor_count(const Document& document, const Value& accessor);
[[nodiscard]] Component accessor_type(const Document& document, const Value& accessor);
/// Components of an element, from the accessor's type.
[[nodiscard]] u32 accessor_components(const Document& document, const Value& accessor);

}  // namespace heliograph::assets::gltf
