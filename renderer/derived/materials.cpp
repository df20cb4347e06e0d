// Material and texture rows to views.
#include "renderer/derived/materials.h"

#include "kernels/material/material.h"
#include "renderer/derived/mips.h"

namespace heliograph::resident {

kernels::TextureView view_of(const Texture& texture) {
  return {.texels = texture.image->texels->bytes().data(),
          .width = texture.image->width,
          .height = texture.image->height,
          .channels = u8(texture.image->channels),
          .type = kernels::TexelType(texture.image->type),
          .srgb = texture.srgb,
          .nearest = texture.nearest,
          .wrap_u = kernels::Wrap(texture.wrap_u),
          .wrap_v = kernels::Wrap(texture.wrap_v)};
}

namespace {

void set(float& out, vec3 value) { out = value.x; }
void set(vec3& out, vec3 value) { out = value; }

kernels::MaterialView view_of(const Snapshot& snapshot, const Material& material, u32 id,
                              std::vector<kernels::TextureUseView>& uses) {
  kernels::MaterialView view{};
#define HELIO_PARAMETER(name, ...) set(view.constant.name, material[MaterialParameter::name].value);
  HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
  view.first_use = u32(uses.size());
  for (u32 p = 0; p < kMaterialParameters; ++p) {
    const TextureUse& use = material.parameters[p].texture;
    if (!snapshot.find(use.texture)) continue;
    view.textured |= kernels::parameters(p);
    uses.push_back(resident::view_of(snapshot, use));
  }
#define HELIO_MAP(name) view.name = resident::view_of(snapshot, material.name);
  HELIO_NORMAL_MAPS(HELIO_MAP)
#undef HELIO_MAP
  view.alpha_cutoff = material.alpha_cutoff;
  view.alpha_mode = kernels::AlphaMode(material.alpha_mode);
  view.two_sided_emission = material.two_sided_emission;
  view.unlit = material.unlit;
  view.thin_walled = material.thin_walled;
  view.priority = material.priority;
  view.passable = kernels::is_passable(view);
  view.id = id;
  return view;
}

struct TextureMean {
  vec4 value;
  [[nodiscard]] u64 bytes() const { return sizeof(*this); }
};

}  // namespace

std::vector<bool> filtered_textures(const Snapshot& snapshot) {
  std::vector<bool> filtered(snapshot.textures.capacity());
  snapshot.materials.for_each([&](u32, const Shared<Material>& row) {
    for (u32 p = 0; p < kMaterialParameters; ++p) {
      const TextureId texture = row.value->parameters[p].texture.texture;
      if (!((kernels::kEmissionBits | kernels::kAlphaBit) >> p & 1) && snapshot.find(texture))
        filtered[texture.index()] = true;
    }
  });
  return filtered;
}

kernels::TextureUseView view_of(const Snapshot& snapshot, const TextureUse& use) {
  return {.texture = snapshot.find(use.texture) ? use.texture.index() : kernels::kNone,
          .uv_set = use.uv_set,
          .channel = use.channel,
          .scale = use.scale,
          .offset = use.offset,
          .uv_x = use.uv_transform[0],
          .uv_y = use.uv_transform[1],
          .uv_offset = use.uv_transform[2]};
}

std::shared_ptr<const Materials> make_materials(const Snapshot& snapshot, DerivedCache& cache) {
  auto made = std::make_shared<Materials>();
  const u32 capacity = snapshot.materials.capacity();
  const Material standard = make_material();
  Material black = standard;
  black[MaterialParameter::base_color].value = black[MaterialParameter::specular].value = vec3(0);
  made->materials.resize(capacity + 2);
  snapshot.materials.for_each([&](u32 index, const Shared<Material>& row) {
    made->materials[index] = view_of(snapshot, *row.value, index, made->uses);
  });
  made->materials[capacity] = view_of(snapshot, standard, kernels::kNone, made->uses);
  made->materials[capacity + 1] = view_of(snapshot, black, kernels::kNone, made->uses);
  const std::vector<bool> filtered = filtered_textures(snapshot);
  made->textures.resize(snapshot.textures.capacity());
  snapshot.textures.for_each([&](u32 index, const Shared<Texture>& row) {
    kernels::TextureView& view = made->textures[index] = view_of(*row.value);
    made->kept.push_back(row.value->image);
    if (!filtered[index]) return;
    const auto mips = mips_of(*row.value, view, cache);
    if (!mips) return;
    view.mips = mips->texels.data();
    made->kept.push_back(mips);
  });
  return made;
}

DerivedKey key_of(Derived kind, const Texture& texture) {
  const ImageData& image = *texture.image;
  // With its number of bytes this gives its height.
  const u64 layout = u64(image.width) | u64(image.channels) << 32 | u64(image.type) << 40;
  return {kind, {image.texels->serial(), layout, texture.srgb, texture.nearest}};
}

vec4 texture_mean(const Texture& texture, DerivedCache& cache) {
  const DerivedKey key = key_of(Derived::kTextureMean, texture);
  const auto mean = cache.get<TextureMean>(key, {texture.image->texels}, [&] {
    const kernels::TextureView view = view_of(texture);
    glm::dvec4 sum(0);
    const u64 count = u64(view.width) * view.height;
    for (u64 i = 0; i < count; ++i)
      sum += glm::dvec4(kernels::as_radiance(kernels::load_rgba(view, i)));
    return std::make_shared<TextureMean>(TextureMean{vec4(sum / double(count))});
  });
  return mean->value;
}

}  // namespace heliograph::resident
