// Note: an item of a recording, and the data that its hashes are of.
#pragma once

#include <memory>
#include <string>

#include "heliograph/v1/recording.pb.h"
#include "renderer/frame/frame.h"
#include "server/os/unique_fd.h"

namespace heliograph::server {

constexpr std::size_t kWorthNaming = 4 << 10;  // bytes; what is shorter may stand there twice

struct Note {
  v1::RecordItem item;
  std::string bulk = {};                         // of a request or reply; stored by its hash
  std::shared_ptr<const Frame> frame = nullptr;  // of a frame; hashed
  std::unique_ptr<google::protobuf::Message> answer = nullptr;  // to a question; hashed
  UniqueFd memory = {};                                         // of a buffer; its bytes are stored
};

/// Bytes that it holds in memory.
u64 bytes_of(const Note& note);

/// Puts the hashes of its frame or answer in their place, as recording.proto says. Most of a note's
/// cost: 60 ms for 12 MB on a CPU without instructions for it.
void hash(Note& note);

}  // namespace heliograph::server
