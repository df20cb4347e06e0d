// An item of a recording, with the data that its hashes refer to.
#pragma once

#include <memory>
#include <string>

#include "heliograph/v1/recording.pb.h"
#include "renderer/frame/frame.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

constexpr std::size_t kWorthNaming = 4 << 10;  // bytes; shorter data may be stored twice

struct Note {
  v1::RecordItem item;
  std::string bulk = {};  // bulk of a request or reply; stored once by its hash
  std::shared_ptr<const Frame> frame = nullptr;                 // a frame; only hashed
  std::unique_ptr<google::protobuf::Message> answer = nullptr;  // answer to a query; only hashed
  UniqueFd memory = {};  // memory of a buffer; its bytes are stored
};

/// Returns the bytes that a note holds in memory.
u64 bytes_of(const Note& note);

/// Fills in the hashes of its frame or answer, as in recording.proto. The main cost of a note: 60
/// ms for 12 MB on a CPU without SHA instructions.
void hash(Note& note);

}  // namespace heliograph::server
