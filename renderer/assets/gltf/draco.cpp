// Source: KHR_draco_mesh_compression.
#include "renderer/assets/gltf/draco.h"

// Its headers have warnings of their own.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wshadow"
#include <draco/compression/decode.h>
#pragma GCC diagnostic pop

namespace heliograph::assets::gltf {
namespace {

constexpr const char* kExtension = "KHR_draco_mesh_compression";

std::unique_ptr<draco::Mesh> decode(const Value& packed, Bytes bytes) {
  draco::DecoderBuffer buffer;
  buffer.Init(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  auto decoded = draco::Decoder().DecodeMeshFromBuffer(&buffer);
  if (!decoded.ok())
    refuse(packed.where(), fmt::format("Draco: {}", decoded.status().error_msg_string()));
  return std::move(decoded).value();
}

template <class T>
void convert(const draco::Mesh& mesh, const draco::PointAttribute& attribute, std::byte* out) {
  const auto width = std::size_t(attribute.num_components());
  std::vector<T> element(width);
  for (draco::PointIndex p(0); p < mesh.num_points(); ++p, out += width * sizeof(T)) {
    attribute.ConvertValue<T>(attribute.mapped_index(p), element.data());
    std::memcpy(out, element.data(), width * sizeof(T));
  }
}

class Unpacker {
 public:
  Unpacker(Document& document, Budget& budget) : document_(document), budget_(budget) {}

  void unpack(const Value& primitive, const Value& packed) {
    if (primitive.whole("mode", 4) != 4)
      refuse_unimplemented(primitive.key_where("mode"),
                           "Draco with another mode than 4 (triangles)");
    const auto mesh = decode(packed, document_.whole_view(packed.at("bufferView")));
    const std::string& where = packed.where();
    Budget::check(mesh->num_points(), budget_.limits().vertices, "vertices", where);
    Budget::check(mesh->num_faces(), budget_.limits().triangles, "triangles", where);
    if (const auto indices = primitive.find("indices")) put_faces(*mesh, *indices);
    const Value accessors = primitive.at("attributes");
    for (const auto& [name, id] : packed.at("attributes").members()) {
      const auto* attribute = mesh->GetAttributeByUniqueId(u32(id.whole()));
      if (!attribute)
        refuse(id.where(), fmt::format("the Draco mesh has no attribute {}", id.whole()));
      put_attribute(*mesh, *attribute, accessors.at(name));
    }
  }

 private:
  void put_faces(const draco::Mesh& mesh, const Value& accessor) {
    budget_.take(mesh.num_faces(), sizeof(uvec3), accessor.where());
    std::vector<std::byte> bytes(mesh.num_faces() * sizeof(uvec3));
    for (u32 i = 0; i < mesh.num_faces(); ++i) {
      const auto& face = mesh.face(draco::FaceIndex(i));
      const uvec3 t(face[0].value(), face[1].value(), face[2].value());
      std::memcpy(&bytes[i * sizeof t], &t, sizeof t);
    }
    document_.unpacked(
        accessor,
        {.bytes = std::move(bytes), .count = u64(mesh.num_faces()) * 3, .type = Component::kU32});
  }

  void put_attribute(const draco::Mesh& mesh, const draco::PointAttribute& attribute,
                     const Value& accessor) {
    const u32 width = accessor_components(document_, accessor);
    if (u32(attribute.num_components()) != width) {
      refuse(accessor.where(), fmt::format("has {} components, in the Draco mesh it has {}", width,
                                           attribute.num_components()));
    }
    const Component type = accessor_type(document_, accessor);
    const u64 count = mesh.num_points();
    budget_.take(count, u64(width) * bytes_of(type), accessor.where());
    std::vector<std::byte> bytes(count * width * bytes_of(type));
    with_type(type, [&]<class T>(T) { convert<T>(mesh, attribute, bytes.data()); });
    document_.unpacked(accessor, {.bytes = std::move(bytes), .count = count, .type = type});
  }

  Document& document_;
  Budget& budget_;
};

}  // namespace

void unpack_draco(Document& document, Budget& budget) {
  Unpacker unpacker(document, budget);
  for (const Value& mesh : document.items("meshes"))
    for (const Value& primitive : mesh.at("primitives").elements())
      if (const auto packed = primitive.extension(kExtension)) unpacker.unpack(primitive, *packed);
}

}  // namespace heliograph::assets::gltf
