// Render over a stream of raw messages, whose pixels are never parsed.
#include "wire/frame_receiver.h"

#include <grpcpp/generic/generic_stub.h>

#include <algorithm>
#include <cstring>
#include <utility>

#include "wire/arrays.h"

namespace heliograph::wire {
namespace {

/// A server stream of serialised messages. Cancelled when it is left early.
class RawStream {
 public:
  RawStream(Session& session, const std::string& method, const google::protobuf::Message& request,
            const RenderOptions::Fields& options)
      : session_(session), cancellation_(options.cancellation) {
    session.prepare(context_);
    if (options.timeout)
      context_.set_deadline(std::chrono::system_clock::now() +
                            std::chrono::milliseconds(std::int64_t(1000 * *options.timeout)));
    context_.set_initial_metadata_corked(true);
    if (cancellation_) cancellation_->state()->add(&context_);
    grpc::GenericStub stub(session.channel());
    call_ = stub.PrepareCall(&context_, method, &queue_);
    call_->StartCall(nullptr);  // corked: it goes out with the request, and has no event
    const grpc::Slice slice(request.SerializeAsString());
    call_->WriteLast(grpc::ByteBuffer(&slice, 1), grpc::WriteOptions(), this);
  }

  ~RawStream() {
    if (cancellation_) cancellation_->state()->remove(&context_);
    if (!is_finished_) {
      context_.TryCancel();
      finish();
    }
    queue_.Shutdown();
    void* tag = nullptr;
    for (bool ok = false; queue_.Next(&tag, &ok);) {
    }
  }
  RawStream(const RawStream&) = delete;
  RawStream& operator=(const RawStream&) = delete;

  /// The next message; false at the end, which throws unless it is a good one.
  bool read(grpc::ByteBuffer* out) {
    call_->Read(out, out);
    if (await(out)) return true;
    const grpc::Status status = finish();
    session_.check(status, context_);
    return false;
  }

 private:
  bool await(void* wanted) {
    void* tag = nullptr;
    bool ok = false;
    while (queue_.Next(&tag, &ok))  // the request's own event passes by
      if (tag == wanted) return ok;
    return false;
  }

  grpc::Status finish() {
    grpc::Status status;
    call_->Finish(&status, &status);
    await(&status);
    is_finished_ = true;
    return status;
  }

  Session& session_;
  std::optional<Cancellation> cancellation_;
  grpc::ClientContext context_;
  grpc::CompletionQueue queue_;
  std::unique_ptr<grpc::GenericClientAsyncReaderWriter> call_;
  bool is_finished_ = false;
};

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

/// Where the bytes of a FramePart that holds a chunk of bytes belong; the cursor stands before
/// them. The wire format of Protocol Buffers, read by hand so that pixels are copied once:
/// FramePart.chunk is field 2; PlaneChunk has plane 2, offset 3, chunk 4.
std::optional<Span> chunk_span(Cursor& cursor) {
  if (cursor.byte() != 0x12) return std::nullopt;
  cursor.varint();
  Span span;
  while (!cursor.at_end()) {
    const std::uint64_t tag = cursor.varint();
    if ((tag & 7) != 0 && tag != 0x22) return std::nullopt;
    const std::uint64_t value = cursor.varint();
    if (tag == 0x10) span.plane = value;
    if (tag == 0x18) span.offset = value;
    if (tag == 0x22) {
      span.size = value;
      return span;
    }
  }
  return std::nullopt;
}

ClientError broken(const std::string& what) {
  return {Code::kInternal, "the daemon sent " + what + "; client and daemon do not fit together"};
}

FrameInfo info_of(const v1::FrameHeader& header) {
  FrameInfo out;
  out.scene = header.scene();
  out.revision = header.revision();
  out.camera = header.camera();
  out.width = header.width();
  out.height = header.height();
  out.time = header.time();
  out.label_time = header.label_time();
  out.shutter_open = header.shutter().open();
  out.shutter_close = header.shutter().close();
  out.rolling = header.shutter().rolling();
  out.seed = header.seed();
  out.samples = header.samples();
  out.noise = header.noise();
  out.is_final = header.final();
  out.backend = header.backend();
  out.cpu_features = header.cpu_features();
  out.render_seconds = header.render_seconds();
  out.rays = header.rays();
  out.manifest = header.manifest();
  out.warnings.assign(header.warnings().begin(), header.warnings().end());
  for (const v1::Category& category : header.categories())
    out.categories[category.id()] = category.name();
  const auto fill = [](const v1::Array& from, auto& matrix) {
    std::memcpy(&matrix, from.inline_().data(), std::min(from.inline_().size(), sizeof(matrix)));
  };
  fill(header.k(), out.K);
  fill(header.camera_from_world_cv(), out.camera_from_world_cv);
  return out;
}

std::string name_of(const v1::PlaneInfo& info) {
  if (info.plane() == v1::PLANE_BEAUTY_GROUP) return "beauty:" + info.argument();
  return info.argument().empty() ? info.name() : info.name() + ":" + info.argument();
}

/// Puts frames together as their parts arrive.
class Assembly {
 public:
  explicit Assembly(std::size_t count) : final_(count) {}

