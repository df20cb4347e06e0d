// Read, Query, ExportScene and ImportScene on one small scene.
#include <google/protobuf/text_format.h>
#include <google/protobuf/util/message_differencer.h>

#include <cmath>

#include "renderer/scene/scene.h"
#include "server/convert/export.h"
#include "server/convert/query.h"
#include "server/convert/read.h"
#include "server/scene/scene_import.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr Code kInvalid = Code::kInvalidArgument;

template <class Message>
Message parse(const std::string& text) {
  Message message;
  REQUIRE(google::protobuf::TextFormat::ParseFromString(text, &message));
  return message;
}

/// A grid of n * n vertices, flat.
v1::Mesh grid(u32 n) {
  std::vector<float> positions;
  std::vector<u32> indices;
  for (u32 y = 0; y < n; ++y)
    for (u32 x = 0; x < n; ++x) positions.insert(positions.end(), {float(x), float(y), 0});
  for (u32 y = 0; y + 1 < n; ++y)
    for (u32 x = 0; x + 1 < n; ++x) {
      const u32 i = y * n + x;
      indices.insert(indices.end(), {i, i + 1, i + n, i + 1, i + n + 1, i + n});
    }
  v1::Mesh mesh;
  *mesh.mutable_positions() = f32({n * n, 3}, positions);
  *mesh.mutable_indices() = u32s({indices.size() / 3, 3}, indices);
  return mesh;
}

/// "eye" with a camera, "root" at x = 10 with child "leaf" at x = 1 that shows the mesh "grid".
std::shared_ptr<const Snapshot> make_scene(u32 n = 4) {
  InlineSource source;
  auto message = parse<v1::Transaction>(R"(
    edits { target { name: 'grid' } mesh { } }
    edits { target { name: 'paint' }
            material { roughness { value: 0.25 }
                       base_color { texture { texture { name: 'tex' } } } } }
    edits { target { name: 'eye' }
            entity { camera { width: 64 height: 48 fx: 50 fy: 50 cx: 31.5 cy: 23.5 } } }
    edits { target { name: 'root' } entity { } }
    edits { target { name: 'leaf' }
            entity { parent { name: 'root' } mesh { name: 'grid' }
            materials { parts { name: 'paint' } }
            label { value: 5 category: 'leaf' } light { intensity: 2 } } }
    edits { settings { dome { intensity: 3 color { x: 1 y: 1 z: 1 } } } })");
  auto texture = parse<v1::Edit>("target { name: 'tex' } texture { wrap_u: WRAP_CLAMP }");
  *texture.mutable_texture()->mutable_texels() =
      array_of<u8>(v1::D_TYPE_U8, {2, 2, 3}, {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12});
  v1::Transaction all;
  *all.add_edits() = texture;
  all.MergeFrom(message);
  *all.mutable_edits(1)->mutable_mesh() = grid(n);
  *all.mutable_edits(4)->mutable_entity()->mutable_pose()->mutable_matrices() =
      f32({4, 4}, translations({10}));
  *all.mutable_edits(5)->mutable_entity()->mutable_pose()->mutable_matrices() =
      f32({4, 4}, translations({1}));
  auto transaction = to_transaction(all, source);
  REQUIRE(transaction);
  auto prepared = apply(Snapshot{}, *transaction, {});
  if (!prepared) INFO(prepared.error().where << prepared.error().message);
  REQUIRE(prepared);
  return prepared->snapshot;
}

std::vector<v1::ReadReply> read(const std::string& request, std::shared_ptr<const Snapshot> scene) {
  auto reading = Reading::create(parse<v1::ReadRequest>(request), std::move(scene));
  REQUIRE(reading);
  std::vector<v1::ReadReply> replies;
  for (v1::ReadReply reply; *reading->next(reply);) replies.push_back(reply);
  return replies;
}

std::vector<float> floats(const v1::Array& array) {
  std::vector<float> out(array.inline_().size() / 4);
  std::memcpy(out.data(), array.inline_().data(), array.inline_().size());
  return out;
}

void refused(const auto& result, Code code, const std::string& where, const std::string& says) {
  REQUIRE(!result);
  INFO(result.error().where << ": " << result.error().message);
  CHECK(int(result.error().code) == int(code));
  CHECK(result.error().where == where);
  CHECK(result.error().message.find(says) != std::string::npos);
}

}  // namespace

