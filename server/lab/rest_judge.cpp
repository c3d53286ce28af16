#include "server/lab/rest_judge.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "server/lab/triangle_distance.h"

namespace palpate::lab {
namespace {

using Corners = std::array<Vec3, 4>;

// Squared distance to a prism between two triangles. a[n] and b[n] are the ends of an edge.
double SquaredDistanceToPrism(const Vec3& p, const std::array<Vec3, 3>& a,
                              const std::array<Vec3, 3>& b) {
  return std::min({SquaredDistanceToTetrahedron(p, {a[0], a[1], a[2], b[0]}),
                   SquaredDistanceToTetrahedron(p, {a[1], a[2], b[0], b[1]}),
                   SquaredDistanceToTetrahedron(p, {a[2], b[0], b[1], b[2]})});
}

// Squared distance from p to the free part of a tetrahedron. `inside`: how far the density at each
// corner is inside the object (positive there).
double SquaredDistanceToFreePart(const Vec3& p, const Corners& corner,
                                 const std::array<double, 4>& inside) {
  std::array<int, 4> order = {0, 1, 2, 3};  // free corners first
  const auto inner =
      std::stable_partition(order.begin(), order.end(), [&](int n) { return inside[n] <= 0.0; });
  const auto at = [&](int n) { return corner[order[n]]; };
  const auto crossing = [&](int free, int other) {
    const double a = inside[order[free]], b = inside[order[other]];
    return Vec3(at(free) + a / (a - b) * (at(other) - at(free)));
  };
  switch (inner - order.begin()) {
    case 4:
      return SquaredDistanceToTetrahedron(p, corner);
    case 3:
      return SquaredDistanceToPrism(p, {at(0), at(1), at(2)},
                                    {crossing(0, 3), crossing(1, 3), crossing(2, 3)});
    case 2:
      return SquaredDistanceToPrism(p, {at(0), crossing(0, 2), crossing(0, 3)},
                                    {at(1), crossing(1, 2), crossing(1, 3)});
    case 1:
      return SquaredDistanceToTetrahedron(p,
                                          {at(0), crossing(0, 1), crossing(0, 2), crossing(0, 3)});
    default:
      return std::numeric_limits<double>::infinity();
  }
}

// True if a proxy on the border may leave the lattice because the HIP lies beyond the border by
// more than rounding.
bool MayLeave(const FreshCells& cells, const Vec3& p_LH, const Vec3& p_LHip) {
  const Vec3 last = cells.surface().lattice.size().cast<double>();
  for (int axis = 0; axis < 3; ++axis) {
    const double ahead = p_LHip[axis] - p_LH[axis];
    if (p_LH[axis] <= -1.0 + kHoldTolerance && ahead < -kHoldTolerance) return true;
    if (p_LH[axis] >= last[axis] - kHoldTolerance && ahead > kHoldTolerance) return true;
  }
  return false;
}

}  // namespace

double ApproachLeft(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm,
                    double hold_tolerance) {
  const HapticSurface& surface = cells.surface();
  const double distance_mm = (p_DH_mm - p_DHip_mm).norm();
  const Vec3 p_LH = surface.X_LD.Apply(p_DH_mm);
  const Holders holders = cells.HoldersOf(p_LH);
  if (holders.outside && surface.IsFreeOutside() &&
      (holders.tetrahedra.empty() || MayLeave(cells, p_LH, surface.X_LD.Apply(p_DHip_mm)))) {
    return distance_mm;
  }
  double nearest_squared = distance_mm * distance_mm;
  for (const Holder& holder : holders.tetrahedra) {
    const double least = *std::min_element(holder.weight.begin(), holder.weight.end());
    if (!(least >= -hold_tolerance)) continue;
    const FreshCell& cell = cells.At(holder.cell);
    Corners corner = CornersOf(holder.cell, cell, holder.tetrahedron);
    std::array<double, 4> inside{};
    for (int n = 0; n < 4; ++n) {
      corner[n] = surface.X_DL.Apply(corner[n]);
      const int vertex = cell.parts.complex.vertices[holder.tetrahedron][n];
      inside[n] = cells.Inside(cell.parts.density[vertex]);
    }
    nearest_squared =
        std::min(nearest_squared, SquaredDistanceToFreePart(p_DHip_mm, corner, inside));
  }
  return distance_mm - std::sqrt(nearest_squared);
}

bool IsLocalMinimum(FreshCells& cells, const Vec3& p_DH_mm, const Vec3& p_DHip_mm) {
  const double tolerance_mm = std::max({kStickTolerance * (p_DH_mm - p_DHip_mm).norm(),
                                        kStickTolerancePerVoxel * cells.surface().voxel_mm,
                                        kStickTolerancePerPosition * p_DHip_mm.norm()});
  return ApproachLeft(cells, p_DH_mm, p_DHip_mm) <= tolerance_mm;
}

}  // namespace palpate::lab
