// How much of which lobe the base of a material has, seen from a direction. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_body.h"
#include "kernels/bsdf/base_film.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// The hue of a colour at luminance 1; white of black.
template <class F>
KERNEL Vec3<F> tint_of(Vec3<F> color) {
  const F light = luminance(color);
  return select(light > 0, color / light, Vec3<F>(1));
}

/// Reflectance of a dielectric in something of index `outside` at normal incidence, coloured, in
/// full.
template <class F>
KERNEL Vec3<F> dielectric_f0(const MaterialValuesOf<F>& m, F outside) {
  Vec3<F> color = m.specular_color * sqr((m.ior - outside) / (m.ior + outside));
  if (const auto tinted = m.specular_tint > 0; any(tinted)) {
    const Vec3<F> tint = Vec3<F>(1) + (tint_of(m.base_color) - Vec3<F>(1)) * m.specular_tint;
    color *= select(tinted, tint, Vec3<F>(1));
  }
  return min3(color, Vec3<F>(1));
}

template <class F>
KERNEL ThinFilmOf<F> film_of(const MaterialValuesOf<F>& m, F outside) {
  const float nanometre = 1e-9f;
  return {select(m.iridescence_thickness > 0, m.iridescence, F(0)), m.iridescence_ior / outside,
          2 * nanometre * m.iridescence_thickness * m.iridescence_ior};
}

/// Materials of coat and metal.
template <class F>
struct OpaqueMaterial {
  Vec3<F> base_color;
  Vec3<F> f0;  // of the coat, in full
  F specular, metallic;
  F plastic;  // weight of the coat
};

/// Their Fresnel. Returns its averages by cosine.
template <class F, Features S>
KERNEL ReflectancesOf<F> set_fresnel(BaseOf<F, S>& b, const OpaqueMaterial<F>& m) {
  const Vec3<F> coat_f0 = m.f0 * m.specular;
  b.f0 = coat_f0 * m.plastic + m.base_color * m.metallic;
  b.f90 = m.specular * m.plastic + m.metallic;
  b.coat_f0 = max_component(coat_f0);
  b.coat_f90 = m.specular;
  return {coat_f0 + (Vec3<F>(m.specular) - coat_f0) * F(kSchlickMean),
          m.base_color + (Vec3<F>(1) - m.base_color) * F(kSchlickMean)};
}

/// Sets what their microfacets scatter more than once, per unit of light that they lose. Returns
/// that of the coat, in full.
template <class F, Features S>
KERNEL Vec3<F> set_multiple(BaseOf<F, S>& b, const OpaqueMaterial<F>& m,
                            const ReflectancesOf<F>& mean, const AlbedoOf<F>& average) {
  const BoolOf<F> rough = !is_mirror(b);
  b.multiple = Vec3<F>(0);
  b.coat_multiple = F(0);
  if (!any(rough)) return Vec3<F>(0);
  const Vec3<F> coat = select(rough, multiple_scattering(mean.coat, average.total), Vec3<F>(0));
  b.coat_multiple = max_component(coat);
  b.multiple = coat * m.plastic;
  if (const auto metallic = rough & (m.metallic > 0); any(metallic)) {
    const Vec3<F> metal = multiple_scattering(mean.metal, average.total) * m.metallic;
    b.multiple += select(metallic, metal, Vec3<F>(0));
  }
  return coat;
}

/// Returns what microfacets seen from wo reflect at once. out: their albedo there
template <class F, Features S>
KERNEL F facets_reflect(const BaseOf<F, S>& b, const AlbedoOf<F>& out) {
  return luminance(b.f0) * (out.total - out.schlick) + b.f90 * out.schlick;
}