TEST_CASE("read: poses, boxes and what an entity binds") {
  const auto scene = make_scene();
  const auto replies = read(
      "refs { name: 'root' } refs { name: 'leaf' } "
      "fields: 'pose' fields: 'world_pose' fields: 'aabb' fields: 'materials' fields: 'mesh.uvs'",
      scene);
  REQUIRE(replies.size() == 8);  // root binds no mesh, and the mesh has no uvs
  CHECK(floats(replies[0].array())[3] == 10);
  CHECK(replies[4].ref() == 1);
  CHECK(floats(replies[4].array())[3] == 1);
  CHECK(floats(replies[5].array())[3] == 11);
  CHECK(replies[5].array().shape_size() == 2);
  const std::vector<float> box{11, 0, 0, 14, 3, 0};
  CHECK(floats(replies[2].array()) == box);
  CHECK(floats(replies[6].array()) == box);
  u64 material = 0;
  REQUIRE(replies[7].array().inline_().size() == 8);
  std::memcpy(&material, replies[7].array().inline_().data(), 8);
  CHECK(material == scene->find("paint")->value);
}

TEST_CASE("read: an object is the edit that would make it") {
  const auto scene = make_scene();
  const auto replies = read(
      "refs { name: 'leaf' } fields: 'entity' fields: 'material' fields: 'mesh' fields: 'dome'",
      scene);
  REQUIRE(replies.size() == 4);
  const v1::Entity& entity = replies[0].object().entity();
  CHECK(replies[0].object().target().id() == scene->find("leaf")->value);
  CHECK(entity.parent().id() == scene->find("root")->value);
  CHECK(entity.label().value() == 5);
  CHECK(entity.label().category() == "leaf");
  CHECK(entity.light().intensity() == 2);
  CHECK(!entity.has_camera());
  CHECK(replies[1].object().material().roughness().value() == 0.25f);
  CHECK(replies[1].object().material().ior().value() == 1.5f);
  CHECK(replies[1].object().material().base_color().texture().texture().id() ==
        scene->find("tex")->value);
  CHECK(replies[2].object().mesh().positions().has_inline_());
  CHECK(replies[3].object().settings().dome().intensity() == 3);
  InlineSource source;
  v1::Transaction again;
  for (int i : {0, 1, 2}) *again.add_edits() = replies[std::size_t(i)].object();
  const auto transaction = to_transaction(again, source);
  REQUIRE(transaction);
  CHECK(apply(*scene, *transaction, {}));
}

TEST_CASE("read: a long array comes in pieces") {
  const u32 n = 320;
  const auto replies =
      read("refs { name: 'grid' } fields: 'mesh.positions' fields: 'mesh'", make_scene(n));
  REQUIRE(replies.size() == 3);
  CHECK(replies[0].array().shape(0) == n * n);
  CHECK(replies[0].array().inline_().size() == 1 << 20);
  CHECK(replies[1].offset() == 1 << 20);
  const std::string all = replies[0].array().inline_() + replies[1].array().inline_();
  CHECK(all == grid(n).positions().inline_());
  CHECK(replies[2].object().mesh().positions().source_case() == v1::Array::SOURCE_NOT_SET);
}

TEST_CASE("read: every array of a mesh and of a texture is a field") {
  const auto names = FieldReader::names();
  const auto has = [&](const char* name) { return std::ranges::find(names, name) != names.end(); };
  CHECK(has("mesh.positions"));
  CHECK(has("mesh.skeleton"));
  CHECK(has("texture.texels"));
  const auto scene = make_scene();
  std::string fields;
  for (const auto& name : names)
    if (!name.starts_with("texture")) fields += "fields: '" + name + "' ";
  CHECK(read("refs { name: 'leaf' } " + fields, scene).size() >= 10);
  CHECK(read("refs { name: 'tex' } fields: 'texture.texels'", scene)[0].array().inline_().size() ==
        12);
}

TEST_CASE("read: refusals") {
  const auto scene = make_scene();
  const auto create = [&](const std::string& text) {
    return Reading::create(parse<v1::ReadRequest>(text), scene);
  };
  refused(create("refs { name: 'leaf' }"), kInvalid, "fields", "ask for some of: pose");
  refused(create("refs { name: 'leaf' } fields: 'colour'"), kInvalid, "fields[0]",
          "'colour' does not exist; these do: pose");
  refused(create("refs { name: 'leef' } fields: 'pose'"), Code::kNotFound, "refs[0]", "leef");
  refused(create("fields: 'pose'"), kInvalid, "refs", "name the objects");
  auto reading = create("refs { name: 'grid' } fields: 'pose'");
  REQUIRE(reading);
  v1::ReadReply reply;
  refused(reading->next(reply), kInvalid, "fields[0]", "the mesh 'grid' has no 'pose'");
}

