// The lobes of the base: values, densities and sampling. Called by bsdf.h.
#pragma once

#include "kernels/bsdf/base_weights.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// f(wo, wi) |cos|, split by lobe, and the density [1/sr] with which sampling takes wi. Delta lobes
/// are left out.
template <class F>
struct BsdfValueOf {
  Vec3<F> diffuse{0};
  Vec3<F> glossy{0};  // or refracted, for wi below the surface
  F pdf = 0;
};
using BsdfValue = BsdfValueOf<float>;
template <LaneMask M, class F>
KERNEL BsdfValueOf<F> select(M m, const BsdfValueOf<F>& a, const BsdfValueOf<F>& b) {
  return {select(m, a.diffuse, b.diffuse), select(m, a.glossy, b.glossy), select(m, a.pdf, b.pdf)};
}

enum class Lobe : u8 { kDiffuse, kGlossy, kTransmission, kDiffuseTransmission, kSubsurface };

template <class F>
struct BsdfSampleOf {
  Vec3<F> wi{0};       // unit, world; means nothing for kSubsurface
  Vec3<F> weight{0};   // f |cos| / pdf; for kSubsurface that of light that enters
  Vec3<F> diffuse{0};  // what of the weight is diffuse
  F pdf = 0;           // 1/sr; 0: a delta lobe, or light that travels inside
  F eta = 1;           // index of the far side over the near side when refracted, else 1
  EnumOf<F, Lobe> lobe = Lobe::kDiffuse;
};
using BsdfSample = BsdfSampleOf<float>;
template <LaneMask M, class F>
KERNEL BsdfSampleOf<F> select(M m, const BsdfSampleOf<F>& a, const BsdfSampleOf<F>& b) {
  return {select(m, a.wi, b.wi),   select(m, a.weight, b.weight), select(m, a.diffuse, b.diffuse),
          select(m, a.pdf, b.pdf), select(m, a.eta, b.eta),       select(m, a.lobe, b.lobe)};
}

/// True if what passes is a lobe of its own. through_probability: that of choosing it.
template <class F, Features S>
KERNEL BoolOf<F> passes_apart(const BaseOf<F, S>& b) {
  return rich<S>((b.interface == Interface::kSplit) | (b.interface == Interface::kSheet));
}
template <class F, Features S>
KERNEL F through_probability(const BaseOf<F, S>& b) {
  return max2(1 - b.diffuse_probability - b.facet_probability - b.subsurface_probability, F(0));
}

/// Its colour.
template <class F, Features S>
KERNEL Vec3<F> through_color(const BaseOf<F, S>& b) {
  return b.glass_tint * (Vec3<F>(1) - b.glass_reflectance) * (b.glass * b.through_scale);
}

/// Share of light that a microfacet of coat and metal reflects at cosine c = wo.h.
template <class F, Features S>
KERNEL Vec3<F> opaque_facet(const BaseOf<F, S>& b, F c) {
  return b.f0 + (Vec3<F>(b.f90) - b.f0) * schlick_weight(c);
}

/// Shares of light that a microfacet reflects and transmits at cosine c = wo.h.
template <class F>
struct FacetOf {
  Vec3<F> reflected;
  Vec3<F> transmitted;
  F cos_t;  // of the refracted direction
  F reflect_probability;
};
template <class F, Features S>
KERNEL FacetOf<F> facet_of(const BaseOf<F, S>& b, F c) {
  const Vec3<F> none(0);
  FacetOf<F> f{opaque_facet(b, c), none, F(0), F(1)};
  if (const auto covered = has_film<S>(b.film) & (b.f90 > 0); any(covered)) {
    const ReflectancesOf<F> film = film_at(b, c);
    const Vec3<F> both = film.coat * b.plastic + film.metal * b.metallic;
    f.reflected += select(covered, (both - f.reflected) * b.film.weight, none);
  }
  const BoolOf<F> glass = is_glass(b);
  if (!any(glass)) return f;
  const Vec3<F> scale = b.glass_scale * b.glass;
  const BoolOf<F> apart = glass & passes_apart(b), joint = glass & !apart;
  if (any(apart)) f.reflected += select(apart, b.glass_reflectance * scale, none);
  if (!any(joint)) return f;
  const FresnelOf<F> exact = fresnel_dielectric(c, b.eta);
  const BoolOf<F> refracts = joint & (exact.cos_t > 0);
  const Vec3<F> r = b.glass_specular * glass_at(b, c, exact.reflectance);
  f.cos_t = select(joint, exact.cos_t, F(0));
  f.reflected += select(joint, select(refracts, r * scale, scale), none);
  f.transmitted = select(refracts, b.glass_tint * (Vec3<F>(1) - r) * scale, none);
  const F up = luminance(f.reflected);
  const F down = luminance(f.transmitted);
  f.reflect_probability = select(joint & (up + down > 0), up / (up + down), F(1));
  return f;
}

