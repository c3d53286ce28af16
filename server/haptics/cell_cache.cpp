#include "server/haptics/cell_cache.h"

#include <algorithm>

namespace palpate {
namespace {

// Neighbouring cells get different slots: 8 × 4 × 4 cells fill the cache.
std::size_t SlotOf(const Vec3i& cell) {
  return static_cast<std::size_t>((cell.x() & 7) << 4 | (cell.y() & 3) << 2 | (cell.z() & 3));
}

}  // namespace

HapticCell& CellCache::Densities(const HapticSurface& surface, const Vec3i& cell) noexcept {
  if (surface.geometry_revision != geometry_revision_) {
    geometry_revision_ = surface.geometry_revision;
    ++generation_;
  }
  const std::size_t slot = SlotOf(cell);
  HapticCell& entry = cells_[slot];
  if (filled_[slot] == generation_ && entry.cell == cell) return entry;
  filled_[slot] = generation_;
  entry.cell = cell;
  entry.densities = surface.volume->ResolvedCell(cell);
  const auto [lo, hi] = std::minmax_element(entry.densities.begin(), entry.densities.end());
  entry.min_density = *lo;
  entry.max_density = *hi;
  entry.decomposed = false;
  return entry;
}

const HapticCell& CellCache::Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept {
  HapticCell& entry = Densities(surface, cell);
  if (entry.decomposed) return entry;
  entry.parts = Decompose(entry.densities, surface.method);
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(entry.parts.complex.used_vertices >> v & 1)) continue;
    entry.vertex_mm[v] = surface.X_DI.linear * entry.parts.position[v];
  }
  entry.decomposed = true;
  return entry;
}

}  // namespace palpate
