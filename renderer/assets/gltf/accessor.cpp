// Accessors: strided, sparse, normalised; every byte range checked before it is read.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>

#include "renderer/assets/gltf/document.h"

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
float component_as_float(const std::byte* at, Component type, bool normalized) {
  switch (type) {
    case Component::kI8: {
      const auto value = float(load<std::int8_t>(at));
      return normalized ? std::max(value / 127.0f, -1.0f) : value;
    }
    case Component::kU8:
      return float(load<u8>(at)) / (normalized ? 255.0f : 1.0f);
    case Component::kI16: {
      const auto value = float(load<std::int16_t>(at));
      return normalized ? std::max(value / 32767.0f, -1.0f) : value;
    }
    case Component::kU16:
      return float(load<u16>(at)) / (normalized ? 65535.0f : 1.0f);
    case Component::kU32:
      return float(load<u32>(at));
    case Component::kF32:
      return load<float>(at);
  }
  return 0;
}

u32 component_as_integer(const std::byte* at, Component type) {
  if (type == Component::kU8) return load<u8>(at);
  if (type == Component::kU16) return load<u16>(at);
  return load<u32>(at);
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
  const Value value = document.item("accessors", index.index(document.count("accessors")));
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

/// Calls put(element, component, bytes) for every component stored, dense first, then sparse.
template <class Put>
void for_each_component(const Document& document, const Accessor& accessor, const Put& put) {
  const u32 size = bytes_of(accessor.type);
  const auto put_element = [&](u64 element, const std::byte* at) {
    for (u32 c = 0; c < accessor.components; ++c) put(element, c, at + c * size);
  };
  if (accessor.unpacked) {
    const std::byte* bytes = accessor.unpacked->bytes.data();
    for (u64 i = 0; i < accessor.count; ++i) put_element(i, bytes + i * accessor.element_bytes());
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
    for (u64 i = 0; i < accessor.count; ++i) put_element(i, bytes.data() + i * step);
  }
  const auto sparse = accessor.value.find("sparse");
  if (!sparse) return;
  const u64 count = sparse->at("count").whole();
  if (count > accessor.count) refuse(sparse->key_where("count"), "exceeds the accessor's count");
  const Value indices = sparse->at("indices");
  const Component index_type = component_of(indices.at("componentType"));
  if (index_type != Component::kU8 && index_type != Component::kU16 &&
      index_type != Component::kU32) {
    refuse(indices.key_where("componentType"), "must be an unsigned integer");
  }
  const Value values = sparse->at("values");
  const Bytes index_bytes = document.view_bytes(
      indices.at("bufferView"), indices.whole("byteOffset", 0), count * bytes_of(index_type));
  const Bytes value_bytes = document.view_bytes(
      values.at("bufferView"), values.whole("byteOffset", 0), count * accessor.element_bytes());
  for (u64 i = 0; i < count; ++i) {
    const u32 element =
        component_as_integer(index_bytes.data() + i * bytes_of(index_type), index_type);
    if (element >= accessor.count) {
      refuse(indices.where(),
             fmt::format("element {} names vertex {} of {}", i, element, accessor.count));
    }
    put_element(element, value_bytes.data() + i * accessor.element_bytes());
  }
}

}  // namespace

u32 bytes_of(Component type) {
  switch (type) {
    case Component::kI8:
    case Component::kU8:
      return 1;
    case Component::kI16:
    case Component::kU16:
      return 2;
    case Component::kU32:
    case Component::kF32:
      return 4;
  }
  return 0;
}

u64 accessor_count(const Document& document, const Value& accessor) {
  if (const Unpacked* unpacked = document.find_unpacked(accessor)) return unpacked->count;
  return document.item("accessors", accessor.index(document.count("accessors")))
      .at("count")
      .whole();
}

Component accessor_type(const Document& document, const Value& accessor) {
  if (const Unpacked* unpacked = document.find_unpacked(accessor)) return unpacked->type;
  return component_of(
      document.item("accessors", accessor.index(document.count("accessors"))).at("componentType"));
}

u32 accessor_components(const Document& document, const Value& accessor) {
  const Value type =
      document.item("accessors", accessor.index(document.count("accessors"))).at("type");
  const std::string name = type.text();
  const auto shape = std::ranges::find(kShapes, name, &Shape::name);
  if (shape == kShapes.end()) refuse(type.where(), "is not SCALAR, VEC2 .. VEC4 or MAT2 .. MAT4");
  return shape->components;
}

std::vector<float> read_floats(const Document& document, const Value& index, u32 components,
                               Budget& budget, NonFinite non_finite) {
  const Accessor accessor = open(document, index, components);
  if (components > 4 && accessor.type != Component::kF32) {
    refuse(accessor.value.key_where("componentType"), "matrices must be of floats");
  }
  budget.take(accessor.count, u64(components) * sizeof(float), accessor.value.where());
  std::vector<float> result(accessor.count * components);
  for_each_component(document, accessor, [&](u64 element, u32 c, const std::byte* at) {
    result[element * components + c] = component_as_float(at, accessor.type, accessor.normalized);
  });
  for (u64 element = 0; element < accessor.count; ++element) {
    const std::span<float> values(&result[element * components], components);
    if (std::ranges::all_of(values, [](float value) { return std::isfinite(value); })) continue;
    if (non_finite == NonFinite::kRefused)
      refuse(accessor.value.where(), fmt::format("element {} is not finite", element));
    std::ranges::fill(values, 0.0f);
  }
  return result;
}

std::vector<u32> read_integers(const Document& document, const Value& index, u32 components,
                               Budget& budget) {
  const Accessor accessor = open(document, index, components);
  if (accessor.type != Component::kU8 && accessor.type != Component::kU16 &&
      accessor.type != Component::kU32) {
    refuse(accessor.value.key_where("componentType"), "must be an unsigned integer");
  }
  budget.take(accessor.count, u64(components) * sizeof(u32), accessor.value.where());
  std::vector<u32> result(accessor.count * components);
  for_each_component(document, accessor, [&](u64 element, u32 c, const std::byte* at) {
    result[element * components + c] = component_as_integer(at, accessor.type);
  });
  return result;
}

}  // namespace heliograph::assets::gltf
