// Surfaces that paths have come to, side by side: what scatter() of path.h takes and gives, a path
// in each lane. Called by lockstep.h.
//
// Tested: tests/unit/lockstep_test.cpp, against render_pixel().
#pragma once

#include "kernels/integrator/path.h"
#include "kernels/light/light_lanes.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Surfaces that are put side by side: those that take the same steps.
enum class Company : u8 { kOpaque, kGlass, kCovered, kFilm };
inline constexpr u32 kCompanies = 4;
KERNEL Company company_of(const MaterialValues& m, bool thin_walled) {
  if (features_of(m, thin_walled) == Features::kOpaque) return Company::kOpaque;
  if (m.iridescence > 0) return Company::kFilm;
  return m.transmission > 0 ? Company::kGlass : Company::kCovered;
}

/// Paths that wait at surfaces, at most kLanes of them.
struct Waiting {
  u32 count = 0;
  u32 items[kLanes];  // of the paths, as their driver numbers them
  Path* paths[kLanes];
  const DrawnPairs* numbers[kLanes];  // the pairs of their vertices
  Vertex* vertices[kLanes];
  SampleValues* values[kLanes];
};

/// Paths that wait, side by side. Lanes that hold none have what the first has, but for parameters
/// that only some surfaces have: zeros, or those of earlier ones.
template <Features S>
struct ScatterLanes : Waiting {
  MaterialValuesOf<Floats> material{};
  ShadingPointOf<Floats> at{};
  Vec3<Floats> p;
  Floats offset, time;  // of Surface
  CarriedOf<Floats> carried;
  Mask looks;    // for casters
  Mask is_last;  // vertex of the path
  Mask roulette;
  Vec2<Floats> light, scatter, chance;  // uniform in [0, 1)
};

/// Parameters of all materials that decide how they scatter light.
KERNEL void read_parameters(const Waiting& waiting, MaterialValuesOf<Floats>& m) {
  using Values = MaterialValues;
  static_assert(offsetof(Values, metallic) == 12 && offsetof(Values, roughness) == 16 &&
                offsetof(Values, specular) == 20 && offsetof(Values, specular_color) == 24 &&
                offsetof(Values, ior) == 36 && offsetof(Values, specular_tint) == 108);
  const auto row = [&](u32 number) {
    return read4([&](u32 i) { return &waiting.vertices[i]->material.base_color.x + 4 * number; });
  };
  const FourOf<Floats> first = row(0), second = row(1), third = row(2);
  m.base_color = {first.of[0], first.of[1], first.of[2]};
  m.metallic = first.of[3];
  m.roughness = second.of[0];
  m.specular = second.of[1];
  m.specular_color = {second.of[2], second.of[3], third.of[0]};
  m.ior = third.of[1];
  m.specular_tint = row(6).of[3];
}
/// Reads the parameters that only some materials have.
KERNEL void read_others(const SceneView& scene, const Waiting& waiting, MaterialValuesOf<Floats>& m,
                        ShadingPointOf<Floats>& at) {
  for (u32 i = 0; i < waiting.count; ++i) {
    const Vertex& v = *waiting.vertices[i];
#define HELIO_PUT(name) put(m.name, i, v.material.name);
    HELIO_LOBE_PARAMETERS(HELIO_PUT)
#undef HELIO_PUT
    const ShadingPoint own =
        shading_point(scene, v.surface, v.material, -waiting.paths[i]->ray.direction);
    put(at.tangent, i, own.tangent);
    put(at.clearcoat_normal, i, own.clearcoat_normal);
    put(at.thin_walled, i, own.thin_walled);
  }
}

/// Reads what scatter() of path.h needs of paths that wait.
template <Features S>
KERNEL void read(const SceneView& scene, const Settings& settings, ScatterLanes<S>& lanes) {
  for (u32 i = lanes.count; i < kLanes; ++i) {
    lanes.paths[i] = lanes.paths[0];
    lanes.numbers[i] = lanes.numbers[0];
    lanes.vertices[i] = lanes.vertices[0];
  }
  read_parameters(lanes, lanes.material);
  if constexpr (S == Features::kAll) read_others(scene, lanes, lanes.material, lanes.at);

  const auto surface = [&](u32 number) {
    return read4([&](u32 i) { return &lanes.vertices[i]->surface.p.x + 4 * number; });
  };
  const FourOf<Floats> p = surface(0), ng = surface(1), ns = surface(2);
  lanes.p = {p.of[0], p.of[1], p.of[2]};
  lanes.offset = p.of[3];
  lanes.at.ng = {ng.of[0], ng.of[1], ng.of[2]};
  lanes.time = ng.of[3];
  lanes.at.ns = {ns.of[0], ns.of[1], ns.of[2]};
  for (u32 i = 0; i < kLanes; ++i) put(lanes.at.outside, i, lanes.vertices[i]->boundary.outside);

  lanes.at.wo = -read3([&](u32 i) { return &lanes.paths[i]->ray.direction.x; });
  static_assert(offsetof(PathState, pdf) == 12 && offsetof(PathState, from_p) == 16 &&
                offsetof(PathState, radiance_scale) == 28);
  const auto path = [&](u32 number) {
    return read4([&](u32 i) { return &lanes.paths[i]->throughput.x + 4 * number; });
  };
  const FourOf<Floats> throughput = path(0);
  lanes.carried = {{throughput.of[0], throughput.of[1], throughput.of[2]}, path(1).of[3]};
  for (u32 i = 0; i < kLanes; ++i) {
    const Path& of = *lanes.paths[i];
    put(lanes.roulette, i, roulette_begins(settings, of));
    put(lanes.looks, i, looks_for_casters(scene, of));
    put(lanes.is_last, i, is_last(settings, of));
  }

  static_assert(kLightPair == 0 && kScatterPair == 1 && kChancePair == 2);
  const auto pairs = [&](u32 first) {
    return read4([&](u32 i) { return &lanes.numbers[i]->of[first].x; });
  };
  const FourOf<Floats> numbers = pairs(kLightPair), chances = pairs(kChancePair);
  lanes.light = {numbers.of[0], numbers.of[1]};
  lanes.scatter = {numbers.of[2], numbers.of[3]};
  lanes.chance = {chances.of[0], chances.of[1]};
}

