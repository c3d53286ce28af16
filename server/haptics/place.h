// Describes exactly where a point is in the decomposed volume.
//
// With tolerances, a point could slip between tetrahedra. So a place is combinatorial:
// - in a free cell (all its densities are free space's): the cell and the faces that the point lies
// on;
// - in any other cell: the smallest simplex (tetrahedron, triangle, edge or vertex) that holds the
//   point, with positive barycentric weights;
// - outside of the padded lattice: the position. All of the outside is free, or none of it
//   (HapticSurface::IsFreeOutside).
// When a point reaches a face, its weight or coordinate is set to exactly 0 or to the face's own,
// also where rounding leaves it beside the face. All cells and tetrahedra that hold the point
// follow from that.
//
// Frame: L, index of the lattice that H is made of.
// Threads: pure functions. Real-time: no allocation, bounded.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdlib>

#include "server/haptics/cell_cache.h"

namespace palpate {

// A weight or a distance from a cell's face below this is rounding, or one of the smallest true
// pits that the steps between ties make.
inline constexpr double kPlaceRounding = 5e-12;

// A simplex of a decomposed cell with a point in it. The weights are positive and sum to 1.
struct Carrier {
  int count = 0;
  std::array<std::uint8_t, 4> vertex{};
  std::array<double, 4> weight{};

  // Calls visit(n) for each vertex. Most simplices are triangles: for them without a loop.
  template <class Visitor>
  void Visit(Visitor visit) const {
    if (count == 3) {
      visit(0);
      visit(1);
      visit(2);
      return;
    }
    for (int n = 0; n < count; ++n) visit(n);
  }
  std::uint16_t Mask() const {
    unsigned mask = 0;
    Visit([&](int n) { mask |= 1u << vertex[n]; });
    return static_cast<std::uint16_t>(mask);
  }
  // Drops vertices with weight 0, or so near 0 that it is rounding. Scales the weights to sum 1.
  void Normalize() {
    int kept = 0;
    double sum = 0.0;
    for (int n = 0; n < count; ++n) {
      if (!(weight[n] > kPlaceRounding)) continue;
      vertex[kept] = vertex[n];
      weight[kept] = weight[n];
      sum += weight[n];
      ++kept;
    }
    count = kept;
    const double inverse = 1.0 / sum;
    for (int n = 0; n < count; ++n) weight[n] *= inverse;
  }
};

struct Place {
  enum class Kind : std::uint8_t { kOutside, kBox, kSimplex };

  Kind kind = Kind::kOutside;
  Vec3i cell = Vec3i::Zero();  // kBox, kSimplex
  std::uint8_t faces = 0;      // faces of the cell that hold the point: bit 2 * axis + side
  Vec3 p_L = Vec3::Zero();     // kOutside, kBox: exactly on those faces
  Carrier carrier;             // kSimplex
  int tetrahedron = -1;        // kSimplex: the tetrahedron whose inside holds the point, or -1
};

// Returns the faces of the neighbour at `offset`, for a point on `faces` of this cell.
std::uint8_t FacesInNeighbour(std::uint8_t faces, const Vec3i& offset);

// Returns the same simplex with the vertex numbers of the neighbour at `offset`. The simplex must
// lie on the shared face.
Carrier CarrierInNeighbour(const Carrier& carrier, const Vec3i& offset);

// Calls visit(offset) for this cell and for every neighbour that holds a point on `faces`.
template <class Visitor>
void VisitNeighbours(std::uint8_t faces, Visitor visit) {
  const auto low = [&](int axis) { return faces >> (2 * axis) & 1 ? -1 : 0; };
  const auto high = [&](int axis) { return faces >> (2 * axis + 1) & 1 ? 1 : 0; };
  for (int x = low(0); x <= high(0); ++x) {
    for (int y = low(1); y <= high(1); ++y) {
      for (int z = low(2); z <= high(2); ++z) visit(Vec3i(x, y, z));
    }
  }
}

// Calls visit(index) for all indices with the greatest difference `radius` from `middle`.
template <class Visitor>
void VisitShell(const Vec3i& middle, int radius, Visitor visit) {
  for (int x = -radius; x <= radius; ++x) {
    for (int y = -radius; y <= radius; ++y) {
      const bool side = std::max(std::abs(x), std::abs(y)) == radius;
      for (int z = -radius; z <= radius; z += side || radius == 0 ? 1 : 2 * radius) {
        visit(Vec3i(middle + Vec3i(x, y, z)));
      }
    }
  }
}

// Finds the simplex of a decomposed cell that holds the point at `local` (index coordinates from
// d0). The point must lie on `faces`.
Carrier Locate(const HapticCell& cell, const Vec3& local, std::uint8_t faces);

// The piecewise-linear density at the point.
inline double DensityAt(const HapticCell& cell, const Carrier& carrier) {
  double density = 0.0;
  carrier.Visit(
      [&](int n) { density += carrier.weight[n] * cell.parts.density[carrier.vertex[n]]; });
  return density;
}

// The position of the point in D. By the cell's own vertices, which keeps more digits than L.
inline Vec3 PositionIn(const HapticCell& cell, const Carrier& carrier) {
  Vec3 p_mm = Vec3::Zero();
  carrier.Visit([&](int n) { p_mm += carrier.weight[n] * cell.vertex_mm[carrier.vertex[n]]; });
  return cell.origin_mm + p_mm;
}

// The local index coordinates of the point, exact on the faces that hold it.
Vec3 LocalPosition(const HapticCell& cell, const Carrier& carrier);

// The tetrahedra that contain the whole simplex: bit t for tetrahedron t. Zero for a carrier
// without vertices, because callers rely on a shared vertex.
inline std::uint32_t TetrahedraAt(const TetrahedralComplex& complex, const Carrier& carrier) {
  std::uint32_t tetrahedra = carrier.count > 0 ? ~std::uint32_t{0} : 0;
  carrier.Visit([&](int n) { tetrahedra &= complex.tetrahedra_at[carrier.vertex[n]]; });
  return tetrahedra;
}

// The faces that hold the whole simplex; none for a carrier without vertices.
inline std::uint8_t FacesOf(const Carrier& carrier) {
  std::uint8_t faces = carrier.count > 0 ? 0x3f : 0;
  carrier.Visit([&](int n) { faces &= kVertexFaces[carrier.vertex[n]]; });
  return faces;
}

// Sets the place of a point in a tetrahedron of a decomposed cell. `carrier` has the tetrahedron's
// vertices, or some of them.
inline void SetSimplex(const HapticCell& cell, const Carrier& carrier, int tetrahedron,
                       Place& place) {
  place.kind = Place::Kind::kSimplex;
  place.cell = cell.cell;
  place.carrier = carrier;
  place.faces = FacesOf(carrier);
  place.tetrahedron = carrier.count == 4 ? tetrahedron : -1;
}

// Sets the place of a point in a free cell. One that rounding leaves beside a face is put on it.
void SetBox(const Vec3i& cell, const Vec3& p_L, Place& place);

// Returns the place of a position in L and sets `density` (felt). The place is a simplex also if
// the density is not free space's.
Place PlaceAt(const HapticSurface& surface, const Vec3& p_L, CellCache& cache,
              double& density) noexcept;

// The felt density and the position of a place. The position of a simplex in L lies exactly on its
// cell's faces.
double PlaceDensity(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept;
Vec3 PlacePosition(const HapticSurface& surface, const Place& place, CellCache& cache) noexcept;
Vec3 PlaceLatticePosition(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept;

}  // namespace palpate