/// Light that passes both faces of a sheet.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL BsdfValueOf<F> sheet_value(const BaseOf<F, S>& b, Vec3<F> wi) {
  BsdfValueOf<F> out;
  const Vec3<F> mirrored(wi.x, wi.y, -wi.z);
  const F density = ggx_density(Vec3<F>(normalize(b.wo + mirrored)), b.through);
  out.glossy = through_color(b) * (ggx_reflection(b.wo, mirrored, density, b.through) * mirrored.z);
  out.pdf = through_probability(b) * 0.25f * ggx_visible_density(b.wo, density, b.through);
  return out;
}

/// Light that refracts through one face.
template <class F, Features S>
HELIO_GPU_NOINLINE_UNLESS_PLAIN KERNEL BsdfValueOf<F> refraction_value(const BaseOf<F, S>& b,
                                                                       Vec3<F> wi) {
  BsdfValueOf<F> out;
  Vec3<F> h = b.wo + wi * b.eta;
  h = normalize(select(h.z < 0, -h, h));
  const F wo_h = dot(b.wo, h);
  const F wi_h = dot(wi, h);
  const BoolOf<F> passes = (wo_h > 0) & (wi_h < 0);
  if (!any(passes)) return out;
  Vec3<F> color(0);
  F probability(0);
  const BoolOf<F> apart = passes_apart(b);
  if (any(apart)) {
    color = through_color(b);
    probability = through_probability(b);
  }
  if (!all(apart)) {
    const FacetOf<F> f = facet_of(b, wo_h);
    color = select(apart, color, f.transmitted);
    probability = select(apart, probability, b.facet_probability * (1 - f.reflect_probability));
  }
  const F density = ggx_density(h, b.through);
  const F jacobian = -wi_h / sqr(wi_h + wo_h / b.eta);
  const F lambdas = ggx_lambda(b.wo, b.through) + ggx_lambda(wi, b.through);
  // Walter et al. 2007, equation 21, over eta^2: radiance spreads or gathers as it refracts.
  const Vec3<F> glossy =
      color * (density * wo_h * jacobian / (b.wo.z * (1 + lambdas) * sqr(b.eta)));
  const F pdf = probability * jacobian * wo_h * ggx_visible_density(b.wo, density, b.through);
  out.glossy = select(passes, glossy, Vec3<F>(0));
  out.pdf = select(passes, pdf, F(0));
  return out;
}

/// Light that passes the surface to wi, below it (local).
template <class F, Features S>
KERNEL BsdfValueOf<F> through_value(const BaseOf<F, S>& b, Vec3<F> wi) {
  const BsdfValueOf<F> none;
  const BoolOf<F> apart = passes_apart(b);
  const BoolOf<F> mirrors = select(apart, b.through_delta, is_mirror(b));
  const BoolOf<F> passes = is_glass(b) & !mirrors;
  if (!any(passes)) return none;
  const BoolOf<F> sheet = apart & (b.interface == Interface::kSheet);
  const BsdfValueOf<F> value =
      either(sheet, [&] { return sheet_value(b, wi); }, [&] { return refraction_value(b, wi); });
  return select(passes, value, none);
}

/// Diffuse light to wi, below the surface (local). The coat of the far face is the same.
template <class F, Features S>
KERNEL void add_diffuse_through(const BaseOf<F, S>& b, Vec3<F> wi, BsdfValueOf<F>& out) {
  const Vec3<F> mirrored(wi.x, wi.y, -wi.z);
  F leaves = mirrored.z;
  if (any(b.coated)) {
    const F coat = coat_albedo(b, base_albedo(b, mirrored));
    leaves *= select(b.coated, 1 - coat, F(1));
  }
  out.diffuse += b.diffuse_through * leaves;
  out.pdf += b.diffuse_probability * b.diffuse_through_share * mirrored.z * kInvPi;
}

/// All that goes to wi, below the surface (local).
template <class F, Features S>
KERNEL BsdfValueOf<F> below_value(const BaseOf<F, S>& b, Vec3<F> wi) {
  BsdfValueOf<F> out = through_value(b, wi);
  if (const auto translucent = is_translucent(b); any(translucent)) {
    BsdfValueOf<F> both = out;
    add_diffuse_through(b, wi, both);
    out = select(translucent, both, out);
  }
  return out;
}

