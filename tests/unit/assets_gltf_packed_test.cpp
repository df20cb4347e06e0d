// glTF meshes that the encoders of Draco and meshoptimizer packed, beside the same mesh unpacked.
#include <meshoptimizer.h>
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wall"
#pragma GCC diagnostic ignored "-Wextra"
#pragma GCC diagnostic ignored "-Wpedantic"
#pragma GCC diagnostic ignored "-Wshadow"
#include <draco/compression/encode.h>
#pragma GCC diagnostic pop

#include "renderer/assets/load.h"
#include "tests/unit/asset_fixture.h"
#include "tests/unit/catch.h"

using namespace heliograph;
using Catch::Matchers::Contains;

namespace {

/// A bumpy grid of 4 x 4 vertices.
struct Bumps {
  std::vector<vec3> positions, normals;
  std::vector<vec2> uvs;
  std::vector<glm::u8vec4> colors;
  std::vector<u32> indices;

  Bumps() {
    for (u32 i = 0; i < 16; ++i) {
      const u32 x = i % 4, y = i / 4;
      positions.emplace_back(float(x), float(y) * 0.5f, float(i * i % 7) / 3);
      normals.push_back(glm::normalize(vec3(float(x) - 1.5f, float(y) - 1.5f, 2)));
      uvs.emplace_back(float(x) / 3, float(y) / 3);
      colors.emplace_back(16 * i, 255 - 16 * i, i, 255);
      if (x == 3 || y == 3) continue;
      indices.insert(indices.end(), {i, i + 1, i + 5, i, i + 5, i + 4});
    }
  }
};

constexpr const char* kAttributes = R"("POSITION":0,"NORMAL":1,"TEXCOORD_0":2,"COLOR_0":3)";

std::string one_mesh(const std::string& more, const std::string& document = "") {
  return fmt::format(
      R"("meshes":[{{"primitives":[{{"attributes":{{{}}},"indices":4{}}}]}}],"nodes":[{{"mesh":0}}]{})",
      kAttributes, more, document);
}

/// Positions, normals, uvs and colours of each triangle's corners, in an order of their own.
using Corner = std::array<float, 12>;
std::vector<std::array<Corner, 3>> surface(const Expected<Loaded>& loaded) {
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  const auto corner = [&](u32 v) {
    const vec3 p = mesh.vertices->positions[v], n = mesh.vertices->normals[v];
    const vec2 uv = mesh.topology->uvs[v];
    const vec4 c = mesh.topology->colors[v];
    return Corner{p.x, p.y, p.z, n.x, n.y, n.z, uv.x, uv.y, c.x, c.y, c.z, c.w};
  };
  std::vector<std::array<Corner, 3>> all;
  for (const uvec3& t : mesh.topology->triangles) {
    std::array<Corner, 3> triangle = {corner(t.x), corner(t.y), corner(t.z)};
    std::rotate(triangle.begin(), std::ranges::min_element(triangle), triangle.end());
    all.push_back(triangle);
  }
  std::ranges::sort(all);
  return all;
}

Expected<Loaded> load_plain(const Bumps& bumps) {
  GltfFile file;
  const auto view = [&](const auto& values, const std::string& accessor) {
    const u32 index = file.view(std::as_bytes(std::span(values)));
    file.raw(fmt::format(R"({{"bufferView":{},"count":{},{}}})", index, values.size(), accessor));
  };
  view(bumps.positions, R"("componentType":5126,"type":"VEC3")");
  view(bumps.normals, R"("componentType":5126,"type":"VEC3")");
  view(bumps.uvs, R"("componentType":5126,"type":"VEC2")");
  view(bumps.colors, R"("componentType":5121,"type":"VEC4","normalized":true)");
  view(bumps.indices, R"("componentType":5125,"type":"SCALAR")");
  return file.load(one_mesh(""));
}

// ---------------------------------------------------------------- Draco

template <class T>
void add_attribute(draco::Mesh& mesh, draco::GeometryAttribute::Type kind, draco::DataType type,
                   const std::vector<T>& values) {
  const auto width = std::int8_t(sizeof(T) / std::size_t(draco::DataTypeLength(type)));
  draco::GeometryAttribute layout;
  layout.Init(kind, nullptr, width, type, type == draco::DT_UINT8, sizeof(T), 0);
  const int id = mesh.AddAttribute(layout, true, u32(values.size()));
  for (u32 i = 0; i < values.size(); ++i)
    mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), &values[i]);
}

