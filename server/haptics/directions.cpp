#include "server/haptics/directions.h"

#include <bit>
#include <cmath>

namespace palpate {
namespace {

// A slope counts as steeper only beyond this factor, so that rounding does not choose.
constexpr double kSteeper = 1.0 + 1e-12;
// In a pit, a slope below this share of the gradient is rounding.
constexpr double kNoSlope = 1e-9;

// The half-spaces of the cell's faces that hold the point, with inward normals in D.
Cone BoxCone(const HapticSurface& surface, std::uint8_t faces) {
  Cone cone;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3 normal = surface.X_ID.linear.row(axis);
    if (faces >> (2 * axis) & 1) cone.Add(HalfSpace(normal));
    if (faces >> (2 * axis + 1) & 1) cone.Add(HalfSpace(-normal));
  }
  return cone;
}

// Returns the place as a simplex of the cell at `offset`.
Carrier CarrierIn(const HapticCell& cell, const Place& place, const Vec3i& offset,
                  std::uint8_t faces) {
  if (place.kind == Place::Kind::kSimplex) return CarrierInNeighbour(place.carrier, offset);
  return Locate(cell, place.p_I - cell.cell.cast<double>(), faces);
}

struct TetrahedronCone {
  Cone cone;
  int surface_number = -1;  // number of the half-space under H
};

TetrahedronCone MakeTetrahedronCone(const HapticCell& cell, int tetrahedron, std::uint16_t mask,
                                    const TetrahedronGradients& gradients, bool on_surface) {
  TetrahedronCone result;
  const auto& vertices = cell.parts.complex.vertices[tetrahedron];
  for (int n = 0; n < 4; ++n) {
    if (!(mask >> vertices[n] & 1)) result.cone.Add(gradients.weight[n]);
  }
  if (on_surface) result.surface_number = result.cone.Add(gradients.fall);
  return result;
}

// Inside a tetrahedron, only H limits the direction.
Candidate DirectionInside(const HapticSurface& surface, const Place& place, bool on_surface,
                          const Vec3& w_mm, CellCache& cache) noexcept {
  Candidate candidate{.kind = Candidate::Kind::kTetrahedron,
                      .cell = place.cell,
                      .carrier = place.carrier,
                      .tetrahedron = place.tetrahedron,
                      .d_mm = w_mm};
  const auto& [fall, fall2] =
      cache.Decomposed(surface, place.cell).Gradients(place.tetrahedron).fall;
  const double along = fall.dot(w_mm);
  candidate.along_surface = on_surface && along < 0.0;
  candidate.full = !candidate.along_surface;
  if (!candidate.full) candidate.d_mm -= (along / fall2) * fall;
  return candidate;
}

// Visits the cells that hold a place, one by one, and keeps the longest projection.
class DirectionSearch {
 public:
  DirectionSearch(const HapticSurface& surface, const Place& place, bool on_surface,
                  const Vec3& w_mm, CellCache& cache, int& tetrahedra)
      : surface_(surface),
        place_(place),
        on_surface_(on_surface),
        w_mm_(w_mm),
        cache_(cache),
        tetrahedra_(tetrahedra) {}

  void Visit(const Vec3i& offset) noexcept {
    if (best_.full) return;
    const Vec3i cell = place_.cell + offset;
    const std::uint8_t faces = FacesInNeighbour(place_.faces, offset);
    if (!surface_.volume->HasCell(cell)) return VisitOutside(cell, faces);
    const HapticCell& densities = cache_.Densities(surface_, cell);
    if (densities.IsFree(surface_.isovalue)) return VisitFreeCell(cell, faces);
    if (densities.IsCrossed(surface_.isovalue)) VisitCrossedCell(cell, offset, faces);
  }

  const Candidate& best() const { return best_; }

 private:
  // The outside is free, and convex here: a direction out of the lattice is taken whole. A
  // projection on the apex is no direction and has no active face.
  void VisitOutside(const Vec3i& cell, std::uint8_t faces) noexcept {
    if (!surface_.IsFreeOutside()) return;
    if (ProjectOnCone(w_mm_, BoxCone(surface_, faces)).d != w_mm_) return;
    best_.d_mm = w_mm_;
    Take(Candidate::Kind::kOutside, cell, faces, true);
  }

