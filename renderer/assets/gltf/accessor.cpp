// Accessors: strided, sparse, normalised; every byte range checked before it is read.
#include <algorithm>
#include <array>
#include <cstring>
#include <limits>

#include "renderer/assets/gltf/document.h"
#include "renderer/base/finite.h"

namespace heliograph::assets::gltf {
namespace {

constexpr std::array<Shape, 7> kShapes = {
    {{1, "SCALAR"}, {2, "VEC2"}, {3, "VEC3"}, {4, "VEC4"}, {4, "MAT2"}, {9, "MAT3"}, {16, "MAT4"}}};

Component component_of(const Value& value) {
  const u64 type = value.whole();
  if (type < 5120 || type > 5126 || type == 5124) {
    refuse(value.where(), fmt::format("{} is not a component type", type));
  }
  return Component(type);
}

template <class T>
T load(const std::byte* at) {
  T value;
  std::memcpy(&value, at, sizeof value);
  return value;
}

/// Source: glTF 2.0, 3.6.2.2 and 3.11 (normalised integers).
template <class T>
float as_float(T number, bool normalized) {
  if constexpr (sizeof(T) == sizeof(float)) {
    return float(number);
  } else {
    constexpr auto kLargest = float(std::numeric_limits<T>::max());
    return normalized ? std::max(float(number) / kLargest, -1.0f) : float(number);
  }
}

/// Refuses a type that is none of unsigned integers.
void check_unsigned(Component type, const Value& value) {
  if (type != Component::kU8 && type != Component::kU16 && type != Component::kU32)
    refuse(value.key_where("componentType"), "must be an unsigned integer");
}

struct Accessor {
  Value value;
  const Unpacked* unpacked;
  u64 count;
  u32 components;
  Component type;
  bool normalized;