std::vector<std::byte> draco_bytes(const Bumps& bumps, draco::MeshEncoderMethod method) {
  draco::Mesh mesh;
  mesh.set_num_points(u32(bumps.positions.size()));
  for (std::size_t i = 0; i < bumps.indices.size(); i += 3) {
    mesh.AddFace({draco::PointIndex(bumps.indices[i]), draco::PointIndex(bumps.indices[i + 1]),
                  draco::PointIndex(bumps.indices[i + 2])});
  }
  add_attribute(mesh, draco::GeometryAttribute::POSITION, draco::DT_FLOAT32, bumps.positions);
  add_attribute(mesh, draco::GeometryAttribute::NORMAL, draco::DT_FLOAT32, bumps.normals);
  add_attribute(mesh, draco::GeometryAttribute::TEX_COORD, draco::DT_FLOAT32, bumps.uvs);
  add_attribute(mesh, draco::GeometryAttribute::COLOR, draco::DT_UINT8, bumps.colors);
  draco::Encoder encoder;
  encoder.SetEncodingMethod(method);
  draco::EncoderBuffer buffer;
  REQUIRE(encoder.EncodeMeshToBuffer(mesh, &buffer).ok());
  return as_bytes_of({buffer.data(), buffer.size()});
}

/// The accessors say nothing of where they are; `ids` says which Draco attribute each one is.
Expected<Loaded> load_draco(std::span<const std::byte> bytes, const std::string& ids = kAttributes,
                            const std::string& primitive = "") {
  GltfFile file;
  file.view(bytes);
  file.raw(R"({"componentType":5126,"type":"VEC3","count":16})");
  file.raw(R"({"componentType":5126,"type":"VEC3","count":16})");
  file.raw(R"({"componentType":5126,"type":"VEC2","count":16})");
  file.raw(R"({"componentType":5121,"type":"VEC4","count":16,"normalized":true})");
  file.raw(R"({"componentType":5123,"type":"SCALAR","count":54})");
  const std::string packed = R"(,"extensions":{"KHR_draco_mesh_compression":{"bufferView":0,)"
                             R"("attributes":{)" +
                             ids + "}}}" + primitive;
  return file.load(one_mesh(packed, R"(,"extensionsRequired":["KHR_draco_mesh_compression"])"));
}

// ---------------------------------------------------------------- meshoptimizer

struct PackedView {
  std::vector<std::byte> bytes;
  std::string mode, filter = "NONE";
  std::size_t count = 0, stride = 0;
};

template <class T>
PackedView pack(const std::vector<T>& values, const std::string& filter = "NONE") {
  PackedView view{
      .mode = "ATTRIBUTES", .filter = filter, .count = values.size(), .stride = sizeof(T)};
  view.bytes.resize(meshopt_encodeVertexBufferBound(values.size(), sizeof(T)));
  auto* out = reinterpret_cast<unsigned char*>(view.bytes.data());
  view.bytes.resize(
      meshopt_encodeVertexBuffer(out, view.bytes.size(), values.data(), values.size(), sizeof(T)));
  return view;
}

PackedView pack_indices(const std::vector<u32>& indices, bool triangles) {
  PackedView view{
      .mode = triangles ? "TRIANGLES" : "INDICES", .count = indices.size(), .stride = 4};
  const auto bound = triangles ? meshopt_encodeIndexBufferBound : meshopt_encodeIndexSequenceBound;
  const auto encode =
      triangles
          ? [](unsigned char* out, std::size_t size, const u32* from,
               std::size_t count) { return meshopt_encodeIndexBuffer(out, size, from, count); }
          : [](unsigned char* out, std::size_t size, const u32* from, std::size_t count) {
              return meshopt_encodeIndexSequence(out, size, from, count);
            };
  view.bytes.resize(bound(indices.size(), 16));
  view.bytes.resize(encode(reinterpret_cast<unsigned char*>(view.bytes.data()), view.bytes.size(),
                           indices.data(), indices.size()));
  return view;
}