/// Adds what microfacets reflect.
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL void add_reflection(const BaseOf<F, S>& b, Vec3<F> wi,
                                               BsdfValueOf<F>& out) {
  const Vec3<F> h = normalize(b.wo + wi);
  const FacetOf<F> f = facet_of(b, F(dot(b.wo, h)));
  const F density = ggx_density(h, b.facets);
  out.glossy += f.reflected * (ggx_reflection(b.wo, wi, density, b.facets) * wi.z);
  out.pdf += b.facet_probability * f.reflect_probability * 0.25f *
             ggx_visible_density(b.wo, density, b.facets);
}

/// The lobes sampled by cosine, to wi above the surface.
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL BsdfValueOf<F> cosine_value(const BaseOf<F, S>& b, Vec3<F> wi) {
  BsdfValueOf<F> out;
  out.pdf = above_probability(b) * wi.z * kInvPi;
  out.diffuse = b.diffuse * wi.z;
  if (!any(b.coated)) return out;
  const AlbedoOf<F> in = base_albedo(b, wi);
  out.diffuse *= 1 - coat_albedo(b, in);
  out.glossy = b.multiple * (wi.z * max2(1 - in.total, F(0)));
  return out;
}

/// wi     local
/// side   cosine of wi to the geometric normal
template <class F, Features S>
HELIO_ALWAYS_INLINE KERNEL BsdfValueOf<F> evaluate_base(const BaseOf<F, S>& b, Vec3<F> wi, F side) {
  BsdfValueOf<F> out;
  if (const auto below = (wi.z < 0) & (side < 0); any(below))
    out = select(below, below_value(b, wi), out);
  const BoolOf<F> above = (wi.z > 0) & (side > 0);
  if (const auto cosine = above & (b.diffuse_probability > 0); any(cosine))
    out = select(cosine, cosine_value(b, wi), out);
  if (const auto facets = above & (b.facet_probability > 0) & !is_mirror(b); any(facets)) {
    BsdfValueOf<F> both = out;
    add_reflection(b, wi, both);
    out = select(facets, both, out);
  }
  return out;
}

/// Which directions have been chosen, before their weights are known unless they are those of a
/// mirror or of light that travels inside.
template <class F>
struct ChosenOf {
  BoolOf<F> valid;
  BoolOf<F> delta;
};

template <LaneMask M, class F>
KERNEL ChosenOf<F> select(M m, const ChosenOf<F>& a, const ChosenOf<F>& b) {
  return {select(m, a.valid, b.valid), select(m, a.delta, b.delta)};
}

/// A direction by a microfacet. Local.
template <class F>
struct FacetChoice {
  Vec3<F> wi;
  BoolOf<F> valid;
};

/// Passes on light to the other side by a lobe of its own.
template <class F, Features S>
HELIO_GPU_NOINLINE KERNEL FacetChoice<F> choose_through(const BaseOf<F, S>& b, Vec2<F> u,
                                                        BsdfSampleOf<F>& s) {
  const Vec3<F> h = either(
      b.through_delta, [] { return Vec3<F>(0, 0, 1); },
      [&] { return sample_ggx(b.wo, b.through, u); });
  const F wo_h = dot(b.wo, h);
  s.lobe = Lobe::kTransmission;
  const BoolOf<F> sheet = b.interface == Interface::kSheet;
  const Vec3<F> mirrored = h * (2 * wo_h) - b.wo;
  Vec3<F> wi(mirrored.x, mirrored.y, -mirrored.z);
  if (any(sheet)) s.weight = through_color(b) / through_probability(b);
  BoolOf<F> passes = true;
  if (!all(sheet)) {
    const FresnelOf<F> exact = fresnel_dielectric(wo_h, b.eta);
    passes = sheet | (exact.cos_t > 0);
    wi = select(sheet, wi, h * (wo_h / b.eta - exact.cos_t) - b.wo * (1 / b.eta));
    s.eta = select(sheet, F(1), b.eta);
  }
  passes = passes & (wo_h > 0) & (wi.z < 0);
  return {wi, passes};
}

