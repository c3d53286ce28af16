// Caches the cells that the proxy visited lately, with their decompositions and the gradients of
// their tetrahedra.
//
// The results depend only on the surface and the cell, never on the cache's state.
// Threads: one for each cache. Real-time: no allocation, no locks; fixed size.
#pragma once

#include <array>
#include <cstdint>

#include "server/haptics/cone.h"
#include "server/haptics/haptic_surface.h"

namespace palpate {

// Gradients of the barycentric coordinates of a tetrahedron, 1/mm, in D axes: the half-space of
// number n is behind the face opposite to vertex n. The contents of the paper's A⁻¹ (Eqs. 8-10).
using WeightGradients = std::array<HalfSpace, 4>;

struct TetrahedronGradients {
  const WeightGradients& weight;
  const HalfSpace& fall;  // minus the gradient of the felt density
};

// The triangle or quadrilateral of H in a tetrahedron.
struct SurfacePiece {
  struct Corner {
    Vec3 local;     // index coordinates from d0
    Vec3 normal_D;  // towards lower density of V, unit
  };

  int tetrahedron = -1;
  double isovalue = 0.0;
  int count = 0;
  std::array<Corner, 4> corners;  // in cyclic order
};

// The point where τ cuts the edge from vertex `low` to `high`, at `share` of the way.
struct CutEdge {
  int low = 0, high = 0;
  double share = 0.0;

  Vec3 Between(const std::array<Vec3, kMaxVertices>& p) const {
    return p[low] + share * (p[high] - p[low]);
  }
};

struct HapticCell {
  Vec3i cell = Vec3i::Zero();
  CellDensities densities{};  // felt, ties resolved
  double min_density = 0.0;
  double max_density = 0.0;
  double min_of_voxels = 0.0;  // of the cell of the voxels that this one lies in
  double max_of_voxels = 0.0;
  Decomposition parts;                       // valid once `decomposed`
  std::array<Vec3, kMaxVertices> vertex_mm;  // valid once `decomposed`; D axes, relative to d0
  Vec3 origin_mm = Vec3::Zero();             // valid once `decomposed`; position of d0 in D
  bool decomposed = false;
  std::uint32_t place = 0;  // of the lattice, by which the vertices were filled
  std::uint32_t known_gradients = 0;                   // bit t: those of tetrahedron t are filled
  std::array<WeightGradients, kMaxTetrahedra> weight;  // not of a plain cell
  std::array<HalfSpace, kMaxTetrahedra> fall;
  SurfacePiece piece;  // the last requested one

  bool IsFree(const HapticSurface& surface) const {
    return max_density <= surface.isovalue && min_density >= surface.lower;
  }
  // A part of it may be free, and a part not.
  bool IsCrossed(const HapticSurface& surface) const {
    return min_density <= surface.isovalue && max_density >= surface.lower && !IsFree(surface);
  }

  // Computes where τ cuts the edges of a tetrahedron. These are the corners of H's piece there, in
  // cyclic order.
  int CutEdges(int tetrahedron, double isovalue, std::array<CutEdge, 4>& cuts) const noexcept;
};

// kBits: of the numbers of slots along the three axes. Cells that far apart share a slot.
template <int kXBits, int kYBits, int kZBits>
class CellCacheOf {
 public:
  // Returns a cell with its densities only. The reference is valid until the next call for a cell
  // in the same slot: copy values that must last.
  HapticCell& Densities(const HapticSurface& surface, const Vec3i& cell) noexcept {
    const std::size_t slot = SlotOf(cell);
    HapticCell& entry = cells_[slot];
    const bool is_right =
        surface.geometry_revision == geometry_revision_ && surface.free_side == free_side_ &&
        surface.lattice.refinement() == refinement_ && filled_[slot] == generation_ &&
        volume_revision_[slot] == surface.volume->revision() && entry.cell.x() == cell.x() &&
        entry.cell.y() == cell.y() && entry.cell.z() == cell.z();
    return is_right ? entry : Fill(surface, cell, slot);
  }
  // Returns a cell with its decomposition.
  HapticCell& Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept {
    HapticCell& entry = Densities(surface, cell);
    Decompose(surface, entry);
    return entry;
  }
  // Decomposes a cell that Densities returned.
  void Decompose(const HapticSurface& surface, HapticCell& entry) noexcept {
    if (!entry.decomposed) FillDecomposition(surface, entry);
  }
  // Valid until the cell's slot is filled anew.
  TetrahedronGradients Gradients(HapticCell& entry, int tetrahedron) noexcept {
    if (!(entry.known_gradients >> tetrahedron & 1)) FillGradients(entry, tetrahedron);
    return {WeightsOf(entry)[tetrahedron], entry.fall[tetrahedron]};
  }

 private:
  // Neighbouring cells get different slots.
  static std::size_t SlotOf(const Vec3i& cell) {
    const auto last = [](int coordinate, int bits) { return coordinate & ((1 << bits) - 1); };
    return static_cast<std::size_t>(last(cell.x(), kXBits) << (kYBits + kZBits) |
                                    last(cell.y(), kYBits) << kZBits | last(cell.z(), kZBits));
  }
  // The cell of the voxels from which sub-cells are interpolated.
  struct VoxelCell {
    Vec3i cell = Vec3i::Zero();
    CellDensities densities{};  // felt, ties resolved
    double min_density = 0.0, max_density = 0.0;
    std::uint64_t filled = 0, volume_revision = 0;  // as those of the slots below
  };

  HapticCell& Fill(const HapticSurface& surface, const Vec3i& cell, std::size_t slot) noexcept;
  const VoxelCell& VoxelCellOf(const HapticSurface& surface, const Vec3i& cell) noexcept;
  void FillPlainCell(const AffineMap& X_DL) noexcept;
  const WeightGradients* WeightsOf(const HapticCell& entry) const {
    return entry.parts.is_plain ? plain_weight_.data() : entry.weight.data();
  }
  void FillDecomposition(const HapticSurface& surface, HapticCell& entry) noexcept;
  void FillGradients(HapticCell& entry, int tetrahedron) noexcept;

  static constexpr std::size_t kSlots = std::size_t{1} << (kXBits + kYBits + kZBits);
  static constexpr std::uint64_t kNoGeneration = 1;  // nothing was filled yet

  std::uint64_t geometry_revision_ = 0;
  FreeSide free_side_ = FreeSide::kBelow;
  int refinement_ = 1;
  std::array<std::uint64_t, kSlots> filled_{};           // generation_ when the slot was filled
  std::array<std::uint64_t, kSlots> volume_revision_{};  // revision for which the slot was last
                                                         // right
  std::uint64_t generation_ = kNoGeneration;
  std::uint32_t place_ = 0;  // counts those of the lattice
  // What all plain cells (Decomposition::is_plain) have in common.
  std::array<Vec3, kFirstInteriorVertex> plain_vertex_mm_;
  std::array<WeightGradients, kDiamondComplexes[0].tetrahedron_count> plain_weight_;
  std::array<HapticCell, kSlots> cells_;
  // 4 × 4 × 4 of a point's. Without refinement, none is used.
  std::array<VoxelCell, kSlots / 2> voxel_cells_;
};

// For a point: 8 × 4 × 4 cells, 0.65 MB.
class CellCache : public CellCacheOf<3, 2, 2> {};

// For the balls of a tool: 16 × 16 × 8 cells, 10 MB.
class ToolCellCache : public CellCacheOf<4, 4, 3> {};

}  // namespace palpate