/// A document whose accessors 0 .. 4 are these views; buffer 1 is what other readers would take,
/// and is not there.
Expected<Loaded> load_meshopt(const std::vector<PackedView>& views,
                              const std::vector<std::string>& accessors) {
  std::vector<std::byte> data;
  std::string json =
      R"({"asset":{"version":"2.0"},"extensionsRequired":["EXT_meshopt_compression"],"bufferViews":[)";
  for (const PackedView& view : views) {
    json += fmt::format(
        R"({}{{"buffer":1,"byteLength":{}{},"extensions":{{"EXT_meshopt_compression":{{"buffer":0,)"
        R"("byteOffset":{},"byteLength":{},"byteStride":{},"count":{},"mode":"{}","filter":"{}"}}}}}})",
        &view == views.data() ? "" : ",", view.count * view.stride,
        view.mode == "ATTRIBUTES" ? fmt::format(R"(,"byteStride":{})", view.stride) : "",
        data.size(), view.bytes.size(), view.stride, view.count, view.mode, view.filter);
    data.insert(data.end(), view.bytes.begin(), view.bytes.end());
  }
  json += R"(],"accessors":[)";
  for (std::size_t i = 0; i < views.size(); ++i) {
    json += fmt::format(R"({}{{"bufferView":{},"count":{},{}}})", i ? "," : "", i, views[i].count,
                        accessors[i]);
  }
  json += fmt::format(
      R"(],"buffers":[{{"uri":"data.bin","byteLength":{}}},{{"byteLength":9999,"uri":"fallback.bin",)"
      R"("extensions":{{"EXT_meshopt_compression":{{"fallback":true}}}}}}],)",
      data.size());
  TestBundle bundle;
  bundle.add("m.gltf", json + one_mesh("") + "}");
  bundle.add("data.bin", data);
  return bundle.load();
}

const std::vector<std::string> kLayouts = {
    R"("componentType":5126,"type":"VEC3")", R"("componentType":5126,"type":"VEC3")",
    R"("componentType":5126,"type":"VEC2")",
    R"("componentType":5121,"type":"VEC4","normalized":true)",
    R"("componentType":5125,"type":"SCALAR")"};

std::vector<PackedView> packed(const Bumps& bumps) {
  return {pack(bumps.positions), pack(bumps.normals), pack(bumps.uvs), pack(bumps.colors),
          pack_indices(bumps.indices, true)};
}

}  // namespace

TEST_CASE("gltf: a mesh that Draco packed is the mesh") {
  const Bumps bumps;
  const auto plain = surface(load_plain(bumps));
  CHECK(plain.size() == 18);
  for (const auto method : {draco::MESH_SEQUENTIAL_ENCODING, draco::MESH_EDGEBREAKER_ENCODING}) {
    CAPTURE(int(method));
    CHECK(surface(load_draco(draco_bytes(bumps, method))) == plain);
  }
}

TEST_CASE("gltf: a Draco file of others has the box that it says") {
  const auto loaded = bundle_of(test_assets() / "gltf/heart_draco.glb").load();
  INFO(refusal(loaded));
  REQUIRE(loaded);
  CHECK(loaded->warnings.empty());
  vec3 low(1e9f), high(-1e9f);
  for (const vec3& p : library_item<PutMesh>(*loaded).vertices->positions) {
    low = glm::min(low, p);
    high = glm::max(high, p);
  }
  // The file's accessors[1].min and .max.
  CHECK(glm::distance(low, vec3(-0.4012973f, -0.1975008f, -0.3178300f)) < 1e-3f);
  CHECK(glm::distance(high, vec3(0.4020048f, 0.1983432f, 0.3537236f)) < 1e-3f);
}

