// Media in closed surfaces, and which of them a path is inside of. Called by the steps of path.h.
#pragma once

#include "kernels/geometry/surface.h"

namespace heliograph::kernels::inline HELIO_ISA {

// ---------------------------------------------------------------- media

/// Medium in a closed surface, alike everywhere. By colour, 1/m.
struct Interior {
  vec3 extinction;
  vec3 scattering;  // at most the extinction
  float g;          // of the phase function
};

/// The medium behind a surface of these values.
KERNEL Interior interior_of(const MaterialValues& m) {
  Interior medium{m.medium_density, m.medium_density * m.medium_albedo, m.medium_anisotropy};
  if (m.attenuation_distance > 0) {
    const vec3 color = glm::max(m.attenuation_color, vec3(1e-6f));
    medium.extinction -= vec3(std::log(color.x), std::log(color.y), std::log(color.z)) *
                         (1 / m.attenuation_distance);
  }
  return medium;
}

/// Share of light that passes a distance [m], which may be infinite.
///
/// Source: Beer 1852; Lambert 1760.
KERNEL vec3 transmittance(const Interior& m, float distance) {
  const auto channel = [distance](float extinction) {
    return extinction > 0 ? std::exp(-extinction * distance) : 1.0f;
  };
  return vec3(channel(m.extinction.x), channel(m.extinction.y), channel(m.extinction.z));
}

/// How far light flies before the medium meets it. Colours fly alike: one of them chooses, by what
/// it carries, and the weights are those of the balance heuristic over all three, so that no
/// colour's weight times what it carries exceeds the sum of what all carry.
///
/// Source: Veach and Guibas 1995 (one-sample model); Wilkie et al. 2014, "Hero Wavelength Spectral
/// Sampling".
struct Flight {
  float distance;  // metres, or infinite
  vec3 chance;     // of each colour to have chosen
};
/// u   uniform in [0, 1)
KERNEL Flight choose_flight(const Interior& m, vec3 carried, vec2 u) {
  const vec3 p = carried * (1 / (carried.x + carried.y + carried.z));
  const float extinction = u.x < p.x         ? m.extinction.x
                           : u.x < p.x + p.y ? m.extinction.y
                                             : m.extinction.z;
  return {extinction > 0 ? -std::log(1 - u.y) / extinction : INFINITY, p};
}
/// Weight of light that flies past a distance, which is less than the flight's.
KERNEL vec3 weight_of_passing(const Interior& m, const Flight& flight, float distance) {
  const vec3 passing = transmittance(m, distance);
  return passing * (1 / dot(flight.chance, passing));
}
/// Weight of light that the medium scatters at the flight's distance.
KERNEL vec3 weight_of_scattering(const Interior& m, const Flight& flight) {
  const vec3 passing = transmittance(m, flight.distance);
  return m.scattering * passing * (1 / dot(flight.chance, m.extinction * passing));
}

// ---------------------------------------------------------------- inside

/// The most closed surfaces about a point that a path keeps track of. It is not inside of what it
/// enters beyond.
inline constexpr u32 kMaxMediumDepth = 4;
/// The most passable surfaces that a ray goes through between two vertices of a path.
inline constexpr u32 kMostPassed = 64;

/// The closed surfaces about a point, by priority; of equal ones the innermost last. The last one
/// is what fills the place.
struct Inside {
  struct Layer {
    const InstanceView* instance;
    const MaterialView* material;
    Interior medium;
    float ior;
  };
  Layer layers[kMaxMediumDepth];
  u32 depth = 0;
};

/// True if paths keep track of what they are inside of.
KERNEL bool has_media(const SceneView& scene) { return kRich && scene.any_media; }

/// True if something fills the place.
KERNEL bool is_filled(const Inside& inside) { return kRich && inside.depth > 0; }

/// Medium that fills it, if something does.
KERNEL const Interior& interior_in(const Inside& inside) {
  return inside.layers[inside.depth - 1].medium;
}

/// Share of light that passes a distance [m].
KERNEL vec3 transmittance(const Inside& inside, float distance) {
  return is_filled(inside) ? transmittance(interior_in(inside), distance) : vec3(1);
}

/// The innermost layer with the surface's instance, if it can be one that was entered by the same
/// material; kNone: there is none.
KERNEL u32 layer_of(const Inside& inside, const Surface& s) {
  u32 found = kNone;
  for (u32 i = inside.depth; i-- > 0;) {
    const Inside::Layer& layer = inside.layers[i];
    if (layer.instance != s.instance) continue;
    if (found == kNone) found = i;
    if (layer.material != s.material) continue;
    return i;
  }
  return found;
}

/// Takes it away; whether there was one.
KERNEL bool leave(Inside& inside, const Surface& s) {
  const u32 found = layer_of(inside, s);
  if (found == kNone) return false;
  --inside.depth;
  for (u32 i = found; i < inside.depth; ++i) inside.layers[i] = inside.layers[i + 1];
  return true;
}

/// Puts in what a surface surrounds, as the innermost or the outermost of its priority.
HELIO_GPU_NOINLINE KERNEL void enter(Inside& inside, const Surface& s, const MaterialValues& m,
                                     bool innermost) {
  if (inside.depth == kMaxMediumDepth) return;
  u32 at = inside.depth++;
  const i32 priority = s.material->priority;
  for (; at > 0; --at) {
    const Inside::Layer& below = inside.layers[at - 1];
    const i32 other = below.material->priority;
    if (innermost ? other <= priority : other < priority) break;
    inside.layers[at] = below;
  }
  inside.layers[at] = {s.instance, s.material, interior_of(m), m.ior};
}

/// Light crosses a surface in a direction.
KERNEL void cross_surface(Inside& inside, const Surface& s, const MaterialValues& m,
                          vec3 direction) {
  if (!is_body(*s.material)) return;
  if (dot(direction, s.ng) >= 0) {
    leave(inside, s);
  } else {
    enter(inside, s, m, true);
  }
}

/// Action of light at a surface: scatters, or goes straight on through the boundary of a medium or
/// as if nothing were there.
enum class Meeting : u8 { kScatters, kPasses, kAbsent };
struct Boundary {
  Meeting meeting;
  float outside;  // index of what is on the side that is not the surface's own inside
};

/// A ray that starts inside of something meets a surface. One is absent where a body of higher
/// priority, or of the same but further in, fills both of its sides.
///
/// Source: Schmidt and Budge 2002, "Simple Nested Dielectrics in Ray Traced Images", journal of
/// graphics tools 7(2).
KERNEL Boundary boundary_at(const SceneView& scene, const Inside& inside, const Surface& s,
                            vec3 direction) {
  const Meeting alone = kRich && s.material->passable ? Meeting::kPasses : Meeting::kScatters;
  if (!scene.any_priority || !is_filled(inside)) return {alone, 1};
  const bool body = is_body(*s.material);
  const bool leaves = body && dot(direction, s.ng) >= 0;
  const u32 own = leaves ? layer_of(inside, s) : kNone;
  const u32 others = own == inside.depth - 1 ? own : inside.depth;
  if (others == 0) return {alone, 1};
  const Inside::Layer& other = inside.layers[others - 1];
  if (body) {
    const bool hidden =
        own == kNone ? other.material->priority > s.material->priority : own < others;
    if (hidden) return {Meeting::kAbsent, 1};
  }
  return {other.ior == 1 ? alone : Meeting::kScatters, other.ior};
}

/// Colour that glass of a base colour gives to light at each crossing, as in set_interface().
KERNEL vec3 tint_of_crossing(const MaterialValues& m) {
  return vec3(std::sqrt(m.base_color.x), std::sqrt(m.base_color.y), std::sqrt(m.base_color.z));
}

/// Finds what a point is inside of: the surfaces that a ray from it leaves without having entered
/// them. Adds the rays that it takes.
template <Tracer T>
HELIO_RARE KERNEL Inside inside_at(const SceneView& scene, const T& tracer, Ray ray, u32& rays) {
  Inside found, entered;
  ray.direction = vec3(0.2139f, 0.4587f, 0.86248f);  // any: this one meets no mesh along an edge
  ray.t_max = INFINITY;
  for (u32 i = 0; i < kMostPassed; ++i) {
    const Hit hit = tracer.closest(ray, kAllRays);
    ++rays;
    if (hit.instance == kNone) break;
    const Surface s = locate(scene, hit.instance, hit.primitive, vec2(hit.u, hit.v), ray.time);
    ray.origin = offset_point(s, ray.direction);
    if (!is_body(*s.material)) continue;
    const MaterialValues m = material_at(scene, s, ~kAlphaBit);
    if (dot(ray.direction, s.ng) < 0) {
      cross_surface(entered, s, m, ray.direction);
    } else if (!leave(entered, s)) {
      enter(found, s, m, false);  // what is left first is the innermost
    }
  }
  return found;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
