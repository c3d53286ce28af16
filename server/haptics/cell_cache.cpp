#include "server/haptics/cell_cache.h"

#include <algorithm>

namespace palpate {
namespace {

// Neighbouring cells get different slots: 8 × 4 × 4 cells fill the cache.
std::size_t SlotOf(const Vec3i& cell) {
  return static_cast<std::size_t>((cell.x() & 7) << 4 | (cell.y() & 3) << 2 | (cell.z() & 3));
}

// Decomposes the cell from the densities of side kBelow, so that H is the same to the bit on both
// sides.
Decomposition DecomposeFelt(const HapticSurface& surface, const CellDensities& felt) {
  Decomposition parts = Decompose(surface.Felt(felt), surface.method);
  if (surface.free_side == FreeSide::kAbove) {
    for (double& density : parts.density) density = -density;
  }
  return parts;
}

}  // namespace

int HapticCell::CutEdges(int tetrahedron, double isovalue,
                         std::array<CutEdge, 4>& cuts) const noexcept {
  std::array<int, 4> above{}, below{};
  int above_count = 0, below_count = 0, count = 0;
  for (int v : parts.complex.vertices[tetrahedron]) {
    if (parts.density[v] > isovalue) {
      above[above_count++] = v;
    } else {
      below[below_count++] = v;
    }
  }
  for (int a = 0; a < above_count; ++a) {
    for (int n = 0; n < below_count; ++n) {
      // Every second round runs backwards, which keeps the order cyclic.
      const int low = below[a % 2 == 0 ? n : below_count - 1 - n], high = above[a];
      cuts[count++] = {
          low, high, (isovalue - parts.density[low]) / (parts.density[high] - parts.density[low])};
    }
  }
  return count;
}

void HapticCell::FillGradients(int tetrahedron) noexcept {
  known_gradients |= std::uint32_t{1} << tetrahedron;
  TetrahedronGradients& g = gradients[tetrahedron];
  const auto& v = parts.complex.vertices[tetrahedron];
  const Vec3& o = vertex_mm[v[0]];
  const Vec3 a = vertex_mm[v[1]] - o, b = vertex_mm[v[2]] - o, c = vertex_mm[v[3]] - o;
  const Vec3 bc = b.cross(c);
  const double inverse_det = 1.0 / a.dot(bc);
  auto& w = g.weight;
  w[1] = HalfSpace(bc * inverse_det);
  w[2] = HalfSpace(c.cross(a) * inverse_det);
  w[3] = HalfSpace(a.cross(b) * inverse_det);
  w[0] = HalfSpace(-(w[1].normal + w[2].normal + w[3].normal));
  const auto& d = parts.density;
  g.fall = HalfSpace(-((d[v[1]] - d[v[0]]) * w[1].normal + (d[v[2]] - d[v[0]]) * w[2].normal +
                       (d[v[3]] - d[v[0]]) * w[3].normal));
}

HapticCell& CellCache::Densities(const HapticSurface& surface, const Vec3i& cell) noexcept {
  if (surface.geometry_revision != geometry_revision_ || surface.free_side != free_side_) {
    geometry_revision_ = surface.geometry_revision;
    free_side_ = surface.free_side;
    ++generation_;
  }
  const std::size_t slot = SlotOf(cell);
  HapticCell& entry = cells_[slot];
  const std::uint64_t revision = surface.volume->revision();
  const bool is_filled = filled_[slot] == generation_ && entry.cell == cell;
  // After an edit elsewhere, only the bricks' revisions are checked; the cell is not decomposed
  // again.
  const bool is_right = is_filled && (volume_revision_[slot] == revision ||
                                      surface.volume->CellRevision(cell) <= volume_revision_[slot]);
  volume_revision_[slot] = revision;
  if (is_right) return entry;
  filled_[slot] = generation_;
  entry.cell = cell;
  const CellDensities stored = surface.volume->StoredCell(cell);
  entry.stored = surface.Felt(stored);
  entry.densities = surface.Felt(VolumeSnapshot::WithTiesResolved(stored, cell));
  const auto [lo, hi] = std::minmax_element(entry.densities.begin(), entry.densities.end());
  entry.min_density = *lo;
  entry.max_density = *hi;
  entry.decomposed = false;
  return entry;
}

HapticCell& CellCache::Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept {
  HapticCell& entry = Densities(surface, cell);
  if (entry.decomposed) return entry;
  entry.parts = DecomposeFelt(surface, entry.densities);
  entry.known_gradients = 0;
  entry.piece.tetrahedron = -1;
  entry.origin_mm = surface.X_DI.Apply(cell.cast<double>());
  for (int v = 0; v < kMaxVertices; ++v) {
    if (!(entry.parts.complex.used_vertices >> v & 1)) continue;
    entry.vertex_mm[v] = surface.X_DI.linear * entry.parts.position[v];
  }
  entry.decomposed = true;
  return entry;
}

}  // namespace palpate