TEST_CASE("query: requests become jobs, or are refused by their path") {
  const auto scene = make_scene();
  InlineSource source;
  const auto query = [&](const v1::QueryRequest& request, u64 items = 1000) {
    return to_query(request, scene, source, {.items = items});
  };
  v1::QueryRequest request;
  refused(query(request), kInvalid, "query", "set one of its cases");
  v1::CastRays* rays = request.mutable_cast_rays();
  *rays->mutable_origins() = f32({2, 3}, {0, 0, 1, 0, 0, 2});
  *rays->mutable_directions() = f32({2, 3}, {0, 0, -1, 0, 0, -2});
  const auto job = query(request);
  REQUIRE(job);
  CHECK(std::get<CastRays>(job->query).origins[1] == vec3(0, 0, 2));
  CHECK(job->time == scene->time);
  auto error = query(request, 1);
  refused(error, Code::kResourceExhausted, "cast_rays.origins", "ask in parts");
  CHECK(error.error().needed == 2);
  *rays->mutable_directions() = f32({2, 3}, {0, 0, -1, 0, 0, 0});
  refused(query(request), kInvalid, "cast_rays.directions[1]", "no usable length");
  *rays->mutable_directions() = f32({1, 3}, {0, 0, -1});
  refused(query(request), kInvalid, "cast_rays.directions.shape", "(N = 2, 3)");
  *request.mutable_pick() = parse<v1::Pick>("camera { name: 'leaf' }");
  refused(query(request), kInvalid, "pick.camera", "'leaf' has no camera");
  *request.mutable_visible() = parse<v1::Visible>("camera { name: 'eye' }");
  refused(query(request), kInvalid, "visible.entities", "at least one entity");
  *request.mutable_overlaps() = parse<v1::Overlaps>("a { name: 'leaf' } b { name: 'grid' }");
  refused(query(request), kInvalid, "overlaps.b[0]", "is not of the kind entity");
  *request.mutable_sample_surface() = parse<v1::SampleSurface>("entities { name: 'leaf' }");
  refused(query(request), kInvalid, "sample_surface.count", "at least one point");
}

TEST_CASE("scene file: a scene comes back as it was, sent whole or in pieces") {
  const auto scene = make_scene(320);
  BlobStore blobs({});
  AssetStore assets;
  SessionArrays arrays(blobs, assets);
  SceneImport import(arrays);
  SceneExport file(*scene);
  int chunks = 0;
  for (v1::SceneChunk chunk; file.next(chunk); ++chunks) {
    if (chunk.has_header()) {
      chunk.mutable_header()->set_name("copy");
      v1::SceneChunk piece;
      const std::string bytes = chunk.header().SerializeAsString();
      piece.set_header_chunk(bytes.substr(0, 100));
      REQUIRE(import.append(piece));
      piece.set_header_chunk(bytes.substr(100));
      REQUIRE(import.append(piece));
    } else {
      REQUIRE(import.append(chunk));
    }
  }
  CHECK(chunks == 1 + 2 + 3);  // header, 1.2 MB of positions, 2.4 MB of indices
  const auto imported = import.finish();
  REQUIRE(imported);
  CHECK(imported->name == "copy");
  const auto copy = rebuild(imported->description, {});
  REQUIRE(copy);
  const auto hashed = [](const BufferPtr& bytes, v1::Array& array) {
    array.set_blob(sha256(bytes->bytes()));
  };
  CHECK(google::protobuf::util::MessageDifferencer::Equals(
      to_proto(describe(*scene).scene, hashed), to_proto(describe(**copy).scene, hashed)));
}

TEST_CASE("scene file: damage is refused") {
  BlobStore blobs({});
  AssetStore assets;
  SessionArrays arrays(blobs, assets);
  std::vector<v1::SceneChunk> chunks;
  SceneExport file(*make_scene(320));
  for (v1::SceneChunk chunk; file.next(chunk);) chunks.push_back(chunk);
  const auto load = [&](const std::vector<v1::SceneChunk>& parts) -> Status {
    SceneImport import(arrays);
    for (const auto& part : parts) HELIO_TRY(import.append(part));
    HELIO_TRY(import.finish());
    return {};
  };
  refused(load({}), kInvalid, "header", "empty or cut short");
  refused(load({chunks[1]}), kInvalid, "chunk", "before the header");
  refused(load({chunks[0], chunks[0]}), kInvalid, "header", "twice");
  refused(load({chunks[0], chunks[1]}), kInvalid, "chunk", "cut short");
  auto flipped = chunks;
  (*flipped[1].mutable_chunk())[7] ^= 1;
  refused(load(flipped), kInvalid, "header.blobs[0].sha256", "not the hash");
  auto other = chunks;
  other[0].mutable_header()->set_format("heliograph.v9");
  refused(load(other), kInvalid, "header.format", "reads 'heliograph.v1'");
  auto more = chunks;
  more.push_back(chunks.back());
  refused(load(more), kInvalid, "chunk", "spans two blobs");
  auto library = chunks;
  library[0].mutable_header()->add_libraries()->set_asset(std::string(32, 'a'));
  library[0].mutable_header()->mutable_libraries(0)->add_objects()->set_name("x");
  refused(load(library), kInvalid, "header.libraries[0].objects[0]", "damaged");
}
