// Bundles for the tests of the importers: files of tests/assets, and glTF documents written by
// hand.
#pragma once

#include <fmt/format.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "renderer/assets/load.h"

namespace heliograph {

inline std::vector<std::byte> as_bytes_of(std::string_view text) {
  const auto bytes = std::as_bytes(std::span(text));
  return {bytes.begin(), bytes.end()};
}

inline std::vector<std::byte> read_file(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  return as_bytes_of(text);
}

inline std::filesystem::path test_assets() {
  return std::filesystem::path(HELIOGRAPH_SOURCE_DIR) / "tests/assets";
}

/// Owns the bytes of a bundle.
struct TestBundle {
  std::vector<std::string> paths;
  std::vector<std::vector<std::byte>> contents;

  TestBundle& add(std::string path, std::vector<std::byte> bytes) {
    paths.push_back(std::move(path));
    contents.push_back(std::move(bytes));
    return *this;
  }
  TestBundle& add(std::string path, std::string_view text) {
    return add(std::move(path), as_bytes_of(text));
  }
  [[nodiscard]] std::vector<BundleFile> files() const {
    std::vector<BundleFile> result;
    for (std::size_t i = 0; i < paths.size(); ++i) result.push_back({paths[i], contents[i]});
    return result;
  }
  [[nodiscard]] Expected<Loaded> load(const LoadOptions& options = {}) const {
    return load_asset(files(), options);
  }
};

/// A file with everything beside it that it may refer to.
inline TestBundle bundle_of(const std::filesystem::path& model) {
  TestBundle bundle;
  bundle.add(model.filename(), read_file(model));
  for (const auto& entry : std::filesystem::directory_iterator(model.parent_path())) {
    const std::string extension = entry.path().extension();
    const bool companion =
        extension == ".bin" || extension == ".png" || extension == ".jpg" || extension == ".mtl";
    if (companion && entry.path() != model) {
      bundle.add(entry.path().filename(), read_file(entry.path()));
    }
  }
  return bundle;
}

/// A glTF whose JSON a test writes by hand, over accessors it adds here: the k-th call is accessor
/// k.
class GltfFile {
 public:
  template <class T>
  u32 add(const std::string& type, u32 component, const std::vector<T>& values,
          const std::string& more = "") {
    const std::size_t width = type == "SCALAR" ? 1
                              : type == "MAT4" ? 16
                                               : std::size_t(type[3] - '0');
    const u32 index = view(std::as_bytes(std::span(values)));
    accessors_ += fmt::format(
        R"({}{{"bufferView":{},"componentType":{},"count":{},"type":"{}"{}}})",
        accessors_.empty() ? "" : ",", index, component, values.size() / width, type, more);
    return count_++;
  }
  u32 floats(const std::string& type, const std::vector<float>& values) {
    return add(type, 5126, values);
  }
  u32 indices(const std::vector<u16>& values) { return add("SCALAR", 5123, values); }
  /// An accessor as JSON.
  u32 raw(const std::string& json) {
    accessors_ += (accessors_.empty() ? "" : ",") + json;
    return count_++;
  }
  u32 view(std::span<const std::byte> bytes, const std::string& more = "") {
    views_ += fmt::format(R"({}{{"buffer":0,"byteOffset":{},"byteLength":{}{}}})",
                          views_.empty() ? "" : ",", buffer_.size(), bytes.size(), more);
    buffer_.insert(buffer_.end(), bytes.begin(), bytes.end());
    buffer_.resize((buffer_.size() + 3) / 4 * 4);
    return view_count_++;
  }

  /// `json`: further members of the document.
  [[nodiscard]] TestBundle bundle(const std::string& json) const {
    TestBundle result;
    result.add("test.gltf",
               fmt::format(R"({{"asset":{{"version":"2.0"}},"buffers":[{{"uri":"data.bin",)"
                           R"("byteLength":{}}}],"bufferViews":[{}],"accessors":[{}],{}}})",
                           buffer_.size(), views_, accessors_, json));
    result.add("data.bin", buffer_);
    return result;
  }
  [[nodiscard]] Expected<Loaded> load(const std::string& json) const { return bundle(json).load(); }

 private:
  std::vector<std::byte> buffer_;
  std::string views_, accessors_;
  u32 count_ = 0, view_count_ = 0;
};

/// Nodes over a mesh 0 of the triangle that triangle() has.
inline std::string with_triangle(const std::string& nodes, const std::string& more = "") {
  return R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[)" + nodes + "]" +
         more;
}

inline GltfFile triangle() {
  GltfFile file;
  file.floats("VEC3", {0, 0, 0, 1, 0, 0, 0, 2, 0});
  return file;
}

/// The k-th action of type T in the library, in order.
template <class T>
const T& library_item(const Loaded& loaded, std::size_t k = 0) {
  for (const Edit& edit : loaded.asset.library) {
    if (const T* action = std::get_if<T>(&edit.action); action && k-- == 0) return *action;
  }
  throw std::out_of_range("the library has fewer of these");
}

/// Of the triangles of the first mesh.
inline double area(const Loaded& loaded) {
  const PutMesh& mesh = library_item<PutMesh>(loaded);
  double sum = 0;
  for (const uvec3& t : mesh.topology->triangles) {
    const auto& p = mesh.vertices->positions;
    sum += 0.5 * glm::length(glm::cross(p[t.y] - p[t.x], p[t.z] - p[t.x]));
  }
  return sum;
}

/// Index of the entity of that name.
inline std::size_t entity_index(const Loaded& loaded, const std::string& name) {
  for (std::size_t i = 0; i < loaded.asset.entities.size(); ++i) {
    const auto* own = std::get_if<std::string>(&loaded.asset.entities[i].target);
    if (own && *own == name) return i;
  }
  throw std::out_of_range("no entity '" + name + "'");
}
inline const PutEntity& entity_named(const Loaded& loaded, const std::string& name) {
  return std::get<PutEntity>(loaded.asset.entities[entity_index(loaded, name)].action);
}
/// The index among the entities that a reference names.
inline std::size_t entity_of(const Loaded& loaded, const Ref& ref) {
  return std::get<CreatedByEdit>(ref).edit - loaded.asset.library.size();
}

/// "code where: message" of a refusal, "" of a success.
inline std::string refusal(const Expected<Loaded>& loaded) {
  if (loaded) return "";
  return fmt::format("{} {}: {}", int(loaded.error().code), loaded.error().where,
                     loaded.error().message);
}

}  // namespace heliograph
