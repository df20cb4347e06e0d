// The material in lanes against itself, one surface after the other: the same bits.
#include <bit>

#include "kernels/bsdf/bsdf.h"
#include "kernels/core/lanes.h"
#include "tests/unit/any_material.h"
#include "tests/unit/catch.h"

using namespace heliograph::kernels;
using namespace heliograph::test;

namespace {

/// Materials seen from directions, one in each lane.
struct Batch {
  MaterialValues m[kLanes];
  ShadingPoint at[kLanes];
  MaterialValuesOf<Floats> m_lanes{};
  ShadingPointOf<Floats> at_lanes{};
};

vec3 any_direction(Random& random) {
  const float z = 2 * random.next() - 1, r = std::sqrt(1 - z * z), a = 6.283f * random.next();
  return {r * std::cos(a), r * std::sin(a), z};
}

Batch any_batch(Random& random) {
  Batch batch;
  for (u32 i = 0; i < kLanes; ++i) {
    const MaterialView material = any_material(random);
    const vec3 ng = any_direction(random);
    ShadingPoint& at = batch.at[i];
    at = {
        .wo = any_direction(random), .ng = ng, .ns = normalize(ng + 0.3f * any_direction(random))};
    at.tangent = random.next() < 0.8f ? any_direction(random) : vec3(0);
    at.clearcoat_normal = normalize(ng + 0.2f * any_direction(random));
    at.thin_walled = material.thin_walled;
    at.outside = random.next() < 0.2f ? 1.3f : 1.0f;
    batch.m[i] = material.constant;
#define HELIO_PARAMETER(name, ...) put(batch.m_lanes.name, i, material.constant.name);
    HELIO_MATERIAL_PARAMETERS(HELIO_PARAMETER)
#undef HELIO_PARAMETER
    put(batch.at_lanes.wo, i, at.wo);
    put(batch.at_lanes.ng, i, at.ng);
    put(batch.at_lanes.ns, i, at.ns);
    put(batch.at_lanes.tangent, i, at.tangent);
    put(batch.at_lanes.clearcoat_normal, i, at.clearcoat_normal);
    put(batch.at_lanes.thin_walled, i, at.thin_walled);
    put(batch.at_lanes.outside, i, at.outside);
  }
  return batch;
}

bool same(float a, float b) { return a == b || (a != a && b != b); }
bool same(vec3 a, vec3 b) { return same(a.x, b.x) && same(a.y, b.y) && same(a.z, b.z); }

}  // namespace

TEST_CASE("bsdf: in lanes it has the bits of one surface after the other") {
  Random random(7);
  for (u32 n = 0; n < 4000; ++n) {
    const Batch batch = any_batch(random);
    BsdfOf<Floats> lanes;
    set_bsdf(lanes, batch.m_lanes, batch.at_lanes);
    Bsdf one[kLanes];
    Vec3<Floats> wi_lanes(0);
    vec3 wi[kLanes];
    Floats choice_lanes(0);
    Vec2<Floats> u_lanes(0);
    for (u32 i = 0; i < kLanes; ++i) {
      set_bsdf(one[i], batch.m[i], batch.at[i]);
      wi[i] = any_direction(random);
      put(wi_lanes, i, wi[i]);
      put(choice_lanes, i, random.next());
      put(u_lanes, i, random.next2());
    }
    const BsdfValueOf<Floats> values = evaluate_bsdf(lanes, wi_lanes);
    BsdfSampleOf<Floats> samples;
    const Mask valid = sample_bsdf(lanes, choice_lanes, u_lanes, samples);
    const Mask scattering = scatters(lanes), smooth = has_smooth_lobe(lanes);
    for (u32 i = 0; i < kLanes; ++i) {
      CAPTURE(n, i);
      REQUIRE(get(scattering, i) == scatters(one[i]));
      if (!scatters(one[i])) continue;
      CHECK(get(smooth, i) == has_smooth_lobe(one[i]));
      CHECK(same(get(lanes.diffuse_probability, i), one[i].diffuse_probability));
      CHECK(same(get(lanes.facet_probability, i), one[i].facet_probability));
      const BsdfValue value = evaluate_bsdf(one[i], wi[i]);
      CHECK(same(get(values.diffuse, i), value.diffuse));
      CHECK(same(get(values.glossy, i), value.glossy));
      CHECK(same(get(values.pdf, i), value.pdf));
      BsdfSample sample;
      const bool counts = sample_bsdf(one[i], get(choice_lanes, i), get(u_lanes, i), sample);
      REQUIRE(get(valid, i) == counts);
      if (!counts) continue;
      REQUIRE(Lobe(get(samples.lobe.v, i)) == sample.lobe);
      CHECK(same(get(samples.weight, i), sample.weight));
      CHECK(same(get(samples.eta, i), sample.eta));
      CHECK(same(get(samples.pdf, i), sample.pdf));
      if (sample.lobe != Lobe::kSubsurface) CHECK(same(get(samples.wi, i), sample.wi));
    }
  }
}
