// Blobs, uploads and assets: who keeps them alive, what they cost, what is refused.
#include <google/protobuf/text_format.h>

#include "server/convert/asset.h"
#include "server/os/hash.h"
#include "server/store/session_arrays.h"
#include "tests/unit/catch.h"
#include "tests/unit/convert_fixture.h"

using namespace heliograph;
using namespace heliograph::server;

namespace {

constexpr u64 kOverhead = 256;

v1::UploadBlobRequest first(const std::string& id, const std::string& hash, u64 size) {
  v1::UploadBlobRequest request;
  request.set_request_id(id);
  request.set_sha256(hash);
  request.set_size(size);
  return request;
}

/// Uploads `bytes` under their hash, or under `id`.
Status upload(SessionArrays& arrays, const std::string& bytes, const std::string& id = "") {
  const auto request = first(id, id.empty() ? sha256(bytes) : "", bytes.size());
  auto incoming = arrays.begin(request);
  if (!incoming) return std::unexpected(incoming.error());
  if (!*incoming) return {};
  for (std::size_t i = 0; i < bytes.size(); i += 5)
    if (auto status = (*incoming)->append(std::string_view(bytes).substr(i, 5)); !status)
      return status;
  return arrays.finish(request, std::move(**incoming));
}

std::string text(const BufferPtr& buffer) {
  return {reinterpret_cast<const char*>(buffer->bytes().data()), buffer->bytes().size()};
}

v1::Array of_upload(const std::string& id) {
  v1::Array array;
  array.set_upload(id);
  return array;
}

void refused(const auto& result, Code code, const std::string& where, const std::string& says) {
  REQUIRE(!result);
  INFO(result.error().where << ": " << result.error().message);
  CHECK(int(result.error().code) == int(code));
  CHECK(result.error().where == where);
  CHECK(result.error().message.find(says) != std::string::npos);
}

}  // namespace

TEST_CASE("hash: SHA-256 of the standard's example") {
  CHECK(sha256("abc").substr(0, 4) == "\xba\x78\x16\xbf");
  Sha256 pieces;
  pieces.add("a");
  pieces.add("bc");
  CHECK(pieces.finish() == sha256("abc"));
}

TEST_CASE("stores: equal bytes are one buffer, kept by sessions and by whoever refers to it") {
  BlobStore blobs({});
  AssetStore assets;
  const std::string hash = sha256("hello blob");
  BufferPtr kept;
  {
    SessionArrays a(blobs, assets), b(blobs, assets);
    REQUIRE(upload(a, "hello blob"));
    kept = *a.blob(hash);
    CHECK(text(kept) == "hello blob");
    REQUIRE(upload(b, "hello blob"));
    CHECK((*b.blob(hash))->serial() == kept->serial());
    CHECK(blobs.budget()->used() == 10 + kOverhead);
  }
  CHECK(blobs.find(hash) == kept);
  kept = nullptr;
  CHECK(blobs.find(hash) == nullptr);
  CHECK(blobs.budget()->used() == 0);
}

TEST_CASE("stores: a blob that one session uploaded lives on in another that announced it") {
  BlobStore blobs({});
  AssetStore assets;
  SessionArrays b(blobs, assets);
  {
    SessionArrays a(blobs, assets);
    REQUIRE(upload(a, "shared"));
    REQUIRE(upload(b, "shared"));
  }
  CHECK(b.blob(sha256("shared")));
}

TEST_CASE("stores: an anonymous upload is consumed by its use and private to its session") {
  BlobStore blobs({});
  AssetStore assets;
  SessionArrays a(blobs, assets), b(blobs, assets);
  REQUIRE(upload(a, "vertices", "r1"));
  REQUIRE(upload(a, "vertices", "r1"));
  refused(b.bytes(of_upload("r1")), Code::kNotFound, "upload", "no upload 'r1'");
  const auto bytes = a.bytes(of_upload("r1"));
  REQUIRE(bytes);
  CHECK(text(*bytes) == "vertices");
  refused(a.bytes(of_upload("r1")), Code::kNotFound, "upload", "a use consumes it");
  CHECK(blobs.find(sha256("vertices")) == nullptr);
}

