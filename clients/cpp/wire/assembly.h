// Frames out of their parts: pixels are copied once, from the wire into their array.
#pragma once

#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cstdint>
#include <cstring>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "heliograph/error.h"
#include "heliograph/frame.h"
#include "heliograph/render.h"
#include "heliograph/v1/service.grpc.pb.h"

namespace heliograph::client::wire {

/// Reads the bytes of a message, which lie in several slices.
class Cursor {
 public:
  explicit Cursor(const grpc::ByteBuffer& buffer) { buffer.Dump(&slices_); }

  [[nodiscard]] bool at_end() {
    while (slice_ < slices_.size() && at_ == slices_[slice_].size()) {
      ++slice_;
      at_ = 0;
    }
    return slice_ == slices_.size();
  }
  std::uint8_t byte() { return at_end() ? std::uint8_t(0) : slices_[slice_].begin()[at_++]; }
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64; shift += 7) {
      const std::uint8_t next = byte();
      value |= std::uint64_t(next & 0x7f) << shift;
      if (next < 0x80) break;
    }
    return value;
  }
  /// False when there are not that many.
  bool copy(std::byte* to, std::uint64_t size) {
    while (size > 0) {
      if (at_end()) return false;
      const std::uint64_t here = std::min<std::uint64_t>(size, slices_[slice_].size() - at_);
      std::memcpy(to, slices_[slice_].begin() + at_, here);
      to += here;
      at_ += here;
      size -= here;
    }
    return true;
  }

 private:
  std::vector<grpc::Slice> slices_;
  std::size_t slice_ = 0;
  std::size_t at_ = 0;
};

struct Span {
  std::uint64_t plane = 0;
  std::uint64_t offset = 0;
  std::uint64_t size = 0;
};

/// Destination of the bytes of a FramePart that holds a chunk of bytes; the cursor stands before
/// them. The wire format of Protocol Buffers, read by hand so that pixels are copied once:
/// FramePart.chunk is field 2; PlaneChunk has plane 2, offset 3, chunk 4.
std::optional<Span> chunk_span(Cursor& cursor);

/// kInternal for a message that the daemon must not send.
ClientError broken(const std::string& what);

template <class Message>
Message parsed(const grpc::ByteBuffer& data) {
  Message message;
  grpc::ByteBuffer copy = data;
  if (!grpc::SerializationTraits<Message>::Deserialize(&copy, &message).ok())
    throw broken("a message that cannot be read");
  return message;
}

struct Arrived {
  std::size_t camera = 0;  // index over the request's cameras
  Frame frame{};
};

/// Puts the frames of one job together as their parts arrive, one frame after the other.
class Assembly {
 public:
  /// Takes a serialised FramePart; gives the frame that it completed. `progress` may be empty.
  std::optional<Arrived> add(const grpc::ByteBuffer& data,
                             const std::function<void(const Progress&)>& progress = {});
  /// Adds a chunk whose pixels stand before the cursor, or a message.
  std::optional<Arrived> add_pixels(Cursor& cursor, const Span& span);
  std::optional<Arrived> add_part(const v1::FramePart& part,
                                  const std::function<void(const Progress&)>& progress = {});

 private:
  void begin(const v1::FrameHeader& header);
  std::optional<Arrived> complete();

  std::optional<v1::FrameHeader> header_;  // of the frame that is arriving
  std::vector<Plane> planes_;
  std::uint64_t left_ = 0;  // bytes
};

/// The final frames of a job, in the order of its cameras.
class FinalFrames {
 public:
  explicit FinalFrames(std::size_t cameras) : frames_(cameras) {}
  /// Keeps it if it is final.
  void add(Arrived frame);
  /// Throws when one is missing.
  std::vector<Frame> take();

 private:
  std::vector<std::optional<Frame>> frames_;
};

}  // namespace heliograph::client::wire
