#include "renderer/assets/picture.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <map>
#include <memory>
#include <optional>
#include <ranges>

#include "renderer/assets/bundle.h"
#include "renderer/assets/picture_headers.h"
#include "renderer/assets/picture_ktx2.h"
#include "renderer/assets/picture_layers.h"
#include "renderer/assets/picture_texels.h"
#include "renderer/assets/text_scan.h"

namespace heliograph::assets {
namespace {

using Input = std::unique_ptr<OIIO::ImageInput>;
using Extensions = std::map<std::string, std::vector<std::string>>;

constexpr const char* kKtx2 = "ktx2";  // the one that OpenImageIO has not

/// Extensions by format: those that are read from memory.
const Extensions& extensions() {
  static const Extensions known = [] {
    Extensions all = OIIO::get_extension_map();
    all[kKtx2] = {kKtx2};
    for (const char* format : {"null", "term", "cineon", "fits", "softimage", "zfile"}) {
      all.erase(format);
    }
    return all;
  }();
  return known;
}

constexpr u64 kTexelBytes = 16;  // four floats

std::string_view ending_of(std::string_view name) {
  if (name.starts_with("image/")) name.remove_prefix(6);
  return name;
}

/// The format that a name is one of; "": none.
std::string format_named(std::string_view name) {
  for (const auto& [format, endings] : extensions()) {
    if (format == ending_of(name) || std::ranges::find(endings, ending_of(name)) != endings.end()) {
      return format;
    }
  }
  return {};
}

std::string in_words(std::string_view format) { return OIIO::Strutil::upper(format); }

/// Warns of a name that is another format's.
void check_name(std::string_view name, std::string_view content,
                std::vector<std::string>& warnings) {
  const std::string named = format_named(name);
  if (named.empty() || named == content) return;
  warnings.push_back(
      fmt::format("is named as {} and is {} by its content", in_words(named), in_words(content)));
}

/// True for the name of a colour space or a profile that is sRGB; CMYK was converted.
bool is_srgb(const std::string& name) {
  constexpr std::array kNames = {"sRGB", "srgb_rec709", "Rec709", "rec709", "CMYK"};
  return std::ranges::any_of(kNames, [&](const char* part) { return name.contains(part); });
}

/// True if a message of OpenImageIO means that.
bool is_too_large(const std::string& message) {
  return message.contains("limits:") || message.contains("may not exceed");
}

/// Reads one file.
class Reader {
 public:
  Reader(const PictureSource& source, std::string_view name)
      : source_(source), memory_(source.bytes.data(), source.bytes.size()) {
    OIIO::attribute("limits:imagesize_MB", int(source.budget.limits().texels * kTexelBytes >> 20));
    const std::string named = format_named(name);
    input_ = open("picture");  // by its content
    if (!input_ && !named.empty() && named != kKtx2)
      input_ = open("picture." + extensions().at(named).front());
    if (!input_) refuse_unread(named, name);
    check_name(name, input_->format_name(), warnings);
  }

  /// Chooses one of several parts. Refuses what is no plain picture.
  void choose(std::string_view layer) {
    if (is("ico")) seek_largest();
    if (is("openexr")) seek_part(layer);
    if (spec().deep) refuse_unimplemented(source_.where, "a deep picture; flatten it");
    if (spec().depth > 1) refuse_unimplemented(source_.where, "a picture of volume; save a slice");
    if (text("textureformat").starts_with("CubeFace")) {
      refuse_unimplemented(source_.where, "a cube map; save it as latitude and longitude");
    }
    const std::string space = text("tiff:ColorSpace");
    if (space.contains("LAB") || space.starts_with("LOG")) {
      refuse_unimplemented(source_.where, fmt::format("a TIFF in {}; save it as RGB", space));
    }
    select(layer);
  }

  [[nodiscard]] Canvas texels() {
    const auto [begin, end] = std::ranges::minmax(selection_.channels);
    Canvas read({.texels = nullptr,
                 .width = u32(std::max(spec().width, 0)),
                 .height = u32(std::max(spec().height, 0)),
                 .channels = end + 1 - begin,
                 .type = type()},
                source_);
    const bool ok =
        input_->read_image(subimage_, 0, int(begin), int(end + 1), oiio_type(), read.texels.data());
    if (!ok) refuse_broken();
    std::vector<u32> channels = selection_.channels;
    for (u32& channel : channels) channel -= begin;
    return windowed(picked(std::move(read), channels, source_));
  }

