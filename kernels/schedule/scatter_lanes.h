// Surfaces that paths have come to, side by side: what scatter() of path.h takes and gives, a path
// in each lane. Called by lockstep.h.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include "kernels/integrator/path.h"
#include "kernels/light/light_lanes.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Which surfaces are put side by side: those that take the same steps.
enum class Company : u8 { kOpaque, kGlass, kCovered, kFilm };
inline constexpr u32 kCompanies = 4;
KERNEL Company company_of(const MaterialValues& m, bool thin_walled) {
  if (features_of(m, thin_walled) == Features::kOpaque) return Company::kOpaque;
  if (m.iridescence > 0) return Company::kFilm;
  return m.transmission > 0 ? Company::kGlass : Company::kCovered;
}

/// Parameters of materials that decide how they scatter light: of opaque ones, and of the others.
#define HELIO_OPAQUE_PARAMETERS(X) \
  X(base_color)                    \
  X(metallic)                      \
  X(roughness)                     \
  X(specular)                      \
  X(specular_color)                \
  X(ior)                           \
  X(specular_tint)
#define HELIO_OTHER_PARAMETERS(X) \
  X(transmission)                 \
  X(transmission_roughness)       \
  X(subsurface)                   \
  X(subsurface_radius)            \
  X(subsurface_color)             \
  X(anisotropic)                  \
  X(sheen)                        \
  X(sheen_color)                  \
  X(sheen_roughness)              \
  X(sheen_tint)                   \
  X(clearcoat)                    \
  X(clearcoat_roughness)          \
  X(iridescence)                  \
  X(iridescence_ior)              \
  X(iridescence_thickness)        \
  X(diffuse_transmission)         \
  X(diffuse_transmission_color)

/// Paths at surfaces, fewer than kLanes or so many. Lanes that hold none are computed, too: they
/// begin as zeros, and then hold those of others.
template <Features S>
struct ScatterLanes {
  u32 count = 0;
  u32 items[kLanes];         // of the paths, as their driver numbers them
  Vertex* vertices[kLanes];  // where they are

  MaterialValuesOf<Floats> material{};
  ShadingPointOf<Floats> at{};
  Vec3<Floats> p{0};
  Floats offset = 0;  // Surface::offset
  CarriedOf<Floats> carried{};
  Mask looks = false;    // for casters
  Mask is_last = false;  // vertex of the path
  Mask roulette = false;
  Vec2<Floats> light{0}, scatter{0}, chance{0};  // uniform in [0, 1)
};

/// Adds a path at a surface.
template <Features S, Tracer T>
KERNEL void add(ScatterLanes<S>& lanes, const PathContext<T>& c, const Path& path, Vertex& v,
                u32 item) {
  const u32 i = lanes.count++;
  lanes.items[i] = item;
  lanes.vertices[i] = &v;
  const MaterialValues& m = v.material;
  const ShadingPoint at = shading_point(c.scene, v.surface, m, -path.ray.direction);
#define HELIO_PUT(name) put(lanes.material.name, i, m.name);
  HELIO_OPAQUE_PARAMETERS(HELIO_PUT)
  if constexpr (S == Features::kAll) {
    HELIO_OTHER_PARAMETERS(HELIO_PUT)
    put(lanes.at.tangent, i, at.tangent);
    put(lanes.at.clearcoat_normal, i, at.clearcoat_normal);
    put(lanes.at.thin_walled, i, at.thin_walled);
  }
#undef HELIO_PUT
  put(lanes.at.wo, i, at.wo);
  put(lanes.at.ng, i, at.ng);
  put(lanes.at.ns, i, at.ns);
  put(lanes.at.outside, i, v.boundary.outside);
  put(lanes.p, i, v.surface.p);
  put(lanes.offset, i, v.surface.offset);
  put(lanes.carried.throughput, i, path.throughput);
  put(lanes.carried.radiance_scale, i, path.radiance_scale);
  put(lanes.roulette, i, roulette_begins(c, path));
  put(lanes.looks, i, looks_for_casters(c, path));
  put(lanes.is_last, i, is_last(c, path));
  put(lanes.light, i, c.sampler.get2(vertex_pair(path, kLightPair)));
  put(lanes.scatter, i, c.sampler.get2(vertex_pair(path, kScatterPair)));
  put(lanes.chance, i, c.sampler.get2(vertex_pair(path, kChancePair)));
}

