// Source: EXT_meshopt_compression.
#include <meshoptimizer.h>

#include "renderer/assets/gltf/document.h"

namespace heliograph::assets::gltf {
namespace {

/// Parameters of the extension for a buffer view.
struct Packed {
  Value value;
  Bytes bytes;
  u64 count, stride;
  std::string mode, filter;

  [[noreturn]] void wrong(const std::string& key, const std::string& message) const {
    refuse(value.key_where(key), message);
  }
};

void check(const Packed& packed) {
  const u64 stride = packed.stride;
  if (packed.mode == "ATTRIBUTES") {
    if (stride == 0 || stride > 256 || stride % 4 != 0)
      packed.wrong("byteStride", "must be a multiple of 4, at most 256, for ATTRIBUTES");
  } else if (packed.mode == "TRIANGLES" || packed.mode == "INDICES") {
    if (stride != 2 && stride != 4) packed.wrong("byteStride", "must be 2 or 4 for indices");
    if (packed.mode == "TRIANGLES" && packed.count % 3 != 0)
      packed.wrong("count", "must be a multiple of 3 for TRIANGLES");
    if (packed.filter != "NONE") packed.wrong("filter", "must be NONE for indices");
  } else {
    packed.wrong("mode", "must be ATTRIBUTES, TRIANGLES or INDICES");
  }
  if (packed.filter == "OCTAHEDRAL") {
    if (stride != 4 && stride != 8) packed.wrong("byteStride", "must be 4 or 8 for OCTAHEDRAL");
  } else if (packed.filter == "QUATERNION") {
    if (stride != 8) packed.wrong("byteStride", "must be 8 for QUATERNION");
  } else if (packed.filter != "NONE" && packed.filter != "EXPONENTIAL") {
    packed.wrong("filter", "must be NONE, OCTAHEDRAL, QUATERNION or EXPONENTIAL");
  }
}

int decode(const Packed& packed, std::byte* out) {
  const auto* from = reinterpret_cast<const unsigned char*>(packed.bytes.data());
  const auto [count, stride, size] = std::tuple(packed.count, packed.stride, packed.bytes.size());
  if (packed.mode == "TRIANGLES") return meshopt_decodeIndexBuffer(out, count, stride, from, size);
  if (packed.mode == "INDICES") return meshopt_decodeIndexSequence(out, count, stride, from, size);
  return meshopt_decodeVertexBuffer(out, count, stride, from, size);
}

void unfilter(const Packed& packed, std::byte* out) {
  if (packed.filter == "OCTAHEDRAL") meshopt_decodeFilterOct(out, packed.count, packed.stride);
  if (packed.filter == "QUATERNION") meshopt_decodeFilterQuat(out, packed.count, packed.stride);
  if (packed.filter == "EXPONENTIAL") meshopt_decodeFilterExp(out, packed.count, packed.stride);
}

}  // namespace

std::vector<std::byte> decode_meshopt(const Value& value, Bytes bytes, Budget& budget) {
  const Packed packed{.value = value,
                      .bytes = bytes,
                      .count = value.at("count").whole(),
                      .stride = value.at("byteStride").whole(),
                      .mode = value.at("mode").text(),
                      .filter = value.text("filter", "NONE")};
  check(packed);
  budget.take(packed.count, packed.stride, value.where());
  std::vector<std::byte> out(packed.count * packed.stride);
  if (decode(packed, out.data()) != 0) {
    refuse(value.where(), "is broken, or packed by a newer encoder than can be read");
  }
  unfilter(packed, out.data());
  return out;
}

}  // namespace heliograph::assets::gltf