TEST_CASE("gltf: broken Draco is refused by name") {
  const std::vector<std::byte> good = draco_bytes(Bumps(), draco::MESH_EDGEBREAKER_ENCODING);
  const std::string where = "meshes[0].primitives[0].extensions.KHR_draco_mesh_compression";
  CHECK_THAT(refusal(load_draco(std::span(good).first(20))), Contains(where + ": Draco: "));
  CHECK_THAT(refusal(load_draco(good, R"("POSITION":9)")), Contains("has no attribute 9"));
  CHECK_THAT(refusal(load_draco(good, R"("POSITION":2)")),
             Contains("has 3 components, in the Draco mesh it has 2"));
  CHECK_THAT(refusal(load_draco(good, R"("TANGENT":0)")), Contains("TANGENT"));
  CHECK_THAT(refusal(load_draco(good, kAttributes, R"(,"mode":5)")), Contains("mode"));
}

TEST_CASE("gltf: a mesh that meshoptimizer packed is the mesh") {
  const Bumps bumps;
  const auto plain = surface(load_plain(bumps));
  std::vector<PackedView> views = packed(bumps);
  CHECK(surface(load_meshopt(views, kLayouts)) == plain);
  views[4] = pack_indices(bumps.indices, false);
  CHECK(surface(load_meshopt(views, kLayouts)) == plain);
}

TEST_CASE("gltf: meshoptimizer's filters") {
  const Bumps bumps;
  std::vector<PackedView> views = packed(bumps);
  std::vector<std::string> layouts = kLayouts;
  std::vector<vec4> wide;
  for (const vec3& n : bumps.normals) wide.emplace_back(n, 0);
  std::vector<glm::i8vec4> octahedral(16);
  meshopt_encodeFilterOct(octahedral.data(), 16, 4, 8, &wide[0].x);
  views[1] = pack(octahedral, "OCTAHEDRAL");
  layouts[1] = R"("componentType":5120,"type":"VEC3","normalized":true)";
  std::vector<vec3> exponential(16);
  meshopt_encodeFilterExp(exponential.data(), 16, 12, 16, &bumps.positions[0].x);
  views[0] = pack(exponential, "EXPONENTIAL");
  const auto loaded = load_meshopt(views, layouts);
  INFO(refusal(loaded));
  REQUIRE(loaded);
  const PutMesh& mesh = library_item<PutMesh>(*loaded);
  for (std::size_t v = 0; v < 16; ++v) {
    CHECK(glm::distance(mesh.vertices->normals[v], bumps.normals[v]) < 0.02f);
    CHECK(glm::distance(mesh.vertices->positions[v], bumps.positions[v]) < 1e-3f);
  }
}

TEST_CASE("gltf: broken views of meshoptimizer are refused by name") {
  const auto refused = [](const auto& change) {
    std::vector<PackedView> views = packed(Bumps());
    change(views);
    return refusal(load_meshopt(views, kLayouts));
  };
  const std::string where = "bufferViews[0].extensions.EXT_meshopt_compression";
  CHECK(refused([](auto&) {}).empty());
  CHECK_THAT(refused([](auto& views) { views[0].bytes.resize(9); }),
             Contains(where + ": is broken"));
  CHECK_THAT(refused([](auto& views) { views[0].mode = "POINTS"; }), Contains(where + ".mode"));
  CHECK_THAT(refused([](auto& views) { views[0].stride = 6; }), Contains(where + ".byteStride"));
  CHECK_THAT(refused([](auto& views) { views[0].filter = "QUATERNION"; }), Contains("must be 8"));
  CHECK_THAT(refused([](auto& views) { views[0].filter = "COLOR"; }), Contains(".filter: must be"));
  CHECK_THAT(refused([](auto& views) { views[4].filter = "OCTAHEDRAL"; }), Contains("NONE"));
  CHECK_THAT(refused([](auto& views) { views[4].count = 52; }), Contains("multiple of 3"));
  CHECK_THAT(refused([](auto& views) { views[0].count = 1 << 30; }), Contains("8 m.gltf"));
}