/// One of the lanes.
KERNEL TakenLightOf<float> get(const TakenLightOf<Floats>& taken, u32 i) {
  const ShadowRayOf<Floats>& ray = taken.ray;
  return {true,
          {get(ray.origin, i), get(ray.direction, i), get(ray.end, i), true},
          get(taken.total, i),
          get(taken.diffuse, i),
          get(taken.weight, i)};
}
KERNEL DirectionOf<float> get(const DirectionOf<Floats>& to, u32 i) {
  const BsdfSampleOf<Floats>& s = to.sample;
  return {{get(s.wi, i), get(s.weight, i), get(s.diffuse, i), get(s.pdf, i), get(s.eta, i),
           Lobe(get(s.lobe.v, i))},
          get(to.goes_on, i),
          get(to.is_vertex, i),
          get(to.guide, i),
          {get(to.carried.throughput, i), get(to.carried.radiance_scale, i)},
          get(to.spread, i)};
}
/// What Vertex has of a Bsdf once light has been taken: it is not evaluated any more.
template <Features S>
KERNEL void get_frame(const BsdfOf<Floats, S>& b, u32 i, Bsdf& to) {
  to.frame.n = get(b.frame.n, i);
  to.ng = get(b.ng, i);
  to.glass = 0;
  to.layered = false;
  to.diffuse_through_share = 0;
  if constexpr (S == Features::kOpaque) return;
  to.frame.s = get(b.frame.s, i);
  to.frame.t = get(b.frame.t, i);
  to.glass = get(b.glass, i);
  to.layered = get(b.layered, i);
  if constexpr (S == Features::kAll) to.diffuse_through_share = get(b.diffuse_through_share, i);
}

/// Light that is sampled for each lane.
struct SampledLights {
  LightLanes lanes{};
  Mask alone = false;      // of these lanes lights are sampled one by one,
  LightSample of[kLanes];  // and here
};
/// One of them.
KERNEL LightSample get(const SampledLights& lights, u32 i, float time) {
  if (get(lights.alone, i)) return lights.of[i];
  const LightLanes& lanes = lights.lanes;
  LightSample light{};
  light.direction = get(lanes.to.direction, i);
  light.light = u32(get(lanes.light, i));
  light.sun = kNone;
  light.time = time;
  light.place = get(lanes.place, i);
  return light;
}

/// Samples the chosen lights of lights.alone.
template <Features S>
KERNEL void sample_each(const SceneView& scene, const ScatterLanes<S>& lanes,
                        const LightChoiceOf<Floats>& choices, SampledLights& lights) {
  LightDirectionOf<Floats>& all = lights.lanes.to;
  all.pdf = select(lights.alone, Floats(0), all.pdf);
  for (u32 i = 0; i < lanes.count; ++i) {
    if (!get(lights.alone, i)) continue;
    LightSample& light = lights.of[i];
    const LeafChoiceOf<Floats>& leaf = choices.leaf;
    const LightChoiceOf<float> choice{
        get(choices.of_tree, i),
        {u32(get(leaf.node, i)), get(leaf.probability, i), get(leaf.rest, i)}};
    const Receiver& receiver = lanes.vertices[i]->receiver;
    if (!sample_light(scene, receiver, choice, get(lanes.light, i), light)) continue;
    const LightDirectionOf<float> to = direction_of(light);
    put(all.direction, i, to.direction);
    put(all.target, i, to.target);
    put(all.pdf, i, to.pdf);
    put(all.visibility, i, to.visibility);
    put(all.near, i, to.near);
  }
}

/// Asks for texels of the dome that lights were sampled at.
KERNEL void prefetch_sky(const SceneView& scene, const LightLanes& lights, u32 count) {
  if (scene.dome.texture == kNone) return;
  const TextureView& texture = scene.textures[scene.dome.texture];
  for (u32 i = 0; i < count; ++i) prefetch_texel(texture, get(lights.place, i));
}

}  // namespace heliograph::kernels::inline HELIO_ISA
