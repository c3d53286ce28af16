// Evaluates the decomposed volume afresh, to judge a proxy. Knows nothing of the proxy's places,
// caches and moves.
//
// Only the position of a point tells which tetrahedra hold the point. Positions are rounded, so a
// point within kHoldTolerance of a face counts as held by the tetrahedra on both sides. The density
// is continuous there.
//
// Densities are normalised, not felt: on the side FreeSide::kAbove, a point is free if its density
// is not below τ. With two bounds, it is free between them. Beyond the padded lattice the density
// is the background's. Frame: L, index of the lattice. Threads: one per object. Errors: none.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <unordered_map>
#include <vector>

#include "common/isosurface/decomposition.h"
#include "server/haptics/haptic_surface.h"

namespace palpate::lab {

// A tolerance of barycentric weights, and of index coordinates next to the faces of a cell.
inline constexpr double kHoldTolerance = 1e-9;

struct FreshCell {
  Decomposition parts;
  bool crossed = false;  // a part of the cell may be free, and a part not
  bool free = false;     // the whole cell is free
};

// A tetrahedron that holds a point, with the point's barycentric weights.
struct Holder {
  Vec3i cell = Vec3i::Zero();
  int tetrahedron = 0;
  std::array<double, 4> weight{};
  double density = 0.0;
};

struct Holders {
  std::vector<Holder> tetrahedra;
  bool outside = false;  // beyond the padded lattice, or on its border
  double density_outside = 0.0;

  // The density in the tetrahedron in which the point lies deepest. NaN in a gap.
  double Density() const;
};

class FreshCells {
 public:
  // Borrows the surface's volume.
  explicit FreshCells(const HapticSurface& surface);

  // The reference is valid until Trim().
  const FreshCell& At(const Vec3i& cell);
  // Forgets the cells if there are very many.
  void Trim();

  Holders HoldersOf(const Vec3& p_L);

  const HapticSurface& surface() const { return surface_; }
  bool HasCell(const Vec3i& cell) const { return surface_.lattice.HasCell(cell); }
  // How far a density is outside of free space, beyond either bound; positive there.
  double Inside(double density) const {
    const double felt = surface_.sign() * density;
    return std::max(felt - surface_.isovalue, surface_.lower - felt);
  }
  bool IsFree(double density) const { return Inside(density) <= 0.0; }
  // Whether a simplex with these densities at its corners has a free part. Between two bounds, it
  // may have one although no corner is free.
  template <class Range>
  bool HasFreePart(const Range& densities) const {
    bool reaches_upper = false, reaches_lower = false;
    for (const double density : densities) {
      reaches_upper |= surface_.sign() * density <= surface_.isovalue;
      reaches_lower |= surface_.sign() * density >= surface_.lower;
    }
    return reaches_upper && reaches_lower;
  }
  // A number for each cell of the padded lattice.
  std::uint64_t KeyOf(const Vec3i& cell) const;

 private:
  HapticSurface surface_;
  std::unordered_map<std::uint64_t, FreshCell> cells_;
};

// Corners of a tetrahedron of a cell, in L, and the densities there.
std::array<Vec3, 4> CornersOf(const Vec3i& cell, const FreshCell& fresh, int tetrahedron);
std::array<double, 4> DensitiesOf(const FreshCell& fresh, int tetrahedron);

}  // namespace palpate::lab