  void VisitFreeCell(const Vec3i& cell, std::uint8_t faces) noexcept {
    const ConeProjection projection = ProjectOnCone(w_mm_, BoxCone(surface_, faces), best_2_);
    if (!IsLonger(projection.d)) return;
    Take(Candidate::Kind::kBox, cell, faces, projection.active == 0);
  }

  void VisitCrossedCell(const Vec3i& index, const Vec3i& offset, std::uint8_t faces) noexcept {
    HapticCell& cell = cache_.Decomposed(surface_, index);
    const Carrier carrier = CarrierIn(cell, place_, offset, faces);
    const std::uint16_t mask = carrier.Mask();
    for (std::uint32_t left = TetrahedraAt(cell.parts.complex, carrier); left && !best_.full;
         left &= left - 1) {
      const int t = std::countr_zero(left);
      ++tetrahedra_;
      const TetrahedronCone tangent =
          MakeTetrahedronCone(cell, t, mask, cell.Gradients(t), on_surface_);
      const ConeProjection projection = ProjectOnCone(w_mm_, tangent.cone, best_2_);
      if (!IsLonger(projection.d)) continue;
      Take(Candidate::Kind::kTetrahedron, index, faces, projection.active == 0);
      best_.carrier = carrier;
      best_.tetrahedron = t;
      best_.along_surface =
          tangent.surface_number >= 0 && (projection.active >> tangent.surface_number & 1);
    }
  }

  // Keeps `d` if it is longer than the best so far.
  bool IsLonger(const Vec3& d) noexcept {
    const double length2 = d.squaredNorm();
    if (!(length2 > best_2_)) return false;
    best_.d_mm = d;
    best_2_ = length2;
    return true;
  }

  void Take(Candidate::Kind kind, const Vec3i& cell, std::uint8_t faces, bool full) noexcept {
    best_.kind = kind;
    best_.cell = cell;
    best_.faces = faces;
    best_.full = full;
    best_.along_surface = false;
  }

  const HapticSurface& surface_;
  const Place& place_;
  const bool on_surface_;
  const Vec3& w_mm_;
  CellCache& cache_;
  int& tetrahedra_;
  Candidate best_;
  double best_2_ = 0.0;  // |best_.d_mm|²
};

}  // namespace

Candidate BestDirection(const HapticSurface& surface, const Place& place, bool on_surface,
                        const Vec3& w_mm, CellCache& cache, int& tetrahedra) noexcept {
  if (place.kind == Place::Kind::kSimplex && place.tetrahedron >= 0) {
    ++tetrahedra;
    return DirectionInside(surface, place, on_surface, w_mm, cache);
  }
  DirectionSearch search(surface, place, on_surface, w_mm, cache, tetrahedra);
  VisitNeighbours(place.faces, [&](const Vec3i& offset) { search.Visit(offset); });
  return search.best();
}

Candidate SteepestDescent(const HapticSurface& surface, const Place& place,
                          CellCache& cache) noexcept {
  Candidate best;
  double best_slope = 0.0;
  VisitNeighbours(place.faces, [&](const Vec3i& offset) {
    Candidate candidate;
    candidate.cell = place.cell + offset;
    if (!surface.volume->HasCell(candidate.cell)) return;
    candidate.faces = FacesInNeighbour(place.faces, offset);
    HapticCell& cell = cache.Decomposed(surface, candidate.cell);
    candidate.kind = Candidate::Kind::kTetrahedron;
    candidate.carrier = CarrierIn(cell, place, offset, candidate.faces);
    const std::uint16_t mask = candidate.carrier.Mask();
    for (std::uint32_t left = TetrahedraAt(cell.parts.complex, candidate.carrier); left;
         left &= left - 1) {
      const int t = std::countr_zero(left);
      const TetrahedronGradients& gradients = cell.Gradients(t);
      const TetrahedronCone tangent = MakeTetrahedronCone(cell, t, mask, gradients, false);
      const Vec3 d = ProjectOnCone(gradients.fall.normal, tangent.cone).d;
      // d is orthogonal to the part that the cone cuts off, so the slope along d is |d|.
      const double slope = d.norm();
      if (!(slope > best_slope * kSteeper)) continue;
      if (!(slope > kNoSlope * std::sqrt(gradients.fall.normal2))) continue;
      best_slope = slope;
      best = candidate;
      best.tetrahedron = t;
      // Long enough for the density to fall by its whole range.
      best.d_mm = d / (slope * slope);
    }
  });
  return best;
}

}  // namespace palpate
