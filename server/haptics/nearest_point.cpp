#include "server/haptics/nearest_point.h"

#include <algorithm>
#include <cmath>

#include "server/haptics/place.h"

namespace palpate {
namespace {

// Returns the point of a segment that is nearest to the origin.
Vec3 NearestOnSegment(const Vec3& a, const Vec3& b) {
  const Vec3 along = b - a;
  const double length2 = along.squaredNorm();
  if (!(length2 > 0.0)) return a;
  return a + std::clamp(-a.dot(along) / length2, 0.0, 1.0) * along;
}

// Returns the point of a convex flat polygon that is nearest to the origin. The polygon has `count`
// corners in cyclic order.
Vec3 NearestOnPolygon(const std::array<Vec3, 4>& corner, int count) {
  Vec3 best = corner[0];
  for (int n = 0; n < count; ++n) {
    const Vec3 candidate = NearestOnSegment(corner[n], corner[(n + 1) % count]);
    if (candidate.squaredNorm() < best.squaredNorm()) best = candidate;
  }
  const Vec3 normal = (corner[1] - corner[0]).cross(corner[2] - corner[0]);
  const double length2 = normal.squaredNorm();
  if (!(length2 > 0.0)) return best;
  const Vec3 foot = normal * (normal.dot(corner[0]) / length2);
  for (int n = 0; n < count; ++n) {
    const Vec3& a = corner[n];
    if (normal.dot((corner[(n + 1) % count] - a).cross(foot - a)) < 0.0) return best;
  }
  return foot;
}

// Half the longest diagonal of a cell.
double BallOfCell(const Mat3& X) {
  double longest = 0.0;
  for (const double y : {-0.5, 0.5}) {
    for (const double z : {-0.5, 0.5}) longest = std::max(longest, (X * Vec3(0.5, y, z)).norm());
  }
  return longest;
}

// Visits cells and keeps the nearest point to `p_D`.
class NearestSearch {
 public:
  NearestSearch(const HapticSurface& surface, const Vec3& p_D, double reach_mm, CellCache& cache)
      : surface_(surface),
        p_D_(p_D),
        p_I_(surface.X_ID.Apply(p_D)),
        plane_mm_(surface.X_ID.linear.rowwise().norm().cwiseInverse()),
        ball_mm_(BallOfCell(surface.X_DI.linear)),
        best_mm_(reach_mm),
        cache_(cache) {}

  double best_mm() const { return best_mm_; }
  std::optional<Vec3> point() const { return point_; }

  void Visit(const Vec3i& index) noexcept {
    if (!surface_.volume->HasCell(index) || DistanceBound(index) > best_mm_) return;
    if (!MayBeCrossed(index)) return;
    HapticCell& cell = cache_.Decomposed(surface_, index);
    for (int t = 0; t < cell.parts.complex.tetrahedron_count; ++t) VisitTetrahedron(cell, t);
  }

 private:
  // The cell is at least as far away as the farthest slab that it lies in, and as the ball around
  // it.
  double DistanceBound(const Vec3i& index) const noexcept {
    const Vec3 low = index.cast<double>() - p_I_;
    const Vec3 gap = low.cwiseMax(-low - Vec3::Ones()).cwiseMax(0.0);
    const double slab_mm = gap.cwiseProduct(plane_mm_).maxCoeff();
    if (slab_mm > best_mm_) return slab_mm;
    const Vec3 middle_mm = surface_.X_DI.linear * (low + Vec3::Constant(0.5));
    return std::max(slab_mm, middle_mm.norm() - ball_mm_);
  }

  // Uses the stored densities, which the resolved ones are slightly below. Most cells are far from
  // τ, so this cheap test excludes them.
  bool MayBeCrossed(const Vec3i& index) const noexcept {
    const CellDensities d = surface_.Felt(surface_.volume->StoredCell(index));
    const auto [low, high] = std::minmax_element(d.begin(), d.end());
    return *low - kTieStep <= surface_.isovalue && surface_.isovalue < *high + kTieStep;
  }

  void VisitTetrahedron(const HapticCell& cell, int tetrahedron) noexcept {
    std::array<CutEdge, 4> cuts;
    const int count = cell.CutEdges(tetrahedron, surface_.isovalue, cuts);
    std::array<Vec3, 4> corner;
    for (int n = 0; n < count; ++n) {
      corner[n] = cell.origin_mm - p_D_ + cuts[n].Between(cell.vertex_mm);
    }
    if (count < 3 || !MayBeNearer(corner, count)) return;
    const Vec3 nearest = NearestOnPolygon(corner, count);
    if (!(nearest.norm() < best_mm_)) return;
    best_mm_ = nearest.norm();
    point_ = p_D_ + nearest;
  }

  // Tests the ball around the corners' mean that contains all corners.
  bool MayBeNearer(const std::array<Vec3, 4>& corner, int count) const noexcept {
    Vec3 middle = Vec3::Zero();
    for (int n = 0; n < count; ++n) middle += corner[n];
    middle /= count;
    double radius2 = 0.0;
    for (int n = 0; n < count; ++n) {
      radius2 = std::max(radius2, (corner[n] - middle).squaredNorm());
    }
    return middle.norm() - std::sqrt(radius2) < best_mm_;
  }

  const HapticSurface& surface_;
  const Vec3 p_D_, p_I_;
  const Vec3 plane_mm_;  // between lattice planes, along each axis
  const double ball_mm_;
  double best_mm_;
  CellCache& cache_;
  std::optional<Vec3> point_;
};

}  // namespace

std::optional<Vec3> NearestPointOnSurface(const HapticSurface& surface, const Vec3& p_D,
                                          double reach_mm, CellCache& cache) noexcept {
  const Vec3 p_I = surface.X_ID.Apply(p_D);
  if (!(p_I.cwiseAbs().maxCoeff() < 1e9)) return std::nullopt;
  const Vec3i middle = p_I.array().floor().cast<int>();
  const double plane_mm = 1.0 / surface.X_ID.linear.rowwise().norm().maxCoeff();
  NearestSearch search(surface, p_D, std::min(reach_mm, MaxNearestMm(surface)), cache);
  for (int radius = 0; radius <= kMaxNearestVoxels + 1; ++radius) {
    // All cells of the shell are at least this far from the middle cell.
    if ((radius - 1) * plane_mm > search.best_mm()) break;
    VisitShell(middle, radius, [&](const Vec3i& cell) { search.Visit(cell); });
  }
  return search.point();
}

}  // namespace palpate
