#include "server/pump/scp_v.h"

#include "server/haptics/visual_proxy.h"
#include "server/pump/touched_point.h"

namespace palpate {

namespace {

VisualProxy OfPoint(const Scene& scene, bool is_flipped, CellCache& cache,
                    const TickSample& sample) noexcept {
  const SurfacePlace& at = sample.surface_place;
  HapticSurface surface = is_flipped ? scene.surface.Flipped() : scene.surface;
  surface.isovalue = at.isovalue;
  surface.Refine(static_cast<int>(sample.refinement));
  Place place;
  place.kind = Place::Kind::kSimplex;
  place.cell = Vec3i(at.cell.data());
  place.carrier = {at.vertex_count, at.vertex, at.weight};
  place.faces = FacesOf(place.carrier);
  return FindVisualProxy(surface, place, Vec3(sample.scp_h_normal.data()), cache);
}

// The ball's centre is on a surface of the field; what it touches is in the volume.
VisualProxy OfBall(const Scene& scene, bool is_flipped, const TickSample& sample) noexcept {
  const double isovalue =
      is_flipped ? -sample.surface_place.isovalue : sample.surface_place.isovalue;
  HapticSurface surface =
      MakeHapticSurface(*scene.volume, scene.X_DI(), 0.0, scene.surface.method,
                        scene.surface.geometry_revision, scene.surface.free_side);
  surface.isovalue = isovalue;
  VisualProxy touched =
      FindTouchedPoint(surface, Vec3(sample.scp_h_mm.data()), scene.ball->radius_mm);
  if (is_flipped) touched.normal_D = -touched.normal_D;
  return touched;
}

}  // namespace

void AddScpV(const Scene& scene, CellCache& cache, TickSample& sample) noexcept {
  if (sample.surface_place.vertex_count == 0) return;
  const bool is_flipped = sample.free_side != scene.surface.free_side;
  const VisualProxy visual =
      scene.ball ? OfBall(scene, is_flipped, sample) : OfPoint(scene, is_flipped, cache, sample);
  sample.has_scp_v = visual.found;
  for (int axis = 0; axis < 3; ++axis) {
    sample.scp_v_mm[axis] = visual.p_DV_mm[axis];
    sample.scp_v_normal[axis] = visual.normal_D[axis];
  }
}

}  // namespace palpate
