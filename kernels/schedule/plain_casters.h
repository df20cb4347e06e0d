// Casters as plain vertices see them, and directions towards them: what path.h and direct_light.h
// do with casters, in lanes. Called by plain_scatter.h.
#pragma once

#include "kernels/schedule/plain_vertices.h"

namespace heliograph::kernels::inline HELIO_ISA {

/// Casters seen by the vertices that look for them and scatter some light evenly.
HELIO_RARE KERNEL void gather_caustic_targets(const SceneView& scene, const OpaqueBase<Floats>& b,
                                              PlainVertices& v) {
  CasterConesOf<Floats>& cones = v.casters;
  cones.count = 0;
  gather_caustic_targets(cones, scene, Vec3<Floats>(v.p), Vec3<Floats>(v.n));
  const Mask wanted = (Floats(v.looks) > 0) & (b.diffuse_probability > 0);
  cones.probability = select(wanted, cones.probability, Floats(0));
}

/// scatter_pdf() of directions whose density among the surface's own is `pdf`.
HELIO_RARE KERNEL Floats scatter_pdf(const PlainVertices& v, Vec3<Floats> wi, Floats pdf) {
  const CasterConesOf<Floats>& cones = v.casters;
  const Mask above = (pdf > 0) & (dot(Vec3<Floats>(v.ng), wi) > 0);
  const Floats own = (1 - cones.probability) * pdf;
  return select(above, own + cones.probability * casters_pdf(cones, wi), own);
}

/// Directions towards casters, of those lanes that go to one; takes from lobe_u what that needs.
struct Aimed {
  Mask lanes;
  CasterDirectionOf<Floats> to;
};
HELIO_RARE KERNEL Aimed aim(PlainVertices& v) {
  const Floats share = v.casters.probability, choice = v.lobe_u;
  const Mask lanes = first_lanes(v.count) & (choice < share);
  v.lobe_u =
      select(lanes, rescale_uniform(choice, share), rescale_uniform(choice - share, 1 - share));
  if (!any(lanes)) return {lanes, {}};
  return {lanes,
          sample_casters(v.casters, Floats(v.lobe_u), Vec2<Floats>(v.scatter_u, v.scatter_v))};
}

}  // namespace heliograph::kernels::inline HELIO_ISA