/// go_on() of path_state.h from opaque surfaces, but for leave(). Paths that end are written, too,
/// and the first again by lanes that hold none.
///
/// n   of receivers
KERNEL void go_on(const ScatterLanes<Features::kOpaque>& lanes, const DirectionOf<Floats>& to,
                  Vec3<Floats> n) {
  const BsdfSampleOf<Floats>& s = to.sample;
  const Vec3<Floats>&throughput = to.carried.throughput, &p = lanes.p, &wi = s.wi;
  const Vec3<Floats> origin = offset_point(p, lanes.at.ng, lanes.offset, wi);
  const auto row = [&](u32 number) {
    return [&lanes, number](u32 i) { return &lanes.paths[i]->throughput.x + 4 * number; };
  };
  write4(row(0), throughput.x, throughput.y, throughput.z, s.pdf);
  write4(row(1), p.x, p.y, p.z, to.carried.radiance_scale);
  static_assert(offsetof(PathState, from_n) == 32 && offsetof(PathState, passed) == 44);
  write4(row(2), n.x, n.y, n.z, Floats(0));
  static_assert(offsetof(Ray, direction) == 12 && offsetof(Ray, t_max) == 24 &&
                offsetof(Ray, time) == 28);
  write4([&](u32 i) { return &lanes.paths[i]->ray.origin.x; }, origin.x, origin.y, origin.z, wi.x);
  write4([&](u32 i) { return &lanes.paths[i]->ray.direction.y; }, wi.y, wi.z, Floats(INFINITY),
         lanes.time);
}

/// aim() of direct_light.h. Where `found` is false there is no light.
///
/// sent(i)   where that of lane i is to be
template <class A>
KERNEL void aim(const TakenLightOf<Floats>& taken, Mask found, Vec3<Floats> radiance, Floats time,
                const A& sent) {
  const Vec3<Floats>&origin = taken.ray.origin, &direction = taken.ray.direction;
  write4([&](u32 i) { return &sent(i)->ray.origin.x; }, origin.x, origin.y, origin.z, direction.x);
  write4([&](u32 i) { return &sent(i)->ray.direction.y; }, direction.y, direction.z,
         select(found, taken.ray.end, Floats(0)), time);
  static_assert(offsetof(Contribution, edges) == 12);  // which send_taken() sets
  write4([&](u32 i) { return &sent(i)->light.radiance.x; }, radiance.x, radiance.y, radiance.z,
         Floats(0));
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
/// Sets what Vertex has of a Bsdf once light has been taken, but for ng: it is not evaluated any
/// more.
template <Features S>
KERNEL void get_frame(const BsdfOf<Floats, S>& b, u32 i, Bsdf& to) {
  to.frame.n = get(b.frame.n, i);
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

/// follow() of path.h for the lanes of `scattering`. Returns those whose paths go on.
///
/// surfaces       Receiver::surface_share
/// context_of()   of the path in a lane
template <class C>
KERNEL u32 follow(const ScatterLanes<Features::kAll>& lanes, const BsdfOf<Floats, Features::kAll>&,
                  const Floats&, const DirectionOf<Floats>& to, u32 scattering,
                  const C& context_of) {
  u32 goes_on = 0;
  for (u32 i = 0; i < lanes.count; ++i) {
    Path& path = *lanes.paths[i];
    Vertex& v = *lanes.vertices[i];
    if (!(scattering >> i & 1))
      record_guides(path, v, *lanes.values[i]);
    else if (follow(context_of(i), path, v, get(to, i), *lanes.values[i]))
      goes_on |= 1u << i;
  }
  return goes_on;
}
template <class C>
KERNEL u32 follow(const ScatterLanes<Features::kOpaque>& lanes,
                  const BsdfOf<Floats, Features::kOpaque>& bsdf, const Floats& surfaces,
                  const DirectionOf<Floats>& to, u32 scattering, const C& context_of) {
  const u32 vertices = bits_of(to.is_vertex), left = scattering & bits_of(to.goes_on);
  for (u32 i = 0; i < lanes.count; ++i) {
    Path& path = *lanes.paths[i];
    if (path.guided) continue;
    if (!(scattering >> i & 1))
      record_guides(path, *lanes.vertices[i], *lanes.values[i]);
    else if (vertices >> i & 1)
      record_guides(path, get(to.guide, i), get(bsdf.frame.n, i), *lanes.values[i]);
  }
  go_on(lanes, to, bsdf.frame.n);
  u32 goes_on = 0;
  for (u32 i = 0; i < lanes.count; ++i) {
    if (!(left >> i & 1)) continue;
    Path& path = *lanes.paths[i];
    const auto c = context_of(i);
    if (takes_route(c, path)) path.route = route_of(get(to, i).sample, false);
    const bool diffuse = Lobe(get(to.sample.lobe.v, i)) == Lobe::kDiffuse;
    leave(c, path,
          {get(to.sample.pdf, i), get(to.spread, i), diffuse ? kDiffuseRay : kGlossyRay,
           Facing::kFront, get(surfaces, i)});
    if (path.edges <= c.settings.max_depth) goes_on |= 1u << i;
  }
  return goes_on;
}

/// Light that is sampled for each lane.
struct SampledLights {
  LightLanes lanes;
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