/// The lobes sampled by cosine, from what multiple scattering is per unit of lost light. Returns
/// their albedo.
///
/// under      light that leaves the coat's underside towards wo
/// through    light that has come through from the far side
/// lost       share of light that microfacets lose towards wo
template <class F, Features S>
KERNEL F set_diffuse(BaseOf<F, S>& b, Vec3<F> under, Vec3<F> through, F lost,
                     const AlbedoOf<F>& average) {
  b.average_entering = max2(1 - coat_albedo(b, average), F(1e-4f));
  F share = luminance(under) + luminance(b.multiple) * lost;
  b.diffuse = under * (kInvPi / b.average_entering);
  share += set_diffuse_through(b, Vec3<F>(through), F(kInvPi / b.average_entering), share);
  b.multiple *= kInvPi * lost / max2(1 - average.total, F(1e-4f));
  return share;
}

/// Share of light that rough glass gives up: tables give up to so much too much between their
/// entries, and more where they stand for stretched microfacets, a lobe apart or a film.
inline constexpr float kTableMargin = 1e-3f;
inline constexpr float kWideTableMargin = 4e-3f;

/// The albedo of microfacets on average over all directions.
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL AlbedoOf<F> average_albedo(const BaseOf<F, S>& b) {
  return either(
      is_mirror(b), [&] { return AlbedoOf<F>{F(1), F(kSchlickMean)}; },
      [&] {
        return either(
            is_stretched(b), [&] { return albedo_average(b.anisotropic); },
            [&] { return albedo_average(b.albedo); });
      });
}

/// A film on coat and metal changes what its microfacets reflect. covered: where there is one
///
/// coat, facets   what coat and microfacets reflect without it
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL void cover_reflection(BaseOf<F, S>& b, BoolOf<F> covered,
                                                const ReflectancesOf<F>& mean, F total, F lost,
                                                Vec3<F> multiple, F specular, Vec3<F>& coat,
                                                F& facets) {
  const ReflectancesOf<F> film = seen_film(b);
  const Vec3<F> once = coat - Vec3<F>(b.coat_multiple * lost);
  const Vec3<F> seen = once + (film.coat * total - once) * b.film.weight + multiple * lost;
  coat = select(covered, seen, coat);
  const F most = max_component(film.coat * b.plastic + film.metal * b.metallic) * total;
  facets += select(covered, (most - facets) * b.film.weight, F(0));
  // Towards wi, the coat of Schlick's that reflects as much on average.
  const F f0 = max2(max_component(mean.coat) - specular * kSchlickMean, F(0)) / (1 - kSchlickMean);
  b.coat_f0 = select(covered, f0, b.coat_f0);
}

/// The lobes that reflect. Returns the albedo of those sampled by cosine and by microfacets.
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL Vec2<F> set_reflection(BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                                                  const ShadingPointOf<F>& at) {
  const BodyOf<F> body = body_of<S>(m, at);
  b.plastic = (1 - m.metallic) * (1 - m.transmission);
  b.metallic = m.metallic;
  const OpaqueMaterial<F> opaque{m.base_color, dielectric_f0(m, at.outside), m.specular, m.metallic,
                                 b.plastic};
  const AlbedoOf<F> average = average_albedo(b);
  const AlbedoOf<F> out = base_albedo(b, b.wo);
  ReflectancesOf<F> mean = set_fresnel(b, opaque);
  const BoolOf<F> covered = has_film<S>(b.film) & (b.f90 > 0);
  if (any(covered)) {
    b.film_coat = amplitude_below(b.film, opaque.f0);
    b.film_metal = amplitude_below(b.film, m.base_color);
    const ReflectancesOf<F> film = average_film(b);
    const Vec3<F> coat = mean.coat + (film.coat - mean.coat) * b.film.weight;
    const Vec3<F> metal = mean.metal + (film.metal - mean.metal) * b.film.weight;
    mean = {select(covered, coat, mean.coat), select(covered, metal, mean.metal)};
  }
  const Vec3<F> multiple = set_multiple(b, opaque, mean, average);
  F lost = select(is_mirror(b), F(0), max2(1 - out.total, F(0)));
  if (const auto stretched = is_stretched(b); any(stretched)) {
    lost *= select(stretched, F(1 - kWideTableMargin), F(1));
  }
  Vec3<F> coat(coat_albedo(b, out));
  F facets = facets_reflect(b, out);
  if (any(covered)) {
    cover_reflection(b, covered, mean, out.total, lost, multiple, m.specular, coat, facets);
  }
  const Vec3<F> entering = Vec3<F>(1) - coat;
  b.subsurface = body.inside * b.plastic * min_component(entering);
  const Vec3<F> below = entering * b.plastic;
  const F diffuse =
      set_diffuse(b, Vec3<F>(body.color * below), Vec3<F>(body.through * below), lost, average);
  return Vec2<F>(diffuse, facets);
}

