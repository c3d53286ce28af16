#include "server/haptics/eject.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace palpate {
namespace {

// With uneven voxels, a vertex of a farther shell can be nearer. The search ends when a whole shell
// is farther away than the best vertex.
bool JumpToNearestVertex(const HapticSurface& surface, double limit_mm, Place& place,
                         CellCache& cache) noexcept {
  double best_mm = std::numeric_limits<double>::infinity();
  Vec3i best = Vec3i::Zero();
  // The least distance between neighbouring planes of voxels. The place is up to a cell away from
  // the middle of the shells.
  const double plane_mm = 1.0 / surface.X_ID.linear.rowwise().norm().maxCoeff();
  const Lattice& lattice = surface.lattice;
  const Vec3 from_I = lattice.ToVoxels(PlaceLatticePosition(surface, place, cache));
  const Vec3i middle = lattice.PartOf(place.cell).voxel_cell;
  for (int radius = 0; radius <= kMaxSearchRadius; ++radius) {
    if ((radius - 1) * plane_mm > std::min(best_mm, limit_mm)) break;
    VisitShell(middle, radius, [&](const Vec3i& voxel) {
      if (!surface.Holds(surface.ResolvedVertex(voxel))) return;
      const Vec3 away = surface.X_DI.linear * (voxel.cast<double>() - from_I);
      if (away.norm() < best_mm) best_mm = away.norm(), best = voxel;
    });
  }
  if (!std::isfinite(best_mm)) return false;
  double density = 0.0;
  place = PlaceAt(surface, lattice.FromVoxels(best.cast<double>()), cache, density);
  return true;
}

}  // namespace

bool Eject(const HapticSurface& surface, double limit_mm, Place& place, Contact& contact,
           CellCache& cache, int& moves) noexcept {
  contact = Contact::kNone;
  // A place outside of the lattice has no density to descend.
  if (place.kind == Place::Kind::kOutside) return surface.IsFreeOutside();
  const bool is_above = PlaceDensity(surface, place, cache) > surface.isovalue;
  const Contact out_to = is_above ? Contact::kUpper : Contact::kLower;
  for (int n = 0; n < kMaxEjectMoves * surface.lattice.refinement(); ++n) {
    const Candidate way = SteepestWay(surface, place, out_to, cache);
    if (way.kind == Candidate::Kind::kNone) break;
    MoveInTetrahedron(surface, way, out_to, place, contact, cache);
    ++moves;
    // Also set if rounding stopped the move before the surface; the density tells.
    if (contact != Contact::kNone) break;
  }
  if (surface.Holds(PlaceDensity(surface, place, cache))) return true;
  contact = Contact::kNone;
  return JumpToNearestVertex(surface, limit_mm, place, cache);
}

}  // namespace palpate