  /// Takes a serialised FramePart; calls back with progress, or with a frame that it completed.
  void add(const grpc::ByteBuffer& data, const RenderOptions::Fields& options) {
    Cursor cursor(data);
    if (const auto span = chunk_span(cursor)) {
      copy(cursor, *span);
    } else {
      v1::FramePart part;
      grpc::ByteBuffer copy = data;
      if (!grpc::SerializationTraits<v1::FramePart>::Deserialize(&copy, &part).ok())
        throw broken("a message that cannot be read");
      take(part, options);
    }
    if (left_ == 0 && header_) complete(options);
  }

  std::vector<Frame> frames() {
    for (const auto& frame : final_)
      if (!frame) throw broken("fewer frames than cameras");
    std::vector<Frame> out;
    for (auto& frame : final_) out.push_back(std::move(*frame));
    return out;
  }

 private:
  void take(const v1::FramePart& part, const RenderOptions::Fields& options) {
    if (part.has_header()) begin(part.header());
    if (part.has_chunk()) throw broken("a shared buffer, which was not asked for");
    if (part.has_progress() && options.progress) {
      const v1::Progress& from = part.progress();
      options.progress({from.done(), from.rays_per_second(), from.eta_seconds(), from.noise()});
    }
  }

  void begin(const v1::FrameHeader& header) {
    header_ = header;
    planes_.clear();
    left_ = 0;
    for (const v1::PlaneInfo& info : header.planes()) {
      Shape shape{header.height(), header.width()};
      if (info.channels() != 1) shape.push_back(info.channels());
      planes_.push_back(
          {name_of(info), info.unit(), empty_array(DType(info.dtype()), std::move(shape))});
      if (planes_.back().pixels.bytes() != info.size()) throw broken("a plane of another size");
      left_ += info.size();
    }
  }

  void copy(Cursor& cursor, const Span& span) {
    if (span.plane >= planes_.size() || span.offset > planes_[span.plane].pixels.bytes() ||
        span.size > planes_[span.plane].pixels.bytes() - span.offset || span.size > left_)
      throw broken("pixels outside their plane");
    std::byte* to = writable(planes_[span.plane].pixels) + span.offset;
    if (!cursor.copy(to, span.size)) throw broken("fewer pixels than it said");
    left_ -= span.size;
  }

  void complete(const RenderOptions::Fields& options) {
    Frame frame(info_of(*header_), std::move(planes_), columns_of(header_->labels()));
    const std::size_t index = header_->frame();
    header_.reset();
    if (options.on_pass) options.on_pass(frame);
    if (!frame.info().is_final) return;
    if (index >= final_.size()) throw broken("more frames than cameras");
    final_[index] = std::move(frame);
  }

  std::vector<std::optional<Frame>> final_;
  std::optional<v1::FrameHeader> header_;  // of the frame that is arriving
  std::vector<Plane> planes_;
  std::uint64_t left_ = 0;  // bytes
};

}  // namespace

void Cancelling::cancel() {
  const std::lock_guard lock(mutex_);
  is_cancelled_ = true;
  for (grpc::ClientContext* context : contexts_) context->TryCancel();
}

void Cancelling::add(grpc::ClientContext* context) {
  const std::lock_guard lock(mutex_);
  contexts_.insert(context);
  if (is_cancelled_) context->TryCancel();
}

void Cancelling::remove(grpc::ClientContext* context) {
  const std::lock_guard lock(mutex_);
  contexts_.erase(context);
}

std::vector<Frame> render(Session& session, const v1::RenderRequest& request,
                          const RenderOptions::Fields& options) {
  Assembly assembly(std::size_t(request.cameras_size()));
  RawStream stream(session, "/heliograph.v1.Renderer/Render", request, options);
  for (grpc::ByteBuffer part; stream.read(&part); part.Clear()) assembly.add(part, options);
  return assembly.frames();
}

}  // namespace heliograph::wire
