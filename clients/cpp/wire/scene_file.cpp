// ExportScene to a file, and a file to ImportScene.
#include "wire/scene_file.h"

#include <array>
#include <cstring>
#include <filesystem>
#include <fstream>

#include "wire/session.h"

namespace heliograph::client::wire {
namespace {

const std::string kMagic = "HELIOSC1";
constexpr std::size_t kHeaderBytes = 1 << 20;
constexpr std::uint32_t kLongest = 64 << 20;

[[noreturn]] void refuse(Code code, const std::string& path, const std::string& what) {
  throw ClientError(code, "path: " + path + " " + what, {"path"});
}

/// Reads the chunks of a file, one after another.
class Reader {
 public:
  explicit Reader(const std::string& path) : path_(path), file_(path, std::ios::binary) {
    std::string magic(kMagic.size(), '\0');
    if (!file_) refuse(Code::kNotFound, path, "is not there; correct the path");
    if (!file_.read(magic.data(), std::streamsize(magic.size())) || magic != kMagic)
      refuse(Code::kInvalidArgument, path, "is not a scene file; name one that save() wrote");
  }

  bool next(v1::SceneChunk* out) {
    std::array<unsigned char, 4> prefix{};
    if (!file_.read(reinterpret_cast<char*>(prefix.data()), prefix.size()) && file_.gcount() == 0)
      return false;
    const std::uint32_t length =
        prefix[0] | prefix[1] << 8 | prefix[2] << 16 | std::uint32_t(prefix[3]) << 24;
    std::string bytes(length <= kLongest ? length : 0, '\0');
    if (!file_ || length > kLongest || !file_.read(bytes.data(), std::streamsize(length)) ||
        !out->ParseFromString(bytes))
      refuse(Code::kInvalidArgument, path_, "is cut off or damaged; save the scene again");
    return true;
  }

 private:
  std::string path_;
  std::ifstream file_;
};

/// The header, which may come in pieces; `after` is the chunk that follows it, if one was read.
v1::SceneChunk::Header read_header(Reader& reader, const std::string& path,
                                   std::optional<v1::SceneChunk>* after) {
  std::string pieces;
  v1::SceneChunk chunk;
  while (reader.next(&chunk)) {
    if (chunk.has_header()) return chunk.header();
    if (chunk.part_case() != v1::SceneChunk::kHeaderChunk) {
      *after = chunk;
      break;
    }
    pieces += chunk.header_chunk();
  }
  v1::SceneChunk::Header header;
  if (pieces.empty() || !header.ParseFromString(pieces))
    refuse(Code::kInvalidArgument, path, "has no header; name a file that save() wrote");
  return header;
}

/// False when the daemon has ended the call.
bool write_header(const v1::SceneChunk::Header& header,
                  grpc::ClientWriter<v1::SceneChunk>& writer) {
  const std::string bytes = header.SerializeAsString();
  v1::SceneChunk chunk;
  if (bytes.size() <= kHeaderBytes) {
    *chunk.mutable_header() = header;
    return writer.Write(chunk);
  }
  for (std::size_t at = 0; at < bytes.size(); at += kHeaderBytes) {
    chunk.set_header_chunk(bytes.substr(at, kHeaderBytes));
    if (!writer.Write(chunk)) return false;
  }
  return true;
}

}  // namespace

void save_scene(const SceneCore& scene, const std::string& path,
                std::optional<std::uint64_t> revision) {
  v1::ExportSceneRequest request;
  request.set_scene(scene.id);
  if (revision) request.set_revision(*revision);
  const std::string partial = path + ".partial";
  std::ofstream file(partial, std::ios::binary);
  file << kMagic;
  grpc::ClientContext context;
  scene.session->prepare(context);
  const auto reader = scene.session->stub().ExportScene(&context, request);
  for (v1::SceneChunk chunk; reader->Read(&chunk);) {
    const std::string bytes = chunk.SerializeAsString();
    const auto size = std::uint32_t(bytes.size());
    for (int shift = 0; shift < 32; shift += 8) file.put(char(size >> shift & 0xff));
    file.write(bytes.data(), std::streamsize(bytes.size()));
  }
  const grpc::Status status = reader->Finish();
  file.close();
  std::error_code error;
  if (status.ok() && file) std::filesystem::rename(partial, path, error);
  const bool is_written = file && !error;
  std::filesystem::remove(partial, error);
  scene.session->check(status);
  if (!is_written)
    refuse(Code::kFailedPrecondition, path, "cannot be written; is its folder there?");
}

v1::SceneInfo load_scene(Session& session, const std::string& path, const ImportAs& as) {
  Reader reader(path);
  std::optional<v1::SceneChunk> chunk;
  v1::SceneChunk::Header header = read_header(reader, path, &chunk);
  header.set_request_id(make_request_id());
  header.set_name(as.name);
  header.set_lifetime(v1::Lifetime(int(as.lifetime)));
  grpc::ClientContext context;
  session.prepare(context);
  v1::SceneInfo info;
  const auto writer = session.stub().ImportScene(&context, &info);
  bool goes_on = write_header(header, *writer);
  if (goes_on && chunk) goes_on = writer->Write(*chunk);
  try {
    for (v1::SceneChunk next; goes_on && reader.next(&next);) goes_on = writer->Write(next);
  } catch (...) {
    context.TryCancel();
    writer->Finish();
    throw;
  }
  writer->WritesDone();
  session.check(writer->Finish());
  return info;
}

}  // namespace heliograph::client::wire
