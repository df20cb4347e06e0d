// Textures, pictures, and how a texture drives a parameter.
#include <fmt/format.h>

#include "server/convert/array.h"
#include "server/convert/fields.h"
#include "server/convert/nouns.h"

namespace heliograph::server {
namespace {

constexpr u64 kLargestSide = 1u << 16;

constexpr std::array kWraps{Wrap::kRepeat, Wrap::kRepeat, Wrap::kClamp, Wrap::kMirror};
static_assert(kWraps.size() == v1::Texture::Wrap_ARRAYSIZE);
constexpr std::array kNearest{false, false, true};
static_assert(kNearest.size() == v1::Texture::Filter_ARRAYSIZE);
static_assert(v1::Texture::Encoding_ARRAYSIZE == 3);

constexpr std::array kTexelTypes{v1::D_TYPE_U8, v1::D_TYPE_U16, v1::D_TYPE_F16, v1::D_TYPE_F32};

TexelType texel_type(v1::DType type) {
  return TexelType(std::ranges::find(kTexelTypes, type) - kTexelTypes.begin());
}

/// The default encoding depends on the texels, so these must be present.
Expected<bool> to_srgb(v1::Texture::Encoding encoding, const ImageData* image) {
  if (encoding == v1::Texture::ENCODING_LINEAR) return false;
  if (encoding == v1::Texture::ENCODING_SRGB) return true;
  if (image) return image->type == TexelType::kU8;
  return fail(Code::kInvalidArgument, "encoding",
              "has its default only beside texels; give ENCODING_LINEAR or ENCODING_SRGB");
}

Expected<glm::mat3x2> to_uv_transform(const v1::Array& array, ArraySource& source) {
  auto numbers = read_f32(array, source, {kTwo, kThree}, 6);
  if (!numbers) return std::unexpected(std::move(numbers).error());
  const auto m = numbers->as<float>();
  return glm::mat3x2(m[0], m[3], m[1], m[4], m[2], m[5]);
}

/// `clear` names of a texture; the encoding's default depends on the texels.
Status clear_texture(const v1::Texture& message, PutTexture& patch) {
  static constexpr std::array<Clear<PutTexture>, 4> kClear{{
      {"encoding", [](PutTexture&) {}},
      {"wrap_u", [](PutTexture& p) { p.wrap_u = Wrap::kRepeat; }},
      {"wrap_v", [](PutTexture& p) { p.wrap_v = Wrap::kRepeat; }},
      {"filter", [](PutTexture& p) { p.nearest = false; }},
  }};
  HELIO_TRY(clear_fields(message.clear(), kClear, patch));
  if (std::ranges::find(message.clear(), "encoding") != message.clear().end())
    HELIO_TAKE(patch.srgb, to_srgb(v1::Texture::ENCODING_UNSPECIFIED, patch.image.get()), "clear");
  return {};
}

}  // namespace

Expected<std::shared_ptr<const ImageData>> to_image(const v1::Array& texels, ArraySource& source) {
  Dims dims{{"H", {}}, {"W", {}}};
  if (texels.shape_size() != 2) dims.push_back({"C", {}});
  for (int i = 0; i < texels.shape_size(); ++i) {
    const u64 largest = i < 2 ? kLargestSide : 4;
    if (texels.shape(i) < 1 || texels.shape(i) > largest)
      return fail(Code::kInvalidArgument, indexed("shape", u64(i)),
                  fmt::format("is {}; give 1 to {}", texels.shape(i), largest));
  }
  auto raw = read_raw(texels, source, dims, kTexelTypes);
  if (!raw) return std::unexpected(std::move(raw).error());
  const u64 channels = raw->shape.size() == 3 ? raw->shape[2] : 1;
  const TexelType type = texel_type(raw->type);
  if (type == TexelType::kF16 || type == TexelType::kF32) HELIO_TRY(check_finite(*raw, channels));
  return std::make_shared<const ImageData>(ImageData{.texels = raw->buffer,
                                                     .width = u32(raw->shape[1]),
                                                     .height = u32(raw->shape[0]),
                                                     .channels = u32(channels),
                                                     .type = type});
}

v1::Array to_proto(const ImageData& image, const ArraySink& sink) {
  const u64 shape[] = {image.height, image.width, image.channels};
  return to_array(image.texels, kTexelTypes[std::size_t(image.type)], shape, sink);
}

Expected<TextureUsePatch> to_texture_use(const v1::TextureUse& message, ArraySource& source,
                                         bool scalar) {
  TextureUsePatch patch;
  TextureUse& use = patch.use;
  if (message.has_texture()) HELIO_TAKE(patch.texture, to_ref(message.texture()), "texture");
  if (message.has_uv_set()) HELIO_TAKE(use.uv_set, in_range(message.uv_set(), {0, 1}), "uv_set");
  if (message.has_channel()) {
    if (!scalar && message.channel() != 0)
      return fail(Code::kInvalidArgument, "channel",
                  "is for scalar parameters only; leave it out for a colour");
    HELIO_TAKE(use.channel, in_range(message.channel(), {0, 3}), "channel");
  }
  if (message.has_scale()) HELIO_TAKE(use.scale, in_range(message.scale(), kAnyFinite), "scale");
  if (message.has_offset())
    HELIO_TAKE(use.offset, in_range(message.offset(), kAnyFinite), "offset");
  if (message.has_uv_transform())
    HELIO_TAKE(use.uv_transform, to_uv_transform(message.uv_transform(), source), "uv_transform");
  return patch;
}

v1::TextureUse to_proto(const TextureUsePatch& patch, const ArraySink& sink) {
  v1::TextureUse message;
  *message.mutable_texture() = to_proto(patch.texture);
  message.set_uv_set(patch.use.uv_set);
  message.set_channel(patch.use.channel);
  message.set_scale(patch.use.scale);
  message.set_offset(patch.use.offset);
  const glm::mat3x2& m = patch.use.uv_transform;
  const u64 shape[] = {2, 3};
  *message.mutable_uv_transform() = to_array(
      std::vector<float>{m[0][0], m[1][0], m[2][0], m[0][1], m[1][1], m[2][1]}, shape, sink);
  return message;
}

Expected<PutTexture> to_texture(const v1::Texture& message, ArraySource& source) {
  PutTexture patch;
  if (message.has_texels()) HELIO_TAKE(patch.image, to_image(message.texels(), source), "texels");
  HELIO_TRY(clear_texture(message, patch));
  if (message.has_encoding()) {
    auto srgb = to_srgb(message.encoding(), patch.image.get());
    if (!srgb) return std::unexpected(std::move(srgb).error());
    patch.srgb = *srgb;
  }
  if (message.has_wrap_u()) patch.wrap_u = from_enum(kWraps, message.wrap_u());
  if (message.has_wrap_v()) patch.wrap_v = from_enum(kWraps, message.wrap_v());
  if (message.has_filter()) patch.nearest = from_enum(kNearest, message.filter());
  return patch;
}

v1::Texture to_proto(const PutTexture& patch, const ArraySink& sink) {
  v1::Texture message;
  if (patch.image) *message.mutable_texels() = to_proto(*patch.image, sink);
  if (patch.srgb)
    message.set_encoding(*patch.srgb ? v1::Texture::ENCODING_SRGB : v1::Texture::ENCODING_LINEAR);
  if (patch.wrap_u) message.set_wrap_u(to_enum<v1::Texture::Wrap>(kWraps, *patch.wrap_u));
  if (patch.wrap_v) message.set_wrap_v(to_enum<v1::Texture::Wrap>(kWraps, *patch.wrap_v));
  if (patch.nearest) message.set_filter(to_enum<v1::Texture::Filter>(kNearest, *patch.nearest));
  return message;
}

}  // namespace heliograph::server
