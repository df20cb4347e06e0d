// Messages to convert: arrays with inline bytes, and a source and a sink that keep them inline.
#pragma once

#include <cstring>
#include <map>
#include <string>
#include <vector>

#include "server/convert/transaction.h"

namespace heliograph::server {

inline BufferPtr copy_bytes(std::string_view bytes) {
  auto owner = std::make_shared<std::vector<std::byte>>(bytes.size());
  if (!bytes.empty()) std::memcpy(owner->data(), bytes.data(), bytes.size());
  return std::make_shared<const Buffer>(owner, std::span<const std::byte>(*owner));
}

/// Knows inline bytes, and the blobs and assets put into it.
class InlineSource final : public ArraySource {
 public:
  Expected<BufferPtr> bytes(const v1::Array& array) override {
    if (array.has_inline_()) return copy_bytes(array.inline_());
    if (array.has_blob()) return blob(array.blob());
    return fail(Code::kInvalidArgument, "", "has no bytes; set inline");
  }
  Expected<std::shared_ptr<const Asset>> asset(std::string_view hash) override {
    const auto found = assets.find(std::string(hash));
    if (found == assets.end()) return fail(Code::kNotFound, "", "no such asset");
    return found->second;
  }
  Expected<BufferPtr> blob(std::string_view hash) {
    const auto found = blobs.find(std::string(hash));
    if (found == blobs.end()) return fail(Code::kNotFound, "", "no such blob; upload it");
    return found->second;
  }

  std::map<std::string, std::shared_ptr<const Asset>> assets;
  std::map<std::string, BufferPtr> blobs;
};

/// Leaves arrays inline.
inline void inline_sink(const BufferPtr& bytes, v1::Array& array) {
  const std::string_view text(reinterpret_cast<const char*>(bytes->bytes().data()),
                              bytes->bytes().size());
  array.set_inline_(std::string(text));
}

template <class T>
v1::Array array_of(v1::DType type, std::vector<u64> shape, const std::vector<T>& values) {
  v1::Array array;
  array.set_dtype(type);
  array.mutable_shape()->Add(shape.begin(), shape.end());
  array.set_inline_(values.data(), values.size() * sizeof(T));
  return array;
}
inline v1::Array f32(std::vector<u64> shape, const std::vector<float>& values) {
  return array_of(v1::D_TYPE_F32, std::move(shape), values);
}
inline v1::Array f64(std::vector<u64> shape, const std::vector<double>& values) {
  return array_of(v1::D_TYPE_F64, std::move(shape), values);
}
inline v1::Array u32s(std::vector<u64> shape, const std::vector<u32>& values) {
  return array_of(v1::D_TYPE_U32, std::move(shape), values);
}
/// Row-major translation matrices.
inline std::vector<float> translations(std::initializer_list<float> xs) {
  std::vector<float> out;
  for (const float x : xs) out.insert(out.end(), {1, 0, 0, x, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1});
  return out;
}

/// One triangle.
inline v1::Mesh triangle() {
  v1::Mesh mesh;
  *mesh.mutable_positions() = f32({3, 3}, {0, 0, 0, 1, 0, 0, 0, 1, 0});
  *mesh.mutable_indices() = u32s({1, 3}, {0, 1, 2});
  return mesh;
}

}  // namespace heliograph::server