/// Reflects from or refracts through a microfacet. u: for the choice between the two.
template <class F, Features S>
KERNEL FacetChoice<F> choose_facet(const BaseOf<F, S>& b, F u, Vec3<F> h, BsdfSampleOf<F>& s) {
  const F wo_h = dot(b.wo, h);
  const FacetOf<F> f = facet_of(b, wo_h);
  const BoolOf<F> reflect = u < f.reflect_probability;
  const Vec3<F> wi = either(
      reflect, [&] { return Vec3<F>(h * (2 * wo_h) - b.wo); },
      [&] { return Vec3<F>(h * (wo_h / b.eta - f.cos_t) - b.wo * (1 / b.eta)); });
  s.lobe = select(reflect, EnumOf<F, Lobe>(Lobe::kGlossy), EnumOf<F, Lobe>(Lobe::kTransmission));
  s.eta = either(reflect, [] { return F(1); }, [&] { return b.eta; });
  if (any(is_mirror(b))) {
    s.weight = either(
        reflect,
        [&] { return Vec3<F>(f.reflected / (f.reflect_probability * b.facet_probability)); },
        [&] {
          const F probability = (1 - f.reflect_probability) * b.facet_probability;
          return Vec3<F>(f.transmitted / (probability * sqr(b.eta)));
        });
  }
  const BoolOf<F> valid = (wo_h > 0) & select(reflect, wi.z > 0, wi.z <= 0);
  return {wi, valid};
}

/// u_lobe, u   uniform in [0, 1)
template <class F, Features S>
KERNEL ChosenOf<F> choose_base(const BaseOf<F, S>& b, F u_lobe, Vec2<F> u, BsdfSampleOf<F>& s) {
  using LobeOf = EnumOf<F, Lobe>;
  const BoolOf<F> cosine = u_lobe < b.diffuse_probability;
  ChosenOf<F> chosen{true, false};
  s.lobe = Lobe::kDiffuse;
  s.eta = F(1);
  Vec3<F> wi(0, 0, 1);
  if (any(cosine)) wi = sample_cosine(u);
  const BoolOf<F> translucent = is_translucent(b);
  const BoolOf<F> leaves_below = cosine & translucent & (u_lobe >= above_probability(b));
  if (any(leaves_below)) {
    wi.z = select(leaves_below, -wi.z, wi.z);
    s.lobe = select(leaves_below, LobeOf(Lobe::kDiffuseTransmission), s.lobe);
    s.eta = select(leaves_below, index_below(b), s.eta);
  }
  if (!all(cosine)) {
    F rest = u_lobe - b.diffuse_probability;
    const BoolOf<F> apart = passes_apart(b);
    // Where there are no facets, rounding must not choose them.
    const BoolOf<F> last = (b.facet_probability <= 0) & !apart;
    const BoolOf<F> inside = (!cosine) & has_body(b) & ((rest < b.subsurface_probability) | last);
    rest -= b.subsurface_probability;
    const BoolOf<F> through = (!cosine) & (!inside) & apart & (rest >= b.facet_probability);
    const BoolOf<F> facets = (!cosine) & (!inside) & !through;
    if (any(facets)) {
      BsdfSampleOf<F> of;
      const Vec3<F> h = either(
          is_mirror(b), [] { return Vec3<F>(0, 0, 1); },
          [&] { return sample_ggx(b.wo, b.facets, u); });
      const FacetChoice<F> choice = choose_facet(b, F(rest / b.facet_probability), h, of);
      s = select(facets, of, s);
      wi = select(facets, choice.wi, wi);
      chosen.valid = select(facets, choice.valid, chosen.valid);
      chosen.delta = facets & is_mirror(b);
    }
    if (any(through)) {
      BsdfSampleOf<F> of;
      const FacetChoice<F> choice = choose_through(b, u, of);
      s = select(through, of, s);
      wi = select(through, choice.wi, wi);
      chosen.valid = select(through, choice.valid, chosen.valid);
      chosen.delta = select(through, b.through_delta, chosen.delta);
    }
    if (any(inside)) {
      s.weight = select(inside, Vec3<F>(b.subsurface / b.subsurface_probability), s.weight);
      s.lobe = select(inside, LobeOf(Lobe::kSubsurface), s.lobe);
      chosen.delta = chosen.delta | inside;
    }
  }
  s.wi = to_world(b.frame, wi);
  const BoolOf<F> reflected = !(s.lobe == LobeOf(Lobe::kTransmission));
  const F side = dot(s.wi, b.ng);
  const BoolOf<F> leaves = select(reflected, side > 0, side < 0);
  chosen.valid = chosen.valid & (leaves | !chosen.delta | (s.lobe == LobeOf(Lobe::kSubsurface)));
  return chosen;
}

}  // namespace heliograph::kernels::inline HELIO_ISA
