#include "server/haptics/eject.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

namespace palpate {
namespace {

// Finds the nearest free vertex on the shell of a Chebyshev radius. Returns its distance, or
// infinity if there is none.
double NearestOnShell(const HapticSurface& surface, const Vec3i& cell, const Vec3& from_I,
                      int radius, Vec3i& nearest) noexcept {
  double best = std::numeric_limits<double>::infinity();
  for (int x = -radius; x <= radius; ++x) {
    for (int y = -radius; y <= radius; ++y) {
      const bool side = std::abs(x) == radius || std::abs(y) == radius;
      for (int z = -radius; z <= radius; z += side || radius == 0 ? 1 : 2 * radius) {
        const Vec3i vertex = cell + Vec3i(x, y, z);
        if (surface.ResolvedVertex(vertex) > surface.isovalue) continue;
        const Vec3 away = surface.X_DI.linear * (vertex.cast<double>() - from_I);
        if (away.norm() < best) best = away.norm(), nearest = vertex;
      }
    }
  }
  return best;
}

// With uneven voxels, a vertex of a farther shell can be nearer. The search ends when a whole shell
// is farther away than the best vertex.
bool JumpToNearestVertex(const HapticSurface& surface, double limit_mm, Place& place,
                         CellCache& cache) noexcept {
  double best_mm = std::numeric_limits<double>::infinity();
  Vec3i best = Vec3i::Zero();
  // The least distance between neighbouring lattice planes. The place is up to a cell away from the
  // middle of the shells.
  const double plane_mm = 1.0 / surface.X_ID.linear.rowwise().norm().maxCoeff();
  const Vec3 from_I = PlaceIndexPosition(surface, place, cache);
  for (int radius = 0; radius <= kMaxSearchRadius; ++radius) {
    if ((radius - 1) * plane_mm > std::min(best_mm, limit_mm)) break;
    Vec3i vertex = Vec3i::Zero();
    const double distance_mm = NearestOnShell(surface, place.cell, from_I, radius, vertex);
    if (distance_mm < best_mm) best_mm = distance_mm, best = vertex;
  }
  if (!std::isfinite(best_mm)) return false;
  double density = 0.0;
  place = PlaceAt(surface, best.cast<double>(), cache, density);
  return true;
}

}  // namespace

bool Eject(const HapticSurface& surface, double limit_mm, Place& place, bool& on_surface,
           CellCache& cache, int& moves) noexcept {
  on_surface = false;
  // A place outside of the lattice has no density to descend.
  if (place.kind == Place::Kind::kOutside) return surface.IsFreeOutside();
  for (int n = 0; n < kMaxEjectMoves; ++n) {
    const Candidate down = SteepestDescent(surface, place, cache);
    if (down.kind == Candidate::Kind::kNone) break;
    MoveInTetrahedron(surface, down, true, place, on_surface, cache);
    ++moves;
    // Also set if rounding stopped the move above the surface; the density tells.
    if (on_surface) break;
  }
  if (PlaceDensity(surface, place, cache) <= surface.isovalue) return true;
  on_surface = false;
  return JumpToNearestVertex(surface, limit_mm, place, cache);
}

}  // namespace palpate
