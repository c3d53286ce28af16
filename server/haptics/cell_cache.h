// Caches the cells that the proxy visited lately, with their decompositions and the gradients of
// their tetrahedra.
//
// The results depend only on the surface and the cell, never on the cache's state.
// Threads: one (the servo's). Real-time: no allocation, no locks; fixed size.
#pragma once

#include <array>
#include <cstdint>

#include "server/haptics/cone.h"
#include "server/haptics/haptic_surface.h"

namespace palpate {

// Gradients of linear functions on a tetrahedron: the contents of the paper's A⁻¹ (Eqs. 8-10).
struct TetrahedronGradients {
  // Of the barycentric coordinates, 1/mm, in D axes: the half-space of number n is behind the face
  // opposite to vertex n.
  std::array<HalfSpace, 4> weight;
  HalfSpace fall;  // minus the gradient of the felt density
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
  CellDensities stored{};     // felt; those of V
  CellDensities densities{};  // felt, ties resolved; those of H
  double min_density = 0.0;
  double max_density = 0.0;
  Decomposition parts;                       // valid once `decomposed`
  std::array<Vec3, kMaxVertices> vertex_mm;  // valid once `decomposed`; D axes, relative to d0
  Vec3 origin_mm = Vec3::Zero();             // valid once `decomposed`; position of d0 in D
  bool decomposed = false;
  std::uint32_t known_gradients = 0;  // bit t: gradients[t] is filled
  std::array<TetrahedronGradients, kMaxTetrahedra> gradients;
  SurfacePiece piece;  // the last requested one

  bool IsCrossed(double isovalue) const {
    return min_density <= isovalue && isovalue < max_density;
  }
  bool IsFree(double isovalue) const { return max_density <= isovalue; }

  // Computes where τ cuts the edges of a tetrahedron. These are the corners of H's piece there, in
  // cyclic order.
  int CutEdges(int tetrahedron, double isovalue, std::array<CutEdge, 4>& cuts) const noexcept;

  const TetrahedronGradients& Gradients(int tetrahedron) noexcept {
    if (!(known_gradients >> tetrahedron & 1)) FillGradients(tetrahedron);
    return gradients[tetrahedron];
  }

 private:
  void FillGradients(int tetrahedron) noexcept;
};

class CellCache {
 public:
  // Returns a cell with its densities only. The reference is valid until the next call for a cell
  // in the same slot: copy values that must last.
  HapticCell& Densities(const HapticSurface& surface, const Vec3i& cell) noexcept;
  // Returns a cell with its decomposition.
  HapticCell& Decomposed(const HapticSurface& surface, const Vec3i& cell) noexcept;

 private:
  static constexpr std::size_t kSlots = 128;
  static constexpr std::uint64_t kEmpty = ~std::uint64_t{0};

  std::uint64_t geometry_revision_ = kEmpty;
  FreeSide free_side_ = FreeSide::kBelow;
  std::array<std::uint64_t, kSlots> filled_{};           // generation_ when the slot was filled
  std::array<std::uint64_t, kSlots> volume_revision_{};  // revision for which the slot was last
                                                         // right
  std::uint64_t generation_ = 0;
  std::array<HapticCell, kSlots> cells_;
};

}  // namespace palpate