  /// The others' alpha is straight, or was asked to stay so.
  [[nodiscard]] bool is_premultiplied() const {
    return selection_.channels.size() % 2 == 0 && (is("openexr") || is("tiff") || is("targa")) &&
           !spec().get_int_attribute("oiio:UnassociatedAlpha");
  }
  [[nodiscard]] u32 orientation() const { return u32(spec().get_int_attribute("Orientation", 1)); }
  [[nodiscard]] std::optional<Chromaticities> chromaticities() const {
    Chromaticities found;
    const OIIO::TypeDesc eight(OIIO::TypeDesc::FLOAT, int(found.size()));
    if (is("hdr")) return radiance_header(source_.bytes).primaries;
    if (!spec().getattribute("chromaticities", eight, found.data())) return std::nullopt;
    return found;
  }
  [[nodiscard]] double exposure() const {
    return is("hdr") ? radiance_header(source_.bytes).exposure : 1;
  }
  /// Integers are sRGB unless the file states that they are linear.
  [[nodiscard]] bool srgb() {
    const std::string space = text("oiio:ColorSpace");
    const bool linear = space.starts_with("lin_") || space.contains("inear");
    if (is_float() || linear) return false;
    warn_of_profile(space);
    return true;
  }

  std::vector<std::string> warnings;

 private:
  [[nodiscard]] const OIIO::ImageSpec& spec() const { return input_->spec(); }
  [[nodiscard]] bool is(std::string_view format) const { return input_->format_name() == format; }
  [[nodiscard]] std::string text(const char* attribute) const {
    return std::string(spec().get_string_attribute(attribute));
  }
  [[nodiscard]] bool is_float() const {
    return spec().format == OIIO::TypeDesc::HALF || spec().format == OIIO::TypeDesc::FLOAT ||
           spec().format == OIIO::TypeDesc::DOUBLE;
  }

  Input open(const std::string& name) {
    OIIO::ImageSpec config;
    config.attribute("oiio:UnassociatedAlpha", 1);
    memory_.seek(0);
    Input input = OIIO::ImageInput::create(name, true, &config, &memory_);
    if (const std::string error = OIIO::geterror(); !input && !error.empty()) message_ = error;
    return input;
  }
  [[noreturn]] void refuse_unread(const std::string& named, std::string_view name) const {
    if (is_too_large(message_)) {
      refuse(source_.where,
             fmt::format("would decode to more than {} texels; reduce the picture, or raise the "
                         "daemon's decode_ limit",
                         source_.budget.limits().texels),
             Code::kResourceExhausted);
    }
    if (!named.empty() && !message_.contains("does not exist")) {
      refuse(source_.where, fmt::format("broken {}: {}", in_words(named), message_));
    }
    const std::string what = named.empty()
                                 ? fmt::format("'{}' names no format", clean_name(name, ""))
                                 : "it is named as " + in_words(named);
    refuse(source_.where,
           fmt::format("its content is no picture that can be read ({}); pictures are {}", what,
                       picture_formats()));
  }
  [[noreturn]] void refuse_broken() const {
    std::string message = input_->geterror();
    message = message.substr(0, message.find('\n'));
    refuse(source_.where, fmt::format("broken {}: {}", in_words(input_->format_name()),
                                      message.empty() ? "cannot be read" : message));
  }

  void seek(int subimage) {
    if (!input_->seek_subimage(subimage, 0)) refuse_broken();
    subimage_ = subimage;
  }
  void seek_largest() {
    constexpr int kMost = 256;
    int largest = 0;
    for (int i = 0, width = 0; i < kMost && input_->seek_subimage(i, 0); ++i) {
      if (spec().width > width) largest = i, width = spec().width;
    }
    (void)input_->geterror();  // of the one behind the last
    seek(largest);
  }
  /// The part with a layer's name, else the first.
  void seek_part(std::string_view layer) {
    constexpr int kMost = 1024;
    const int count = std::min(spec().get_int_attribute("oiio:subimages", 1), kMost);
    std::vector<std::string> names;
    for (int i = 0; count > 1 && i < count; ++i) {
      seek(i);
      names.push_back(text("oiio:subimagename"));
      if (!layer.empty() && names.back() == layer) return;
    }
    if (count <= 1) return;
    seek(0);
    if (layer.empty()) {
      warnings.push_back(fmt::format("its part '{}' is taken of {} ({}); choose with layer=",
                                     clean_name(names[0], ""), count, listed(names)));
    }
  }
  void select(std::string_view layer) {
    const bool is_part = !layer.empty() && text("oiio:subimagename") == layer;
    selection_ = select_channels(spec().channelnames, is_part ? "" : layer, source_.where);
    if (!selection_.warning.empty()) warnings.push_back(selection_.warning);
    for (const u32 channel : selection_.channels) {
      if (is("openexr") && spec().channelformat(int(channel)) == OIIO::TypeDesc::UINT32) {
        refuse_unimplemented(source_.where,
                             fmt::format("an EXR channel of integers ({})",
                                         clean_name(spec().channelnames[channel], "?")));
      }
    }
  }

