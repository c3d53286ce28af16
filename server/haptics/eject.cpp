#include "server/haptics/eject.h"

#include <cmath>
#include <cstdlib>
#include <limits>

namespace palpate {
namespace {

// Nearest free vertex on the shell of a given Chebyshev radius; its distance is
// infinite where there is none.
double NearestOnShell(const HapticSurface& surface, const Place& from, int radius,
                      Vec3i& nearest) noexcept {
  double best = std::numeric_limits<double>::infinity();
  for (int x = -radius; x <= radius; ++x) {
    for (int y = -radius; y <= radius; ++y) {
      const bool side = std::abs(x) == radius || std::abs(y) == radius;
      for (int z = -radius; z <= radius; z += side || radius == 0 ? 1 : 2 * radius) {
        const Vec3i vertex = from.cell + Vec3i(x, y, z);
        if (surface.volume->ResolvedVertex(vertex) > surface.isovalue) continue;
        const Vec3 away = surface.X_DI.linear * (vertex.cast<double>() - from.p_I);
        if (away.norm() < best) best = away.norm(), nearest = vertex;
      }
    }
  }
  return best;
}

bool JumpToNearestVertex(const HapticSurface& surface, Place& place, CellCache& cache) noexcept {
  for (int radius = 0; radius <= kMaxSearchRadius; ++radius) {
    Vec3i vertex = Vec3i::Zero();
    if (!std::isfinite(NearestOnShell(surface, place, radius, vertex))) continue;
    double density = 0.0;
    place = PlaceAt(surface, vertex.cast<double>(), cache, density);
    return true;
  }
  return false;
}

}  // namespace

bool Eject(const HapticSurface& surface, Place& place, bool& on_surface, CellCache& cache,
           int& moves) noexcept {
  on_surface = false;
  for (int n = 0; n < kMaxEjectMoves; ++n) {
    if (PlaceDensity(surface, place, cache) <= surface.isovalue) return true;
    const Candidate down = SteepestDescent(surface, place, cache);
    if (down.kind == Candidate::Kind::kNone) break;
    MoveInTetrahedron(surface, down, true, place, on_surface, cache);
    ++moves;
    if (on_surface) return true;
  }
  return JumpToNearestVertex(surface, place, cache);
}

}  // namespace palpate
