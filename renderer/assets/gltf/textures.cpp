#include "renderer/assets/gltf/textures.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <set>

#include "renderer/assets/picture.h"

namespace heliograph::assets::gltf {
namespace {

// Filters, as OpenGL numbers them; of those with mipmaps the even ones begin with NEAREST.
constexpr u64 kNearest = 9728, kLinear = 9729, kFirstMipmap = 9984, kLastMipmap = 9987;

Wrap wrap_of(const Value& sampler, const std::string& key) {
  switch (sampler.whole(key, 10497)) {
    case 10497:
      return Wrap::kRepeat;
    case 33071:
      return Wrap::kClamp;
    case 33648:
      return Wrap::kMirror;
    default:
      refuse(sampler.key_where(key), "must be 10497, 33071 or 33648");
  }
}

/// A texture has one filter here: that of magnification, and where none is named that of
/// minification. Mipmaps are no question: a linear texture is always filtered over what is seen.
bool is_nearest(const Value& sampler, Builder& builder) {
  const u64 magnified = sampler.whole("magFilter", 0);
  const u64 minified = sampler.whole("minFilter", 0);
  if (magnified != 0 && magnified != kNearest && magnified != kLinear)
    refuse(sampler.key_where("magFilter"), "must be 9728 or 9729");
  if (minified != 0 && minified != kNearest && minified != kLinear &&
      !(minified >= kFirstMipmap && minified <= kLastMipmap)) {
    refuse(sampler.key_where("minFilter"), "must be 9728, 9729 or 9984 to 9987");
  }
  const bool minified_nearest =
      minified == kNearest || (minified >= kFirstMipmap && minified % 2 == 0);
  if (magnified == kLinear && minified == kNearest) {
    builder.warn(fmt::format("{}: NEAREST is left out; its textures are LINEAR as magFilter says",
                             sampler.key_where("minFilter")));
  }
  return magnified == kNearest || (magnified == 0 && minified_nearest);
}

/// The image of a texture: that of an extension, else its own.
std::optional<Value> source_of(const Value& texture) {
  for (const char* name : {"KHR_texture_basisu", "EXT_texture_webp"}) {
    const auto extension = texture.extension(name);
    if (!extension) continue;
    if (const auto source = extension->find("source")) return source;
  }
  return texture.find("source");
}

/// uv_transform in our texture space, whose v runs up: F M F with F (u, v) = (u, 1 - v) and M the
/// extension's offset * rotation * scale. Source: KHR_texture_transform; its rotation is
/// counter-clockwise as seen in the picture.
glm::mat3x2 uv_transform_of(const Value& transform) {
  const vec2 offset = transform.numbers("offset", vec2(0));
  const vec2 scale = transform.numbers("scale", vec2(1));
  const double angle = transform.number("rotation", 0);
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const glm::dvec2 u(c * scale.x, s * scale.x), v(-s * scale.y, c * scale.y);
  return {vec2(u), vec2(v), vec2(s * scale.y + offset.x, 1 - c * scale.y - offset.y)};
}

}  // namespace

std::optional<Textures::Slot> Textures::slot_of(const Value& texture, u32 index) const {
  const auto source = source_of(texture);
  if (!source) {
    const auto extensions = texture.find("extensions");
    const auto members = extensions ? extensions->members() : decltype(extensions->members()){};
    if (members.empty()) {
      builder_.warn(fmt::format("texture {} has no image and is left out", index));
      return std::nullopt;
    }
    refuse_unimplemented(texture.where(),
                         fmt::format("its image exists only through {}; export PNG or JPEG",
                                     clean_name(members.front().first, "?")));
  }
  Slot slot{.texture = index, .image = source->index(document_.count("images"))};
  if (const auto sampler_index = texture.find("sampler")) {
    const Value sampler = document_.named("samplers", *sampler_index);
    slot.wrap_u = wrap_of(sampler, "wrapS");
    slot.wrap_v = wrap_of(sampler, "wrapT");
    slot.nearest = is_nearest(sampler, builder_);
  }
  return slot;
}

Boxed<TextureUsePatch> Textures::use(const Value& info, bool srgb, u32 channel) {
  const u32 index = info.at("index").index(document_.count("textures"));
  std::optional<Slot> slot = slot_of(document_.item("textures", index), index);
  if (!slot || document_.is_lacking(document_.item("images", slot->image))) return {};
  slot->srgb = srgb;
  const auto same = [&](const Slot& other) {
    Slot a = other;
    a.texture = slot->texture;
    return a == *slot;
  };
  auto found = std::ranges::find_if(slots_, same);
  if (found == slots_.end()) found = slots_.insert(slots_.end(), *slot);
  TextureUsePatch patch{.texture = CreatedByEdit{u32(found - slots_.begin())}, .use = {}};
  patch.use.channel = channel;
  u64 uv_set = info.whole("texCoord", 0);
  if (const auto transform = info.extension("KHR_texture_transform")) {
    patch.use.uv_transform = uv_transform_of(*transform);
    uv_set = transform->whole("texCoord", uv_set);
  }
  if (uv_set > 1) {
    builder_.warn(fmt::format("{} uses TEXCOORD_{}; only sets 0 and 1 are read, set 0 is taken",
                              info.where(), uv_set));
    uv_set = 0;
  }
  patch.use.uv_set = u32(uv_set);
  return patch;
}

void Textures::decode_images() {
  images_.resize(document_.count("images"));
  std::set<u32> used;
  for (const Slot& slot : slots_) used.insert(slot.image);
  struct Job {
    u32 image;
    Document::LinkedBytes source;
    Picture picture{};
    std::optional<Error> error{};
  };
  std::vector<Job> jobs;
  for (u32 image : used) {
    if (auto bytes = document_.linked_bytes(document_.item("images", image)))
      jobs.push_back({image, std::move(*bytes)});
  }
  if (!builder_.complete()) return;
  std::atomic<std::size_t> next{0};
  const auto work = [&] {
    for (std::size_t i = next++; i < jobs.size(); i = next++) {
      Job& job = jobs[i];
      const std::string where = fmt::format("images[{}]", job.image);
      try {
        job.picture = decode_picture(job.source.bytes, job.source.name, where, builder_.budget);
      } catch (const Refused& refused) {
        job.error = refused.error;
      } catch (const std::bad_alloc&) {
        job.error = Error{.code = Code::kResourceExhausted,
                          .message = "out of memory while decoding",
                          .where = where};
      }
    }
  };
  builder_.options.in_threads(work);
  for (Job& job : jobs) {
    if (job.error) throw Refused{std::move(*job.error)};
    for (const std::string& warning : job.picture.warnings) {
      builder_.warn(fmt::format("image {}: {}", job.image, warning));
    }
    images_[job.image] = std::make_shared<const ImageData>(std::move(job.picture.image));
  }
}

void Textures::make_library() {
  decode_images();
  if (!builder_.complete()) return;
  for (const Slot& slot : slots_) {
    const Value texture = document_.item("textures", slot.texture);
    const Value image = document_.item("images", slot.image);
    std::string name = texture.text("name", image.text("name", ""));
    const std::string uri = image.text("uri", "");
    if (name.empty() && !uri.empty() && !uri.starts_with("data:")) name = stem_of(uri);
    PutTexture put = layout(slot);
    put.image = images_[slot.image];
    builder_.library(builder_.claim_name(name, fmt::format("texture_{}", slot.texture)),
                     std::move(put));
  }
}

PutTexture Textures::layout(const Slot& slot) {
  return {.image = nullptr,
          .srgb = slot.srgb,
          .nearest = slot.nearest,
          .wrap_u = slot.wrap_u,
          .wrap_v = slot.wrap_v};
}

}  // namespace heliograph::assets::gltf
