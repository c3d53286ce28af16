#include "server/samples/scp_v.h"

#include "server/haptics/visual_proxy.h"

namespace palpate {

void AddScpV(const Scene& scene, CellCache& cache, TickSample& sample) noexcept {
  const SurfacePlace& at = sample.surface_place;
  if (at.vertex_count == 0) return;
  const bool is_flipped = sample.free_side != scene.surface.free_side;
  HapticSurface surface = is_flipped ? scene.surface.Flipped() : scene.surface;
  surface.isovalue = at.isovalue;
  surface.Refine(static_cast<int>(sample.refinement));
  Place place;
  place.kind = Place::Kind::kSimplex;
  place.cell = Vec3i(at.cell.data());
  place.carrier = {at.vertex_count, at.vertex, at.weight};
  place.faces = FacesOf(place.carrier);
  const VisualProxy visual =
      FindVisualProxy(surface, place, Vec3(sample.scp_h_normal.data()), cache);
  sample.has_scp_v = visual.found;
  for (int axis = 0; axis < 3; ++axis) {
    sample.scp_v_mm[axis] = visual.p_DV_mm[axis];
    sample.scp_v_normal[axis] = visual.normal_D[axis];
  }
}

}  // namespace palpate
