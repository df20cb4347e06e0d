// Hashes in place of data that a recording does not keep. See note.h.
#include "server/observe/note.h"

#include <sys/stat.h>

#include <vector>

#include "server/os/hash.h"

namespace heliograph::server {
namespace {

using google::protobuf::FieldDescriptor;
using google::protobuf::Message;

std::string hash_of(const Frame& frame) {
  Sha256 digest;
  for (const PlaneData& plane : frame.planes)
    digest.add(std::span<const std::byte>(plane.pixels.data(), plane.pixels.size()));
  for (const Column& column : frame.labels) {
    digest.add(column.name);
    digest.add(std::span(column.data));
    for (const std::string& text : column.strings) digest.add(text);
  }
  return digest.finish();
}

/// Replaces each long bytes field by its SHA-256.
void shorten(Message& message) {
  const auto& reflection = *message.GetReflection();
  std::vector<const FieldDescriptor*> fields;
  reflection.ListFields(message, &fields);
  for (const FieldDescriptor* field : fields) {
    const bool is_message = field->cpp_type() == FieldDescriptor::CPPTYPE_MESSAGE;
    if (is_message && field->is_repeated()) {
      for (int i = 0; i < reflection.FieldSize(message, field); ++i)
        shorten(*reflection.MutableRepeatedMessage(&message, field, i));
    } else if (is_message) {
      shorten(*reflection.MutableMessage(&message, field));
    } else if (field->type() == FieldDescriptor::TYPE_BYTES && !field->is_repeated()) {
      std::string bytes = reflection.GetString(message, field);
      if (bytes.size() > kWorthNaming) reflection.SetString(&message, field, sha256(bytes));
    }
  }
}

}  // namespace

u64 bytes_of(const Note& note) {
  u64 bytes = sizeof(Note) + note.bulk.size();
  if (note.item.has_request()) bytes += note.item.request().message().size();
  if (note.item.has_reply()) bytes += note.item.reply().message().size();
  if (note.frame)
    for (const PlaneData& plane : note.frame->planes) bytes += plane.pixels.size();
  struct stat file{};
  if (note.answer) bytes += note.answer->ByteSizeLong();
  if (note.memory && ::fstat(note.memory.get(), &file) == 0) bytes += u64(file.st_size);
  return bytes;
}

void hash(Note& note) {
  if (note.frame) note.item.mutable_frame()->set_sha256(hash_of(*note.frame));
  note.frame.reset();
  if (!note.answer) return;
  shorten(*note.answer);
  std::string bytes = serialize(*note.answer);
  note.answer.reset();
  v1::RecordReply& reply = *note.item.mutable_reply();
  (bytes.size() < kWorthNaming ? *reply.mutable_message() : note.bulk) = std::move(bytes);
}

}  // namespace heliograph::server
