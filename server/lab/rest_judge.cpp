#include "server/lab/rest_judge.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>
#include <utility>
#include <vector>

#include "server/lab/triangle_distance.h"

namespace palpate::lab {
namespace {

// Densities are rounded by this share of them: where two corners are nearly as dense, that moves H
// between them by more than positions are rounded.
constexpr double kDensityRounding = 1e-15;

// A tetrahedron with the felt densities at its corners.
struct Part {
  std::array<Vec3, 4> corner;
  std::array<double, 4> density{};
};

// Adds the part of a tetrahedron in which sign * density <= sign * bound, as tetrahedra. H between
// two corners is put to the free side of its rounding.
void Cut(const Part& whole, double bound, double sign, std::vector<Part>& parts) {
  std::array<int, 4> order = {0, 1, 2, 3};  // corners within the bound first
  const auto inner = std::stable_partition(
      order.begin(), order.end(), [&](int n) { return sign * whole.density[n] <= sign * bound; });
  const auto within = inner - order.begin();
  if (within == 0) return;
  if (within == 4) return parts.push_back(whole);
  using Corner = std::pair<Vec3, double>;
  const auto at = [&](int n) { return Corner{whole.corner[order[n]], whole.density[order[n]]}; };
  const auto crossing = [&](int free, int other) {
    const auto [a, low] = at(free);
    const auto [b, high] = at(other);
    const double rounding = kDensityRounding * std::max(std::abs(low), std::abs(high));
    const double share = std::max(0.0, std::abs(bound - low) - rounding) / std::abs(high - low);
    return Corner{Vec3(a + share * (b - a)), bound};
  };
  const auto add = [&](const std::array<Corner, 4>& corners) {
    Part& part = parts.emplace_back();
    for (int n = 0; n < 4; ++n) std::tie(part.corner[n], part.density[n]) = corners[n];
  };
  // Between two triangles; a[n] and b[n] are the ends of an edge.
  const auto add_prism = [&](const std::array<Corner, 3>& a, const std::array<Corner, 3>& b) {
    add({a[0], a[1], a[2], b[0]});
    add({a[1], a[2], b[0], b[1]});
    add({a[2], b[0], b[1], b[2]});
  };
  if (within == 1) return add({at(0), crossing(0, 1), crossing(0, 2), crossing(0, 3)});
  if (within == 2) {
    return add_prism({at(0), crossing(0, 2), crossing(0, 3)},
                     {at(1), crossing(1, 2), crossing(1, 3)});
  }
  add_prism({at(0), at(1), at(2)}, {crossing(0, 3), crossing(1, 3), crossing(2, 3)});
}

// Squared distance from p to the free part of a tetrahedron.
double SquaredDistanceToFreePart(const HapticSurface& surface, const Vec3& p, const Part& whole) {
  std::vector<Part> below, free;
  Cut(whole, surface.isovalue, 1.0, below);
  for (const Part& part : below) Cut(part, surface.lower, -1.0, free);
  double nearest = std::numeric_limits<double>::infinity();
  for (const Part& part : free) {
    nearest = std::min(nearest, SquaredDistanceToTetrahedron(p, part.corner));
  }
  return nearest;
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
    Part part{CornersOf(holder.cell, cell, holder.tetrahedron),
              DensitiesOf(cell, holder.tetrahedron)};
    for (Vec3& corner : part.corner) corner = surface.X_DL.Apply(corner);
    for (double& density : part.density) density *= surface.sign();
    nearest_squared =
        std::min(nearest_squared, SquaredDistanceToFreePart(surface, p_DHip_mm, part));
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