/// Share of light that a face of glass without a film reflects, of all that it gives off.
template <class F, Features S>
KERNEL F face_reflectance(const BaseOf<F, S>& b, F roughness) {
  return either(
      sqr(roughness) < kDeltaAlpha, [&] { return fresnel_dielectric(b.wo.z, b.eta).reflectance; },
      [&] {
        const GlassAlbedoOf<F> share = glass_albedo(b.wo.z, roughness, b.eta);
        const F reflected = share.reflected + share.totally;
        return F(reflected / (reflected + share.refracted));
      });
}

/// Bounds the weight of light that refracts by itself.
inline constexpr float kMostThrough = 2;

/// Share of light from wo that microfacets of a sheet let through ...
template <class F, Features S>
KERNEL F sheet_passes(const BaseOf<F, S>& b, F through) {
  const F aspect = b.anisotropic.aspect;
  const auto rough = [&] {
    return either(
        aspect < 1, [&] { return albedo_at(AnisotropicRowOf<F>{through, aspect}, b.wo); },
        [&] { return albedo_at(albedo_row(through), b.wo.z); });
  };
  return either(b.through_delta, [] { return F(1); }, [&] { return rough().total; });
}
/// ... and those of one face.
template <class F, Features S>
KERNEL F face_passes(const BaseOf<F, S>& b, F through) {
  const GlassAlbedoOf<F> share = glass_albedo(b.wo.z, through, b.eta);
  return max2(share.refracted + share.kept, F(1e-6f));
}

/// Reflection and what passes as lobes of their own: each is scaled to give off its share whatever
/// its roughness. Returns as set_interface().
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL Vec2<F> set_apart(BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                                            F through) {
  const BoolOf<F> sheet = b.interface == Interface::kSheet;
  const BoolOf<F> split = b.interface == Interface::kSplit;
  // From inside what refracts roughly would be caught by a polished face: light that came in at an
  // angle must get out at it.
  const BoolOf<F> leaves = split & (b.eta < 1);
  Vec3<F> reflected(face_reflectance(b, F(select(leaves, through, m.roughness))));
  if (const auto film = has_film<S>(b.glass_film); any(film)) {
    const Vec3<F> covered = min3(max3(reflected + film_on_face(b).whole, Vec3<F>(0)), Vec3<F>(1));
    reflected = select(film, covered, reflected);
  }
  // Both faces of a sheet, and the bounces between them.
  reflected = select(sheet, F(2) * reflected / (Vec3<F>(1) + reflected), reflected);
  const F along = select(sheet, b.anisotropic.aspect, F(1)), alpha = sqr(through);
  b.through.x = select(sheet | split, alpha / along, b.through.x);
  b.through.y = select(sheet | split, alpha * along, b.through.y);
  const F passes = either(
      sheet, [&] { return sheet_passes(b, through); }, [&] { return face_passes(b, through); });
  b.through_scale = 1 / passes;
  // Near total reflection few facets refract: they need not carry more than this.
  const F smallest = select(sheet, F(0), 1 - kMostThrough * passes);
  b.glass_reflectance = max3(b.glass_specular * reflected, Vec3<F>(smallest));
  b.glass_scale = select(sheet | split, Vec3<F>(1 / base_albedo(b, b.wo).total), b.glass_scale);
  const Vec3<F> passing = b.glass_tint * (Vec3<F>(1) - b.glass_reflectance);
  // Each is chosen by the root of its second moment: few samples of refraction may succeed.
  return Vec2<F>(luminance(b.glass_reflectance), luminance(passing) * sqrt(b.through_scale)) *
         b.glass;
}