TEST_CASE("stores: refusals of uploads") {
  BlobStore blobs({.bytes = 1000, .blob_bytes = 600, .inline_bytes = 16});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  refused(a.begin(first("", "", 5)), Code::kInvalidArgument, "request_id", "name the upload");
  refused(a.begin(first("", "short", 5)), Code::kInvalidArgument, "sha256", "SHA-256 has 32");
  refused(a.begin(first("x", "", 601)), Code::kResourceExhausted, "size", "one blob may have 600");
  auto wrong = a.begin(first("", std::string(32, 'x'), 3));
  REQUIRE((wrong && *wrong));
  REQUIRE((*wrong)->append("abc"));
  refused((*wrong)->append("d"), Code::kInvalidArgument, "size", "announced 3 bytes");
  refused(a.finish(first("", std::string(32, 'x'), 3), std::move(**wrong)), Code::kInvalidArgument,
          "sha256", "not the hash");
  *wrong = std::nullopt;
  auto cut = a.begin(first("y", "", 3));
  REQUIRE((cut && *cut));
  refused(a.finish(first("y", "", 3), std::move(**cut)), Code::kInvalidArgument, "size", "0 came");
  *cut = std::nullopt;
  CHECK(blobs.budget()->used() == 0);

  auto half = a.begin(first("z", "", 500));
  REQUIRE(half);
  const auto full = a.begin(first("w", "", 500));
  refused(full, Code::kResourceExhausted, "size", "needs 756 bytes, 244 are available");
  CHECK(full.error().needed == 500 + kOverhead);
  CHECK(full.error().available == 1000 - 500 - kOverhead);
}

TEST_CASE("stores: an upload is charged what came and a window ahead") {
  BlobStore blobs({.bytes = 2000, .blob_bytes = 1500, .window_bytes = 100, .inline_bytes = 16});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  auto slow = a.begin(first("slow", "", 1500));
  REQUIRE((slow && *slow));
  CHECK(blobs.budget()->used() == 100 + kOverhead);
  REQUIRE((*slow)->append(std::string(50, 'x')));
  CHECK(blobs.budget()->used() == 100 + kOverhead);
  REQUIRE((*slow)->append(std::string(300, 'x')));
  CHECK(blobs.budget()->used() == 450 + kOverhead);
  auto other = a.begin(first("other", "", 1000));  // room that nothing came for
  REQUIRE((other && *other));
  REQUIRE((*other)->append(std::string(1000, 'y')));
  REQUIRE(a.finish(first("other", "", 1000), std::move(**other)));
  *other = std::nullopt;
  refused((*slow)->append(std::string(400, 'x')), Code::kResourceExhausted, "size", "available");
  *slow = std::nullopt;
  CHECK(blobs.budget()->used() == 1000 + kOverhead);
}

TEST_CASE("stores: refusals of arrays") {
  BlobStore blobs({.inline_bytes = 16});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  v1::Array array;
  refused(a.bytes(array), Code::kInvalidArgument, "", "set inline, blob, upload or buffer");
  array.set_inline_(std::string(17, 'x'));
  refused(a.bytes(array), Code::kInvalidArgument, "inline", "upload arrays of more than 16");
  array.set_blob("abc");
  refused(a.bytes(array), Code::kInvalidArgument, "blob", "SHA-256 has 32");
  array.set_blob(std::string(32, '\x01'));
  refused(a.bytes(array), Code::kNotFound, "blob", "no bytes of sha256 0101");
  array.mutable_buffer()->set_buffer(7);
  refused(a.bytes(array), Code::kNotFound, "buffer.buffer", "no buffer 7");
  refused(a.asset(std::string(32, 'a')), Code::kNotFound, "", "DecodeAsset");
}

TEST_CASE("stores: bytes of our own become a blob") {
  BlobStore blobs({});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  const std::string hash = a.hold(copy_bytes("texels"));
  CHECK(hash == sha256("texels"));
  CHECK(text(*a.blob(hash)) == "texels");
}

TEST_CASE("stores: what was named goes by bytes, what was not waits for its use") {
  BlobStore blobs({.recent = {.seconds = 1000, .bytes = 20}});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  for (const char* bytes : {"first ten.", "second ten", "third ten."}) REQUIRE(upload(a, bytes));
  v1::Array array;
  for (const char* bytes : {"first ten.", "second ten", "third ten."}) {
    array.set_blob(sha256(bytes));
    REQUIRE(a.bytes(array));
  }
  CHECK(a.blob(sha256("first ten.")));  // one request may name it again
  a.sweep();
  refused(a.blob(sha256("first ten.")), Code::kNotFound, "", "upload it again");
  CHECK(a.blob(sha256("second ten")));
  CHECK(blobs.budget()->used() == 2 * (10 + kOverhead));
}

TEST_CASE("stores: what something refers to is there as long as that") {
  BlobStore blobs({.recent = {.seconds = 1000, .bytes = 1}});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  REQUIRE(upload(a, "in a scene"));
  v1::Array array;
  array.set_blob(sha256("in a scene"));
  BufferPtr scene = *a.bytes(array);
  REQUIRE(upload(a, "another"));
  array.set_blob(sha256("another"));
  REQUIRE(a.bytes(array));
  a.sweep();
  CHECK(a.blob(sha256("in a scene")));
  scene = nullptr;
  CHECK_FALSE(a.blob(sha256("in a scene")));
}