  [[nodiscard]] u64 element_bytes() const { return u64(components) * bytes_of(type); }
};

Accessor open(const Document& document, const Value& index, u32 components) {
  const Value value = document.named("accessors", index);
  Accessor accessor{.value = value,
                    .unpacked = document.find_unpacked(index),
                    .count = accessor_count(document, index),
                    .components = accessor_components(document, index),
                    .type = accessor_type(document, index),
                    .normalized = value.flag("normalized", false)};
  if (accessor.components != components) {
    refuse(value.key_where("type"), fmt::format("has {} components, but {} needs {}",
                                                accessor.components, index.where(), components));
  }
  return accessor;
}

/// Calls put(first, count, bytes) for every run of components that lie side by side: first those of
/// all elements, then what replaces some of them. Most files have the former as one run, which
/// takes a tenth of the time of a call for each component.
template <class Put>
void for_each_run(const Document& document, const Accessor& accessor, const Put& put) {
  const u32 components = accessor.components;
  if (accessor.unpacked) {
    put(0, accessor.count * components, accessor.unpacked->bytes.data());
    return;
  }
  if (const auto view = accessor.value.find("bufferView")) {
    const u64 stride = document.view_stride(*view);
    const u64 step = stride ? stride : accessor.element_bytes();
    if (step < accessor.element_bytes()) {
      refuse(accessor.value.where(), "its elements are longer than the view's byteStride");
    }
    const u64 length = accessor.count ? (accessor.count - 1) * step + accessor.element_bytes() : 0;
    const Bytes bytes = document.view_bytes(*view, accessor.value.whole("byteOffset", 0), length);
    if (step == accessor.element_bytes()) {
      put(0, accessor.count * components, bytes.data());
    } else {
      for (u64 i = 0; i < accessor.count; ++i)
        put(i * components, components, bytes.data() + i * step);
    }
  }
  const auto sparse = accessor.value.find("sparse");
  if (!sparse) return;
  const u64 count = sparse->at("count").whole();
  if (count > accessor.count) refuse(sparse->key_where("count"), "exceeds the accessor's count");
  const Value indices = sparse->at("indices");
  const Component index_type = component_of(indices.at("componentType"));
  check_unsigned(index_type, indices);
  const Value values = sparse->at("values");
  const Bytes index_bytes = document.view_bytes(
      indices.at("bufferView"), indices.whole("byteOffset", 0), count * bytes_of(index_type));
  const Bytes value_bytes = document.view_bytes(
      values.at("bufferView"), values.whole("byteOffset", 0), count * accessor.element_bytes());
  for (u64 i = 0; i < count; ++i) {
    u32 element = 0;  // the bytes behind those of a shorter index stay 0
    std::memcpy(&element, index_bytes.data() + i * bytes_of(index_type), bytes_of(index_type));
    if (element >= accessor.count) {
      refuse(indices.where(),
             fmt::format("element {} names vertex {} of {}", i, element, accessor.count));
    }
    put(u64(element) * components, components, value_bytes.data() + i * accessor.element_bytes());
  }
}

/// All components, one after another, each as `convert` makes it of a number of the file.
template <class To, class Convert>
void read_components(const Document& document, const Accessor& accessor, To* out,
                     const Convert& convert) {
  with_type(accessor.type, [&]<class From>(From) {
    for_each_run(document, accessor, [&](u64 first, u64 count, const std::byte* at) {
      for (u64 i = 0; i < count; ++i) out[first + i] = convert(load<From>(at + i * sizeof(From)));
    });
  });
}

/// Elements as T, a float or as many as an element has.
template <class T>
std::vector<T> read_vectors(const Document& document, const Value& index, u32 components,
                            Budget& budget, NonFinite non_finite) {
  const Accessor accessor = open(document, index, components);
  if (components > 4 && accessor.type != Component::kF32) {
    refuse(accessor.value.key_where("componentType"), "matrices must be of floats");
  }
  budget.take(accessor.count, u64(components) * sizeof(float), accessor.value.where());
  std::vector<T> result(accessor.count * components * sizeof(float) / sizeof(T));
  auto* const floats = reinterpret_cast<float*>(result.data());
  read_components(document, accessor, floats,
                  [&](auto number) { return as_float(number, accessor.normalized); });
  if (all_finite({floats, accessor.count * components})) return result;
  for (u64 element = 0; element < accessor.count; ++element) {
    const std::span<float> values(floats + element * components, components);
    if (all_finite(values)) continue;
    if (non_finite == NonFinite::kRefused)
      refuse(accessor.value.where(), fmt::format("element {} is not finite", element));
    std::ranges::fill(values, 0.0f);
  }
  return result;
}

}  // namespace

u32 bytes_of(Component type) {
  u32 bytes = 0;
  with_type(type, [&](auto number) { bytes = sizeof number; });
  return bytes;
}

u64 accessor_count(const Document& document, const Value& accessor) {
  if (const Unpacked* unpacked = document.find_unpacked(accessor)) return unpacked->count;
  return document.named("accessors", accessor).at("count").whole();
}

Component accessor_type(const Document& document, const Value& accessor) {
  if (const Unpacked* unpacked = document.find_unpacked(accessor)) return unpacked->type;
  return component_of(document.named("accessors", accessor).at("componentType"));
}

u32 accessor_components(const Document& document, const Value& accessor) {
  const Value type = document.named("accessors", accessor).at("type");
  const std::string name = type.text();
  const auto shape = std::ranges::find(kShapes, name, &Shape::name);
  if (shape == kShapes.end()) refuse(type.where(), "is not SCALAR, VEC2 .. VEC4 or MAT2 .. MAT4");
  return shape->components;
}

std::vector<float> read_floats(const Document& document, const Value& index, u32 components,
                               Budget& budget) {
  return read_vectors<float>(document, index, components, budget, NonFinite::kRefused);
}

template <class T>
std::vector<T> read_as(const Document& document, const Value& index, Budget& budget,
                       NonFinite non_finite) {
  return read_vectors<T>(document, index, sizeof(T) / sizeof(float), budget, non_finite);
}
template std::vector<vec2> read_as(const Document&, const Value&, Budget&, NonFinite);
template std::vector<vec3> read_as(const Document&, const Value&, Budget&, NonFinite);
template std::vector<vec4> read_as(const Document&, const Value&, Budget&, NonFinite);
template std::vector<mat4> read_as(const Document&, const Value&, Budget&, NonFinite);
template <class T>
std::vector<T> read_integers(const Document& document, const Value& index, u32 components,
                             Budget& budget) {
  const Accessor accessor = open(document, index, components);
  check_unsigned(accessor.type, accessor.value);
  budget.take(accessor.count, u64(components) * sizeof(u32), accessor.value.where());
  const u64 bytes = accessor.count * components * sizeof(u32);
  std::vector<T> result((bytes + sizeof(T) - 1) / sizeof(T));
  read_components(document, accessor, reinterpret_cast<u32*>(result.data()),
                  [](auto number) { return u32(number); });
  return result;
}
template std::vector<u32> read_integers(const Document&, const Value&, u32, Budget&);
template std::vector<uvec3> read_integers(const Document&, const Value&, u32, Budget&);

}  // namespace heliograph::assets::gltf