  [[nodiscard]] TexelType type() const {
    if (spec().format == OIIO::TypeDesc::UINT8) return TexelType::kU8;
    if (spec().format == OIIO::TypeDesc::UINT16) return TexelType::kU16;
    if (spec().format == OIIO::TypeDesc::HALF) return TexelType::kF16;
    return TexelType::kF32;
  }
  [[nodiscard]] OIIO::TypeDesc oiio_type() const {
    return type() == TexelType::kF32 ? OIIO::TypeDesc(OIIO::TypeDesc::FLOAT) : spec().format;
  }

  /// An EXR's data window in its display window: overscan is cut, what is missing is 0.
  [[nodiscard]] Canvas windowed(Canvas pixels) const {
    const OIIO::ImageSpec& at = spec();
    const bool same = at.x == at.full_x && at.y == at.full_y && at.width == at.full_width &&
                      at.height == at.full_height;
    if (same || !is("openexr")) return pixels;
    ImageData layout = pixels.image;
    layout.width = u32(at.full_width);
    layout.height = u32(at.full_height);
    Canvas canvas(layout, source_);
    place(pixels, {at.x - at.full_x, at.y - at.full_y}, canvas);
    return canvas;
  }

  void warn_of_profile(const std::string& space) {
    const std::string profile = text("ICCProfile:profile_description");
    const std::string& said = profile.empty() ? space : profile;
    if (said.empty() || is_srgb(said)) return;
    warnings.push_back(fmt::format("is in the colour space '{}'; its numbers are taken as sRGB",
                                   clean_name(said, "?")));
  }

  const PictureSource& source_;
  OIIO::Filesystem::IOMemReader memory_;
  Input input_;
  Selection selection_;
  int subimage_ = 0;
  std::string message_;
};

Picture decode(const PictureSource& file, std::string_view name, std::string_view layer) {
  const std::vector<std::byte> mended = without_last_line_end(file.bytes);
  file.budget.take(mended.size(), 1, file.where);
  const PictureSource source{mended.empty() ? file.bytes : Bytes(mended), file.where, file.budget};
  if (as_text(source.bytes).starts_with("#?") && radiance_header(source.bytes).is_xyze)
    refuse_unimplemented(source.where, "a Radiance picture in XYZE; save it as RGBE");
  Reader reader(source, name);
  if (is_cut_jpeg(source.bytes)) refuse(source.where, "broken JPEG: the file is truncated");
  reader.choose(layer);
  Canvas canvas = reader.texels();
  if (reader.is_premultiplied()) make_alpha_straight(canvas);
  if (const double exposure = reader.exposure(); exposure != 1) scale_colors(canvas, 1 / exposure);
  const auto chromaticities = reader.chromaticities();
  const auto matrix = chromaticities ? rec709_from(*chromaticities) : std::nullopt;
  if (matrix && canvas.image.channels >= 3) {
    transform_colors(canvas, *matrix);
    reader.warnings.emplace_back("was converted from its own primaries to Rec.709");
  }
  if (reader.orientation() > 1 && reader.orientation() <= 8) {
    canvas = upright(std::move(canvas), reader.orientation(), source);
  }
  const bool srgb = reader.srgb();
  Picture picture = std::move(canvas).finish(srgb);
  std::ranges::move(reader.warnings, std::back_inserter(picture.warnings));
  return picture;
}

}  // namespace

bool is_picture(Bytes bytes) {
  if (is_ktx2(bytes)) return true;
  OIIO::Filesystem::IOMemReader memory(bytes.data(), bytes.size());
  const Input input = OIIO::ImageInput::create("picture", false, nullptr, &memory);
  (void)OIIO::geterror();
  return input != nullptr;
}

bool is_picture_name(std::string_view name) { return !format_named(name).empty(); }

std::string picture_formats() {
  return fmt::format("{}", fmt::join(std::views::keys(extensions()), ", "));
}

Picture decode_picture(Bytes bytes, std::string_view name, const std::string& where, Budget& budget,
                       std::string_view layer) {
  const PictureSource source{bytes, where, budget};
  try {
    if (!is_ktx2(bytes)) return decode(source, name, layer);
    Picture picture = decode_ktx2(source, layer);
    check_name(name, kKtx2, picture.warnings);
    return picture;
  } catch (const Refused&) {
    throw;
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& error) {
    refuse(where, fmt::format("broken picture: {}", error.what()));
  }
}

}  // namespace heliograph::assets

namespace heliograph {

void end_picture_threads() {
  OIIO::attribute("threads", 1);  // the caller's own: those of its pool end
  OIIO::attribute("exr_threads", -1);
}

}  // namespace heliograph