/// Compensation for multiple scattering at an interface whose microfacets reflect or refract.
template <class F, Features S>
KERNEL Vec3<F> joint_scale(const BaseOf<F, S>& b, F roughness) {
  const GlassAlbedoOf<F> share = glass_albedo(b.wo.z, roughness, b.eta);
  // The part that a low `specular` takes from the reflection refracts; the film's share reflects.
  Vec3<F> reflected = b.glass_specular * share.reflected;
  Vec3<F> kept = (Vec3<F>(1) - b.glass_specular) * share.kept;
  if (const auto covered = has_film<S>(b.glass_film); any(covered)) {
    const FilmOnFaceOf<F> film = film_on_face(b);
    reflected += select(covered, b.glass_specular * film.reflected, Vec3<F>(0));
    kept -= select(covered, b.glass_specular * film.refracted, Vec3<F>(0));
  }
  return F(1) / (Vec3<F>(share.totally + share.refracted) + reflected + kept);
}

/// The interface of glass. Returns shares of sampling for its microfacets and for what passes
/// apart.
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL Vec2<F> set_interface(BaseOf<F, S>& b,
                                                             const MaterialValuesOf<F>& m,
                                                             const ShadingPointOf<F>& at) {
  using InterfaceOf = EnumOf<F, Interface>;
  const BoolOf<F> glass = is_glass(b);
  const BoolOf<F> enters = at.thin_walled | (dot(at.wo, at.ng) >= 0);
  const F through = 1 - (1 - m.roughness) * (1 - m.transmission_roughness);
  b.through_delta = sqr(through) < kDeltaAlpha;
  const BoolOf<F> sheet = rich<S>(at.thin_walled);
  const BoolOf<F> split =
      rich<S>((m.transmission_roughness > 0) | is_stretched(b)) & !b.through_delta;
  const InterfaceOf faces =
      select(split, InterfaceOf(Interface::kSplit), InterfaceOf(Interface::kJoint));
  b.interface = select(glass, select(sheet, InterfaceOf(Interface::kSheet), faces), b.interface);
  const BoolOf<F> wide = sheet | split | has_film<S>(b.film);
  const F margin = select(wide, F(kWideTableMargin), F(kTableMargin));
  b.glass *= select(b.through_delta, F(1), 1 - margin);
  F ior = m.ior / at.outside;
  // A rough interface of index 1 has no half vector: the smallest step that still has one.
  const F stepped = select(ior < 1, min2(ior, F(1 / 1.01f)), max2(ior, F(1.01f)));
  ior = select(b.through_delta, ior, stepped);
  b.eta = select(enters, ior, 1 / ior);
  if constexpr (S == Features::kAll)
    b.glass_film = {b.film.weight, b.film.ior / select(enters, F(1), ior), b.film.way};
  const Vec3<F> color = m.base_color;
  b.glass_tint = select(at.thin_walled, color, sqrt3(color));
  b.glass_specular = min3(m.specular_color * m.specular, Vec3<F>(1));
  b.through = b.facets;
  b.glass_scale = Vec3<F>(1);
  Vec2<F> shares(b.glass, F(0));
  const BoolOf<F> apart = glass & (sheet | split);
  if (any(apart)) {
    const Vec2<F> both = set_apart(b, m, through);
    shares = select(apart, both, shares);
  }
  const BoolOf<F> joint = glass & !apart & !is_mirror(b);
  if (any(joint)) {
    b.glass_scale = select(joint, joint_scale(b, m.roughness), b.glass_scale);
  }
  return shares;
}