TEST_CASE("stores: room for an upload is made from what was named") {
  BlobStore blobs({.bytes = 1000, .recent = {.seconds = 1000, .bytes = 1000}});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  const std::string old(600, 'a');
  REQUIRE(upload(a, old));
  CHECK_FALSE(upload(a, std::string(600, 'b')));  // what was not named yet stays
  v1::Array array;
  array.set_blob(sha256(old));
  REQUIRE(a.bytes(array));
  CHECK(upload(a, std::string(600, 'b')));
}

TEST_CASE("recent: a grace time after the last upload, and after each use") {
  using Kind = Recent::Kind;
  const auto start = Recent::Clock::now();
  const auto at = [&](int seconds) { return start + std::chrono::seconds(seconds); };
  Recent recent({.seconds = 30, .bytes = 1000});
  recent.bring(Kind::kBlob, "a", copy_bytes("a"), 1);
  recent.bring(Kind::kUpload, "a", copy_bytes("b"), 1);
  recent.use(Kind::kAsset, "a", copy_bytes("c"), 1);
  CHECK(recent.sweep(false, at(29)).empty());
  CHECK(recent.sweep(true, at(32)).size() == 1);  // more is on its way: only the named one goes
  CHECK(recent.find(Kind::kBlob, "a"));
  CHECK(recent.sweep(false, at(32)).size() == 2);
  CHECK_FALSE(recent.find(Kind::kUpload, "a"));
}

TEST_CASE("stores: assets live as long as a session holds them") {
  BlobStore blobs({});
  AssetStore assets;
  const std::string hash(32, 'a');
  {
    SessionArrays a(blobs, assets);
    auto stored = std::make_shared<StoredAsset>();
    stored->asset = std::make_shared<const Asset>(Asset{.hash = hash});
    stored->info = to_info(*stored->asset, vec3(0), vec3(1));
    CHECK(a.hold(stored) == stored);
    SessionArrays b(blobs, assets);
    CHECK(b.asset(hash));
    CHECK(b.find_asset(hash) == stored);
  }
  CHECK(assets.find(hash) == nullptr);
}

TEST_CASE("stores: a picture goes once its texels were used, though others are decoded meanwhile") {
  BlobStore blobs({.recent = {.seconds = 1000, .bytes = 100}});
  AssetStore assets;
  SessionArrays a(blobs, assets);
  for (int i = 0; i < 5; ++i) {
    const std::string texels(60, char('a' + i));
    REQUIRE(upload(a, texels));
    auto stored = std::make_shared<StoredAsset>();
    stored->texels = *a.blob(sha256(texels));
    stored->info.set_sha256(std::string(32, char('A' + i)));
    stored->info.mutable_texels()->set_blob(sha256(texels));
    stored->bytes = texels.size();
    (void)a.hold(std::move(stored));
    a.sweep();
    CHECK(a.blob(sha256(texels)));  // it waits for its edit
    v1::Array array;
    array.set_blob(sha256(texels));
    REQUIRE(a.bytes(array));
    a.sweep();
  }
  CHECK(blobs.budget()->used() == 60 + kOverhead);
}

TEST_CASE("stores: an asset is named by its files and options") {
  v1::DecodeAssetRequest request;
  request.add_files()->set_path("a.glb");
  const std::string hash = asset_hash(request);
  request.set_server_path("/models/a.glb");
  CHECK(asset_hash(request) == hash);
  request.set_up(v1::DecodeAssetRequest::AXIS_Z);
  CHECK(asset_hash(request) != hash);
}

TEST_CASE("stores: what a client is told about an asset") {
  Asset asset{.hash = std::string(32, 'h')};
  asset.library = {{.target = std::string("steel"), .action = PutMaterial{}},
                   {.target = std::string("body"), .action = PutMesh{}}};
  asset.entities = {{.action = PutEntity{}},
                    {.target = std::string("eye"), .action = PutEntity{.camera = Camera{}}}};
  asset.animations = {{"walk", {}}};
  const v1::AssetInfo info = to_info(asset, vec3(-1), vec3(1, 2, 3));
  CHECK(info.materials(0) == "steel");
  CHECK(info.meshes(0) == "body");
  CHECK(info.entities_size() == 2);
  CHECK(info.cameras(0) == "eye");
  CHECK(info.animations(0) == "walk");
  CHECK(info.bounds().shape(1) == 3);
}
