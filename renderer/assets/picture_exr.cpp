// EXR through OpenEXR: the first part, its colour channels, over the display window.
#include <ImathMatrix.h>
#include <ImfChannelList.h>
#include <ImfChromaticities.h>
#include <ImfFrameBuffer.h>
#include <ImfHeader.h>
#include <ImfIO.h>
#include <ImfInputFile.h>
#include <ImfStandardAttributes.h>

#include <array>
#include <cstring>

#include "renderer/assets/picture.h"

namespace heliograph::assets {
namespace {

class MemoryStream : public Imf::IStream {
 public:
  explicit MemoryStream(Bytes bytes) : Imf::IStream("picture"), bytes_(bytes) {}

  [[nodiscard]] bool isMemoryMapped() const override { return true; }
  bool read(char c[], int n) override {
    std::memcpy(c, take(n), std::size_t(n));
    return at_ < bytes_.size();
  }
  char* readMemoryMapped(int n) override {
    return const_cast<char*>(reinterpret_cast<const char*>(take(n)));
  }
  u64 tellg() override { return at_; }
  void seekg(u64 at) override { at_ = at; }

 private:
  const std::byte* take(int n) {
    if (n < 0 || at_ > bytes_.size() || u64(n) > bytes_.size() - at_) {
      throw std::runtime_error("the file is truncated");
    }
    const std::byte* at = bytes_.data() + at_;
    at_ += u64(n);
    return at;
  }
  Bytes bytes_;
  u64 at_ = 0;
};

/// Reads the header just far enough to know the windows, which OpenEXR trusts when it sizes its
/// tables: name\0 type\0 size value, until an empty name.
class HeaderScan {
 public:
  HeaderScan(Bytes bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  /// Refuses windows beyond `largest` texels, and deep pictures.
  void check_windows(u64 largest) {
    constexpr u32 kDeep = 0x800;
    at_ = 4;
    if (word() & kDeep) refuse_unimplemented(where_, "a deep EXR; flatten it");
    for (std::string name = text(); !name.empty(); name = text()) {
      const std::string type = text();
      const u64 size = word();
      const u64 end = at_ + size;
      if (size > bytes_.size() - at_) refuse(where_, "broken EXR: an attribute leaves the file");
      if (type == "box2i" && size == 16) check_box(largest);
      at_ = end;
    }
  }

 private:
  u32 word() {
    u32 value = 0;
    if (at_ + 4 > bytes_.size()) refuse(where_, "broken EXR: the header is truncated");
    std::memcpy(&value, bytes_.data() + at_, 4);
    at_ += 4;
    return value;
  }
  std::string text() {
    std::string result;
    for (; at_ < bytes_.size() && bytes_[at_] != std::byte(0); ++at_) result += char(bytes_[at_]);
    if (at_++ >= bytes_.size()) refuse(where_, "broken EXR: the header is truncated");
    return result;
  }
  void check_box(u64 largest) {
    std::array<i64, 4> box{};
    for (i64& side : box) side = i32(word());
    const i64 width = box[2] - box[0] + 1;
    const i64 height = box[3] - box[1] + 1;
    if (width <= 0 || height <= 0) refuse(where_, "broken EXR: an empty window");
    Budget::check(u64(width) * u64(height), largest, "texels", where_);
  }

  Bytes bytes_;
  const std::string& where_;
  u64 at_ = 0;
};

struct Selection {
  std::vector<std::string> channels;  // in the order of the texel
  TexelType type = TexelType::kF16;
};

Selection select_channels(const Imf::ChannelList& list, const std::string& where) {
  const auto has = [&](const char* name) { return list.findChannel(name) != nullptr; };
  Selection selection;
  if (has("R") && has("G") && has("B")) {
    selection.channels = {"R", "G", "B"};
  } else if (has("Y") && !has("RY") && !has("BY")) {
    selection.channels = {"Y"};
  } else if (list.begin() != list.end() && ++list.begin() == list.end()) {
    selection.channels = {list.begin().name()};
  } else {
    refuse_unimplemented(where, "an EXR without channels R, G, B or Y; rename or select channels");
  }
  if (has("A") && selection.channels.front() != "A") selection.channels.emplace_back("A");
  for (const std::string& name : selection.channels) {
    const Imf::Channel& channel = *list.findChannel(name);
    if (channel.type == Imf::UINT) {
      refuse_unimplemented(where, "an EXR channel of integers (" + name + ")");
    }
    if (channel.xSampling != 1 || channel.ySampling != 1) {
      refuse_unimplemented(where, "a subsampled EXR channel (" + name + ")");
    }
    if (channel.type == Imf::FLOAT) selection.type = TexelType::kF32;
  }
  return selection;
}

/// Reads the data window into a canvas of the display window; overscan is cut, what is missing
/// stays 0.
void read_pixels(Imf::InputFile& file, const Selection& selection, Canvas& canvas,
                 const PictureSource& source) {
  const Imath::Box2i data = file.header().dataWindow();
  const Imath::Box2i display = file.header().displayWindow();
  ImageData layout = canvas.image;
  layout.width = u32(data.max.x - data.min.x + 1);
  layout.height = u32(data.max.y - data.min.y + 1);
  Canvas pixels(layout, source);
  const std::size_t texel = pixels.row_bytes() / layout.width;
  const std::size_t component = texel / layout.channels;
  Imf::FrameBuffer frame;
  for (std::size_t i = 0; i < selection.channels.size(); ++i) {
    frame.insert(
        selection.channels[i],
        Imf::Slice::Make(layout.type == TexelType::kF32 ? Imf::FLOAT : Imf::HALF,
                         pixels.texels.data() + i * component, data, texel, pixels.row_bytes()));
  }
  file.setFrameBuffer(frame);
  file.readPixels(data.min.y, data.max.y);
  const i32 left = std::max(data.min.x, display.min.x);
  const i32 right = std::min(data.max.x, display.max.x);
  for (i32 y = std::max(data.min.y, display.min.y);
       left <= right && y <= std::min(data.max.y, display.max.y); ++y) {
    std::memcpy(canvas.row(u32(y - display.min.y)) + std::size_t(left - display.min.x) * texel,
                pixels.row(u32(y - data.min.y)) + std::size_t(left - data.min.x) * texel,
                std::size_t(right - left + 1) * texel);
  }
}

template <class T>
void convert_texels(Canvas& canvas, const Imath::M44f& rec709_from_file) {
  const u32 channels = canvas.image.channels;
  auto* texels = reinterpret_cast<T*>(canvas.texels.data());
  const std::size_t count = canvas.texels.size() / sizeof(T);
  for (std::size_t i = 0; i < count; i += channels) {
    Imath::V3f rgb(texels[i], texels[i + 1], texels[i + 2]);
    rgb *= rec709_from_file;
    for (u32 c = 0; c < 3; ++c) texels[i + c] = T(rgb[int(c)]);
  }
}

/// Converts from the file's primaries, when it names others than Rec.709's.
bool convert_primaries(const Imf::Header& header, Canvas& canvas) {
  if (canvas.image.channels < 3 || !Imf::hasChromaticities(header)) return false;
  const Imf::Chromaticities file = Imf::chromaticities(header);
  const Imf::Chromaticities rec709;
  constexpr float kSame = 1e-3f;
  const auto same = [](const Imath::V2f& a, const Imath::V2f& b) {
    return (a - b).length() < kSame;
  };
  if (same(file.red, rec709.red) && same(file.green, rec709.green) &&
      same(file.blue, rec709.blue) && same(file.white, rec709.white)) {
    return false;
  }
  const Imath::M44f matrix = Imf::RGBtoXYZ(file, 1) * Imf::XYZtoRGB(rec709, 1);
  if (canvas.image.type == TexelType::kF32) {
    convert_texels<float>(canvas, matrix);
  } else {
    convert_texels<half>(canvas, matrix);
  }
  return true;
}

Picture decode(const PictureSource& source) {
  MemoryStream stream(source.bytes);
  Imf::InputFile file(stream, 0);
  const Selection selection = select_channels(file.header().channels(), source.where);
  const Imath::Box2i display = file.header().displayWindow();
  Canvas canvas({.texels = nullptr,
                 .width = u32(display.max.x - display.min.x + 1),
                 .height = u32(display.max.y - display.min.y + 1),
                 .channels = u32(selection.channels.size()),
                 .type = selection.type},
                source);
  read_pixels(file, selection, canvas, source);
  const bool converted = convert_primaries(file.header(), canvas);
  Picture picture = std::move(canvas).finish(false);
  if (converted) picture.warnings.emplace_back("was converted from its own primaries to Rec.709");
  return picture;
}

}  // namespace

Picture decode_exr(const PictureSource& source) {
  HeaderScan(source.bytes, source.where).check_windows(source.budget.limits().texels);
  try {
    return decode(source);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    refuse(source.where, fmt::format("broken EXR: {}", error.what()));
  }
}

}  // namespace heliograph::assets
