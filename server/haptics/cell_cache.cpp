#include "server/haptics/cell_cache.h"

#include <algorithm>
#include <bit>

namespace palpate {
namespace {

// Decomposes the cell from the densities of side kBelow, so that H is the same to the bit on both
// sides.
void DecomposeFelt(const HapticSurface& surface, const CellDensities& felt, Decomposition& parts) {
  if (surface.free_side == FreeSide::kBelow) return Decompose(felt, surface.method, parts);
  Decompose(surface.Felt(felt), surface.method, parts);
  for (double& density : parts.density) density = -density;
}

template <class Positions>
WeightGradients GradientsOfWeights(const Positions& p, const std::array<std::uint8_t, 4>& v) {
  const Vec3& o = p[v[0]];
  const Vec3 a = p[v[1]] - o, b = p[v[2]] - o, c = p[v[3]] - o;
  const Vec3 bc = b.cross(c);
  const double inverse_det = 1.0 / a.dot(bc);
  WeightGradients w;
  w[1] = HalfSpace(bc * inverse_det);
  w[2] = HalfSpace(c.cross(a) * inverse_det);
  w[3] = HalfSpace(a.cross(b) * inverse_det);
  w[0] = HalfSpace(-(w[1].normal + w[2].normal + w[3].normal));
  return w;
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

template <int kXBits, int kYBits, int kZBits>
void CellCacheOf<kXBits, kYBits, kZBits>::FillGradients(HapticCell& entry,
                                                        int tetrahedron) noexcept {
  entry.known_gradients |= std::uint32_t{1} << tetrahedron;
  const auto& v = entry.parts.complex.vertices[tetrahedron];
  if (!entry.parts.is_plain) entry.weight[tetrahedron] = GradientsOfWeights(entry.vertex_mm, v);
  const WeightGradients& w = WeightsOf(entry)[tetrahedron];
  const auto& d = entry.parts.density;
  entry.fall[tetrahedron] =
      HalfSpace(-((d[v[1]] - d[v[0]]) * w[1].normal + (d[v[2]] - d[v[0]]) * w[2].normal +
                  (d[v[3]] - d[v[0]]) * w[3].normal));
}

template <int kXBits, int kYBits, int kZBits>
HapticCell& CellCacheOf<kXBits, kYBits, kZBits>::Fill(const HapticSurface& surface,
                                                      const Vec3i& cell,
                                                      std::size_t slot) noexcept {
  const bool is_other_geometry = generation_ == kNoGeneration ||
                                 surface.geometry_revision != geometry_revision_ ||
                                 surface.lattice.refinement() != refinement_;
  if (is_other_geometry || surface.free_side != free_side_) {
    if (is_other_geometry) FillPlainCell(surface.X_DL);
    geometry_revision_ = surface.geometry_revision;
    refinement_ = surface.lattice.refinement();
    free_side_ = surface.free_side;
    ++generation_;
  }
  HapticCell& entry = cells_[slot];
  const std::uint64_t revision = surface.volume->revision();
  const bool is_filled = filled_[slot] == generation_ && entry.cell == cell;
  // After an edit elsewhere, only the bricks' revisions are checked; the cell is not decomposed
  // again.
  const bool is_right = is_filled && (volume_revision_[slot] == revision ||
                                      surface.lattice.CellRevision(cell) <= volume_revision_[slot]);
  volume_revision_[slot] = revision;
  if (is_right) return entry;
  filled_[slot] = generation_;
  entry.cell = cell;
  if (refinement_ == 1) {
    entry.densities = surface.Felt(surface.volume->ResolvedCell(cell));
  } else {
    const Lattice::Part part = surface.lattice.PartOf(cell);
    const VoxelCell& voxels = VoxelCellOf(surface, part.voxel_cell);
    entry.densities = SubCell(voxels.densities, part.sub, refinement_);
    entry.min_of_voxels = voxels.min_density;
    entry.max_of_voxels = voxels.max_density;
  }
  entry.min_density = entry.max_density = entry.densities[0];
  for (const double density : entry.densities) {
    entry.min_density = std::min(entry.min_density, density);
    entry.max_density = std::max(entry.max_density, density);
  }
  if (refinement_ == 1) {
    entry.min_of_voxels = entry.min_density;
    entry.max_of_voxels = entry.max_density;
  }
  entry.decomposed = false;
  return entry;
}

template <int kXBits, int kYBits, int kZBits>
auto CellCacheOf<kXBits, kYBits, kZBits>::VoxelCellOf(const HapticSurface& surface,
                                                      const Vec3i& cell) noexcept
    -> const VoxelCell& {
  VoxelCell& entry = voxel_cells_[SlotOf(cell) % voxel_cells_.size()];
  const std::uint64_t revision = surface.volume->revision();
  const bool is_right = entry.filled == generation_ && entry.cell == cell &&
                        (entry.volume_revision == revision ||
                         surface.volume->CellRevision(cell) <= entry.volume_revision);
  entry.volume_revision = revision;
  if (is_right) return entry;
  entry.filled = generation_;
  entry.cell = cell;
  entry.densities = surface.Felt(surface.volume->ResolvedCell(cell));
  const auto [low, high] = std::ranges::minmax_element(entry.densities);
  entry.min_density = *low;
  entry.max_density = *high;
  return entry;
}

template <int kXBits, int kYBits, int kZBits>
void CellCacheOf<kXBits, kYBits, kZBits>::FillDecomposition(const HapticSurface& surface,
                                                            HapticCell& entry) noexcept {
  const bool was_plain = entry.parts.is_plain && entry.place == place_;
  DecomposeFelt(surface, entry.densities, entry.parts);
  entry.known_gradients = 0;
  entry.piece.tetrahedron = -1;
  entry.origin_mm = surface.X_DL.Apply(entry.cell.cast<double>());
  if (entry.parts.is_plain) {
    if (!was_plain) std::ranges::copy(plain_vertex_mm_, entry.vertex_mm.begin());
  } else {
    for (unsigned left = entry.parts.complex.used_vertices; left; left &= left - 1) {
      const int v = std::countr_zero(left);
      entry.vertex_mm[v] = surface.X_DL.linear * entry.parts.position[v];
    }
  }
  entry.place = place_;
  entry.decomposed = true;
}

template <int kXBits, int kYBits, int kZBits>
void CellCacheOf<kXBits, kYBits, kZBits>::FillPlainCell(const AffineMap& X_DL) noexcept {
  for (std::size_t v = 0; v < plain_vertex_mm_.size(); ++v) {
    plain_vertex_mm_[v] = X_DL.linear * Vec3::Map(kPlainPositions[v].data());
  }
  for (std::size_t t = 0; t < plain_weight_.size(); ++t) {
    plain_weight_[t] = GradientsOfWeights(plain_vertex_mm_, kDiamondComplexes[0].vertices[t]);
  }
  ++place_;
}

template class CellCacheOf<3, 2, 2>;
template class CellCacheOf<4, 4, 3>;

}  // namespace palpate
