#include "renderer/assets/gltf/document.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <string_view>

#include "renderer/assets/picture.h"

namespace heliograph::assets::gltf {
namespace {

// Others are left out with a warning, or refused where the file requires them.
constexpr std::array kHonoured = std::to_array<std::string_view>({
    "EXT_lights_ies",
    "EXT_mesh_gpu_instancing",
    "EXT_meshopt_compression",
    "EXT_texture_webp",
    "KHR_animation_pointer",
    "KHR_draco_mesh_compression",
    "KHR_lights_punctual",
    "KHR_materials_anisotropy",
    "KHR_materials_clearcoat",
    "KHR_materials_diffuse_transmission",
    "KHR_materials_dispersion",
    "KHR_materials_emissive_strength",
    "KHR_materials_ior",
    "KHR_materials_iridescence",
    "KHR_materials_pbrSpecularGlossiness",
    "KHR_materials_sheen",
    "KHR_materials_specular",
    "KHR_materials_transmission",
    "KHR_materials_unlit",
    "KHR_materials_variants",
    "KHR_materials_volume",
    "KHR_mesh_quantization",
    "KHR_node_visibility",
    "KHR_texture_basisu",
    "KHR_texture_transform",
    "KHR_xmp_json_ld",  // does not change what is seen
});

constexpr const char* kMeshopt = "EXT_meshopt_compression";

constexpr u32 kJsonChunk = 0x4E4F534A;
constexpr u32 kBinChunk = 0x004E4942;

u32 word_at(Bytes bytes, std::size_t at) {
  if (at + 4 > bytes.size()) refuse("chunks", "the file is truncated");
  u32 value;
  std::memcpy(&value, bytes.data() + at, 4);
  return value;
}

bool is_data(const Value& uri) { return uri.text().starts_with("data:"); }

nlohmann::json parse_json(Bytes text, const LoadLimits& limits) {
  Budget::check(text.size(), limits.json_bytes, "bytes of JSON", "document");
  const auto* begin = reinterpret_cast<const char*>(text.data());
  nlohmann::json json = nlohmann::json::parse(begin, begin + text.size(), nullptr, false);
  if (json.is_discarded()) refuse("document", "is not valid JSON");
  if (!json.is_object()) refuse("document", "must be a JSON object");
  return json;
}

}  // namespace

Document::Document(Builder& builder) : builder_(builder) {
  parse_container(builder.bundle.model().bytes);
  const std::string version = root().at("asset").at("version").text();
  if (!version.starts_with("2.")) {
    refuse_unimplemented("asset.version", fmt::format("glTF {}; only 2.x is read", version));
  }
  if (const std::string least = root().at("asset").text("minVersion", "2.0"); least != "2.0") {
    refuse_unimplemented("asset.minVersion",
                         fmt::format("glTF {}; only 2.0 is read", clean_name(least, "?")));
  }
  check_extensions();
  load_buffers();
  if (builder_.complete()) unpack_views();
}

void Document::parse_container(Bytes file) {
  const LoadLimits& limits = builder_.options.limits;
  constexpr std::string_view kMagic = "glTF";
  if (file.size() < 4 || std::memcmp(file.data(), kMagic.data(), 4) != 0) {
    json_ = parse_json(file, limits);
    return;
  }
  const u32 version = word_at(file, 4);
  if (version != 2) refuse_unimplemented("glb", fmt::format("GLB version {}", version));
  const u64 length = word_at(file, 8);
  if (length > file.size()) refuse("chunks", "the file is truncated");
  file = file.first(length);
  bool first = true;
  for (std::size_t at = 12; at + 8 <= file.size();) {
    const u64 size = word_at(file, at);
    const u32 type = word_at(file, at + 4);
    at += 8;
    if (size > file.size() - at) refuse("chunks", "a chunk leaves the file");
    if (first != (type == kJsonChunk))
      refuse("chunks", "the first chunk, and only it, must be JSON");
    if (first) json_ = parse_json(file.subspan(at, size), limits);
    if (type == kBinChunk && !glb_chunk_) glb_chunk_ = file.subspan(at, size);
    first = false;
    at += size;
  }
  if (first) refuse("chunks", "the JSON chunk is missing");
}

void Document::check_extensions() const {
  const auto known = [](const Value& name) {
    return std::ranges::find(kHonoured, name.text()) != kHonoured.end();
  };
  for (const Value& name : items("extensionsRequired"))
    if (!known(name))
      refuse_unimplemented(name.where(),
                           fmt::format("the file requires the extension {}; export it without",
                                       clean_name(name.text(), "?")));
  for (const Value& name : items("extensionsUsed"))
    if (!known(name))
      builder_.warn(fmt::format("extension {} is left out", clean_name(name.text(), "?")));
}

void Document::load_buffers() {
  for (u32 i = 0; i < count("buffers"); ++i) {
    const Value buffer = item("buffers", i);
    const u64 length = buffer.at("byteLength").whole();
    const auto meshopt = buffer.extension(kMeshopt);
    if (meshopt && meshopt->flag("fallback", false)) {  // for readers without the extension
      buffers_.emplace_back();
      continue;
    }
    Bytes bytes;
    if (const auto uri = buffer.find("uri")) {
      auto found = own_data(*uri);
      if (!found)
        found = file_bytes(Bundle::resolve(
            builder_.bundle.model().path, percent_decode(uri->text(), uri->where()), uri->where()));
      if (!found) {
        if (builder_.complete())
          refuse(buffer.key_where("uri"),
                 fmt::format("there is no file '{}'", clean_text(uri->text(), 120)),
                 Code::kNotFound);
        buffers_.emplace_back();
        continue;
      }
      bytes = found->bytes;
    } else if (i == 0 && glb_chunk_) {
      bytes = *glb_chunk_;
    } else {
      buffers_.emplace_back();  // refused where something is read from it
      continue;
    }
    if (bytes.size() < length) {
      refuse(buffer.key_where("byteLength"),
             fmt::format("is {}, but the data has {} bytes", length, bytes.size()));
    }
    buffers_.push_back(bytes.first(length));
  }
}

void Document::unpack_views() {
  for (u32 i = 0; i < count("bufferViews"); ++i) {
    const auto packed = item("bufferViews", i).extension(kMeshopt);
    if (!packed) continue;
    owned_.push_back(decode_meshopt(*packed, range_of(*packed), builder_.budget));
    views_[i] = owned_.back();
  }
}

void Document::unpacked(const Value& accessor, Unpacked elements) {
  accessors_[accessor.index(count("accessors"))] = std::move(elements);
}

const Unpacked* Document::find_unpacked(const Value& accessor) const {
  const auto found = accessors_.find(accessor.index(count("accessors")));
  return found == accessors_.end() ? nullptr : &found->second;
}

std::optional<Document::LinkedBytes> Document::own_data(const Value& uri) {
  if (!is_data(uri)) return std::nullopt;
  DataUri data = decode_data_uri(uri.text(), uri.where());
  owned_.push_back(std::move(data.bytes));
  return LinkedBytes{.bytes = owned_.back(), .name = data.media_type};
}

std::optional<Document::LinkedBytes> Document::file_bytes(const std::string& path) {
  const BundleFile* file = builder_.bundle.find(path);
  if (file) return LinkedBytes{.bytes = file->bytes, .name = extension_of(path)};
  builder_.missing(path);
  return std::nullopt;
}

std::string Document::companion(const Value& uri) const {
  return Bundle::companion(builder_.bundle.model().path, percent_decode(uri.text(), uri.where()),
                           uri.where());
}

bool Document::is_lacking(const Value& value) {
  const auto uri = value.find("uri");
  if (!uri || is_data(*uri)) return false;
  const std::string path = companion(*uri);
  if (path.empty()) builder_.warn(fmt::format("{} is empty: it is left out", uri->where()));
  if (builder_.bundle.lacks(path)) builder_.missing(path);
  return path.empty() || builder_.bundle.lacks(path);
}

std::size_t Document::count(const std::string& key) const {
  const auto list = root().find(key);
  return list ? list->size() : 0;
}

Value Document::item(const std::string& key, u32 index) const { return root().at(key)[index]; }

Value Document::named(const std::string& key, const Value& index) const {
  return item(key, index.index(count(key)));
}

Bytes Document::view_bytes(const Value& view, u64 offset, u64 size) const {
  const Bytes bytes = whole_view(view);
  if (offset > bytes.size() || size > bytes.size() - offset) {
    refuse(view.where(), fmt::format("needs bytes {} to {} of a buffer view of {} bytes", offset,
                                     offset + size, bytes.size()));
  }
  return bytes.subspan(offset, size);
}

u64 Document::view_stride(const Value& view) const {
  const Value item_view = named("bufferViews", view);
  const u64 stride = item_view.whole("byteStride", 0);
  if (stride > 252 || (stride != 0 && stride < 4)) {
    refuse(item_view.key_where("byteStride"), "must be 4 to 252");
  }
  return stride;
}

Bytes Document::whole_view(const Value& view) const {
  const u32 index = view.index(count("bufferViews"));
  const auto unpacked = views_.find(index);
  return unpacked == views_.end() ? range_of(item("bufferViews", index)) : unpacked->second;
}

Bytes Document::range_of(const Value& value) const {
  const u32 buffer = value.at("buffer").index(buffers_.size());
  const u64 offset = value.whole("byteOffset", 0);
  const u64 size = value.at("byteLength").whole();
  const Bytes bytes = buffers_[buffer];
  if (bytes.empty() && !item("buffers", buffer).find("uri"))
    refuse(item("buffers", buffer).key_where("uri"),
           "is missing, and there is no GLB chunk for this buffer");
  if (offset > bytes.size() || size > bytes.size() - offset) {
    refuse(value.where(), fmt::format("bytes {} to {} leave the buffer of {} bytes", offset,
                                      offset + size, bytes.size()));
  }
  return bytes.subspan(offset, size);
}

std::optional<Document::LinkedBytes> Document::linked_bytes(const Value& value) {
  if (const auto uri = value.find("uri")) {
    auto found = own_data(*uri);
    if (!found) found = file_bytes(companion(*uri));
    if (found && found->name.empty()) found->name = value.text("mimeType", "");
    return found;
  }
  if (!builder_.complete()) return std::nullopt;  // its buffer may be what is missing
  return LinkedBytes{.bytes = whole_view(value.at("bufferView")),
                     .name = value.text("mimeType", "")};
}

}  // namespace heliograph::assets::gltf
