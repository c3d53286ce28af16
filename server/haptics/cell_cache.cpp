#include "server/haptics/cell_cache.h"

#include <algorithm>

namespace palpate {
namespace {

// Neighbouring cells get different slots: 8 × 4 × 4 cells fill the cache.
std::size_t SlotOf(const Vec3i& cell) {
  return static_cast<std::size_t>((cell.x() & 7) << 4 | (cell.y() & 3) << 2 | (cell.z() & 3));
}

// From the densities as they are on both sides, so that H is the same to the bit.
Decomposition DecomposeFelt(const HapticSurface& surface, const CellDensities& felt) {
  Decomposition parts = Decompose(surface.Felt(felt), surface.method);
  if (surface.free_side == FreeSide::kAbove) {
    for (double& density : parts.density) density = -density;
  }
  return parts;
}

}  // namespace

HapticCell& CellCache::Densities(const HapticSurface& surface, const Vec3i& cell) noexcept {
  if (surface.geometry_revision != geometry_revision_ || surface.free_side != free_side_) {
    geometry_revision_ = surface.geometry_revision;
    free_side_ = surface.free_side;
    ++generation_;
  }
  const std::size_t slot = SlotOf(cell);
  HapticCell& entry = cells_[slot];
  if (filled_[slot] == generation_ && entry.cell == cell) return entry;
  filled_[slot] = generation_;
  entry.cell = cell;
  entry.densities = surface.ResolvedCell(cell);
  const auto [lo, hi] = std::minmax_element(entry.densities.begin(), entry.densities.end());
  entry.min_density = *lo;
  entry.max_density = *hi;
  entry.decomposed = false;
  return entry;
}

const HapticCell& CellCache::Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept {
  HapticCell& entry = Densities(surface, cell);
  if (entry.decomposed) return entry;
  entry.parts = DecomposeFelt(surface, entry.densities);
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(entry.parts.complex.used_vertices >> v & 1)) continue;
    entry.vertex_mm[v] = surface.X_DI.linear * entry.parts.position[v];
  }
  entry.decomposed = true;
  return entry;
}

}  // namespace palpate
