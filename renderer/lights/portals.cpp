// Where portals are, and what of the dome their planes see.
#include "renderer/lights/portals.h"

#include <bit>
#include <glm/gtc/quaternion.hpp>

#include "kernels/light/light.h"
#include "renderer/base/parallel.h"
#include "renderer/derived/materials.h"

namespace heliograph::resident {
namespace {

using kernels::kPortalSide;

// Samples of the dome along a texel of the map: as close as the dome's texels, within these.
constexpr u32 kFewestSamples = 4, kMostSamples = 16;

u64 bits(float a, float b) { return u64(std::bit_cast<u32>(a)) << 32 | std::bit_cast<u32>(b); }

/// Means over the texels of row y of the luminance that comes along directions, times the solid
/// angle of their texel; the map's area is 1.
void fill_row(u32 y, u32 samples, double* out, const auto& radiance) {
  const float step = 1 / float(kPortalSide * samples);
  for (u32 x = 0; x < kPortalSide; ++x) {
    double sum = 0;
    for (u32 j = 0; j < samples; ++j)
      for (u32 i = 0; i < samples; ++i) {
        const vec2 place(float(x * samples + i) + 0.5f, float(y * samples + j) + 0.5f);
        const vec3 d = kernels::portal_direction(place * step);
        sum += double(radiance(d)) * double(kernels::portal_stretch(d));
      }
    out[x] = sum * double(step) * double(step);
  }
}

/// From each texel to the sum of all those below and to the left.
void accumulate(std::vector<double>& sums) {
  const std::size_t width = kPortalSide + 1;
  for (std::size_t y = 1; y < width; ++y) {
    double row = 0;
    for (std::size_t x = 1; x < width; ++x) {
      row += sums[y * width + x];
      sums[y * width + x] = sums[(y - 1) * width + x] + row;
    }
  }
}

}  // namespace

bool place_portal(const Portal& portal, const mat4x3& world, kernels::PortalView& out) {
  const vec3 x = world[0] * portal.width, y = world[1] * portal.height;
  out.x = kernels::normalize_or(x, vec3(0));
  const vec3 normal = kernels::normalize_or(glm::cross(x, y), vec3(0));
  out.z = glm::dot(normal, world[2]) < 0 ? -normal : normal;
  out.y = glm::cross(out.z, out.x);
  out.center = world[3];
  // A sheared rectangle has the one about it.
  out.half =
      0.5f * vec2(glm::length(x) + std::abs(glm::dot(y, out.x)), std::abs(glm::dot(y, out.y)));
  return out.half.x > 0 && out.half.y > 0;
}

std::shared_ptr<const PortalMap> portal_map(const Texture* texture, const kernels::DomeView& dome,
                                            const kernels::PortalView& portal,
                                            DerivedCache& cache) {
  const mat3 axes(portal.x, portal.y, portal.z);
  const glm::quat turn = glm::normalize(glm::quat_cast(dome.dome_from_world * axes));
  DerivedKey key{Derived::kPortal};
  Sources sources;
  if (texture) {
    const auto [texels, layout, srgb, nearest, _] = key_of(Derived::kPortal, *texture).from;
    key.from = {texels, layout, srgb | nearest << 1};
    sources = {texture->image->texels};
  }
  key.from[3] = bits(turn.x, turn.y);
  key.from[4] = bits(turn.z, turn.w);
  return cache.get<PortalMap>(key, std::move(sources), [&] {
    auto map = std::make_shared<PortalMap>();
    map->sums.resize(std::size_t(kPortalSide + 1) * (kPortalSide + 1));
    kernels::SceneView scene{};
    const kernels::TextureView view = texture ? view_of(*texture) : kernels::TextureView{};
    scene.textures = &view;
    scene.dome.radiance = vec3(1);
    scene.dome.texture = texture ? 0 : kernels::kNone;
    scene.dome.dome_from_world = glm::mat3_cast(turn);
    const auto radiance = [&](vec3 d) {
      const vec2 place = texture ? kernels::dome_place(scene.dome, d).uv : vec2(0);
      return kernels::luminance(kernels::dome_radiance(scene, place));
    };
    const u32 texels = texture ? texture->image->width / (2 * kPortalSide) : 0;
    const u32 samples = std::clamp(texels, kFewestSamples, kMostSamples);
    parallel_for(kPortalSide, [&](u32 y) {
      fill_row(y, samples, map->sums.data() + std::size_t(y + 1) * (kPortalSide + 1) + 1, radiance);
    });
    accumulate(map->sums);
    return map;
  });
}

}  // namespace heliograph::resident