/// Lambert's lobe and the body below it, alone.
template <class F, Features S>
KERNEL void set_lambert(BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                        const ShadingPointOf<F>& at) {
  const BodyOf<F> body = body_of<S>(m, at);
  b.diffuse = body.color * F(kInvPi);
  b.multiple = b.f0 = Vec3<F>(0);
  b.f90 = F(0);
  b.coated = false;
  b.average_entering = F(1);
  b.subsurface = body.inside;
  const F inside = body.inside * luminance(m.subsurface_color);
  const F above = luminance(body.color);
  b.reflectance = above + set_diffuse_through(b, body.through, F(kInvPi), above) + inside;
  b.subsurface_probability = select(inside > 0, inside / b.reflectance, F(0));
  b.diffuse_probability = 1 - b.subsurface_probability;
  b.facet_probability = F(0);
}

/// All lobes. facets: where there are others than Lambert's
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL void set_lobes(BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                                          const ShadingPointOf<F>& at, BoolOf<F> facets) {
  b.coated = true;
  Vec2<F> share = set_reflection(b, m, at);
  F through(0);
  if (const auto glass = is_glass(b); any(glass)) {
    const Vec2<F> passing = set_interface(b, m, at);
    share.y += select(glass, passing.x, F(0));
    through = select(glass, passing.y, F(0));
    if constexpr (S == Features::kAll) b.diffuse_through *= 1 / sqr(index_below(b));
  }
  const F inside = b.subsurface * luminance(m.subsurface_color);
  b.reflectance = share.x + share.y + through + inside;
  b.subsurface_probability = select(inside > 0, inside / b.reflectance, F(0));
  b.diffuse_probability = select(share.x > 0, share.x / b.reflectance, F(0));
  b.diffuse_probability = select(facets, b.diffuse_probability, 1 - b.subsurface_probability);
  b.facet_probability = 1 - b.diffuse_probability - b.subsurface_probability;
  b.facet_probability = select(facets, b.facet_probability, F(0));
  if (const auto apart = through > 0; any(apart)) {
    b.facet_probability *= select(apart, share.y / (share.y + through), F(1));
  }
}

/// A material at a point, seen from wo (world). n, ng: on wo's side.
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL void set_base(BaseOf<F, S>& b, const MaterialValuesOf<F>& m,
                                         const ShadingPointOf<F>& at, Vec3<F> n) {
  const BoolOf<F> facets = (m.specular > 0) | (m.metallic > 0) | (m.transmission > 0);
  if (any(facets)) n = select(facets, bend_normal(b.ng, at.wo, n), n);
  const BoolOf<F> stretched = rich<S>(m.anisotropic > 0);
  b.frame =
      either(stretched, [&] { return make_frame(n, at.tangent); }, [&] { return make_frame(n); });
  b.wo = to_local(b.frame, at.wo);
  b.wo.z = max2(b.wo.z, F(1e-4f));
  const F alpha = sqr(m.roughness);
  const F aspect =
      either(stretched, [&] { return F(sqrt(1 - 0.9f * m.anisotropic)); }, [] { return F(1); });
  b.facets = {alpha / aspect, alpha * aspect};
  if constexpr (S == Features::kAll) {
    b.anisotropic = {m.roughness, aspect};
    b.film = film_of(m, at.outside);
  }
  if constexpr (S != Features::kOpaque) {
    b.delta = alpha < kDeltaAlpha;
    b.glass = (1 - m.metallic) * m.transmission;
    b.interface = Interface::kNone;
  }
  b.albedo = albedo_row(m.roughness);
  if (any(facets))
    set_lobes(b, m, at, facets);
  else
    set_lambert(b, m, at);
}

}  // namespace heliograph::kernels::inline HELIO_ISA
