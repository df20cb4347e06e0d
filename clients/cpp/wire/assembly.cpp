#include "wire/assembly.h"

#include <cstring>
#include <utility>

#include "heliograph/error.h"
#include "wire/arrays.h"

namespace heliograph::client::wire {
namespace {

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

}  // namespace

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

std::optional<Arrived> Assembly::add(const grpc::ByteBuffer& data,
                                     const std::function<void(const Progress&)>& progress) {
  Cursor cursor(data);
  if (const auto span = chunk_span(cursor)) return add_pixels(cursor, *span);
  return add_part(parsed<v1::FramePart>(data), progress);
}

std::optional<Arrived> Assembly::add_pixels(Cursor& cursor, const Span& span) {
  if (span.plane >= planes_.size() || span.offset > planes_[span.plane].pixels.bytes() ||
      span.size > planes_[span.plane].pixels.bytes() - span.offset || span.size > left_)
    throw broken("pixels outside their plane");
  std::byte* to = writable(planes_[span.plane].pixels) + span.offset;
  if (!cursor.copy(to, span.size)) throw broken("fewer pixels than it said");
  left_ -= span.size;
  return complete();
}

std::optional<Arrived> Assembly::add_part(const v1::FramePart& part,
                                          const std::function<void(const Progress&)>& progress) {
  if (part.has_header()) begin(part.header());
  if (part.has_chunk()) throw broken("a shared buffer, which was not asked for");
  if (part.has_progress() && progress) {
    const v1::Progress& from = part.progress();
    progress({from.done(), from.rays_per_second(), from.eta_seconds(), from.noise()});
  }
  return complete();
}

void Assembly::begin(const v1::FrameHeader& header) {
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

std::optional<Arrived> Assembly::complete() {
  if (left_ > 0 || !header_) return std::nullopt;
  Arrived out{header_->frame(),
              Frame(info_of(*header_), std::move(planes_), columns_of(header_->labels()))};
  header_.reset();
  return out;
}

void FinalFrames::add(Arrived arrived) {
  if (!arrived.frame.info().is_final) return;
  if (arrived.camera >= frames_.size()) throw broken("more frames than cameras");
  frames_[arrived.camera] = std::move(arrived.frame);
}

std::vector<Frame> FinalFrames::take() {
  std::vector<Frame> out;
  for (auto& frame : frames_) {
    if (!frame) throw broken("fewer frames than cameras");
    out.push_back(std::move(*frame));
  }
  return out;
}

}  // namespace heliograph::client::wire
