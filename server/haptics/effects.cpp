#include "server/haptics/effects.h"

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

namespace {

// Gradient of the felt density, as stored, at a vertex, by central differences. The padding is
// flat.
Vec3 VertexGradient(const VolumeSnapshot& volume, const Vec3i& vertex) {
  Vec3 gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3i step = Vec3i::Unit(axis);
    gradient[axis] =
        0.5 * (volume.StoredVertex(vertex + step) - volume.StoredVertex(vertex - step));
  }
  return gradient;
}

// Turns `wanted` to at most kMaxShadingAngleRad from `normal`. Both are unit vectors.
Vec3 WithinReach(const Vec3& wanted, const Vec3& normal) {
  const double cosine = wanted.dot(normal);
  if (cosine >= std::cos(kMaxShadingAngleRad)) return wanted;
  const Vec3 across = wanted - cosine * normal;
  const double length = across.norm();
  if (!(length > 0.0)) return normal;
  return std::cos(kMaxShadingAngleRad) * normal + (std::sin(kMaxShadingAngleRad) / length) * across;
}

}  // namespace

Vec3 ShadedNormal(const HapticSurface& surface, const Vec3& p_I, const Vec3& normal_D) noexcept {
  const Vec3i cell = p_I.array().floor().cast<int>();
  const Vec3 local = p_I - cell.cast<double>();
  Vec3 gradient_I = Vec3::Zero();
  for (const auto& o : kCornerOffset) {
    const double share = (o[0] ? local.x() : 1.0 - local.x()) *
                         (o[1] ? local.y() : 1.0 - local.y()) *
                         (o[2] ? local.z() : 1.0 - local.z());
    gradient_I += share * VertexGradient(*surface.volume, cell + Vec3i(o[0], o[1], o[2]));
  }
  const Vec3 down_D = -surface.sign() * (surface.X_ID.linear.transpose() * gradient_I);
  const double length = down_D.norm();
  return length > 0.0 ? WithinReach(down_D / length, normal_D) : normal_D;
}

namespace {

constexpr double kMmPerM = 1000.0;

// Turns v as the least rotation from one unit vector to another does (Rodrigues). The two vectors
// are not opposite: a shaded normal is at most kMaxShadingAngleRad away. Eigen's
// Quaternion::FromTwoVectors also handles opposite ones, and takes 15 s to compile for them.
Vec3 TurnedFromTo(const Vec3& from, const Vec3& to, const Vec3& v) {
  const Vec3 axis = from.cross(to);
  const double cosine = from.dot(to);
  return cosine * v + axis.cross(v) + axis.dot(v) / (1.0 + cosine) * axis;
}

}  // namespace

Vec3 ContactForce(const HapticLayer& layer, const ProxyStep& step, const Vec3& normal_D,
                  const Vec3& spring_D_n, const Vec3& velocity_mm_per_s) noexcept {
  const double spring_n = std::max(0.0, spring_D_n.dot(step.normal_D));
  const double damper_n = -layer.damping_n_s_per_m / kMmPerM * velocity_mm_per_s.dot(normal_D);
  // Limited to the spring's force, so that the force stays continuous at contact.
  const Vec3 force = (spring_n + std::clamp(damper_n, -spring_n, spring_n)) * normal_D;
  if (!layer.has_friction()) return force;
  const Vec3 lean = spring_D_n - spring_D_n.dot(step.normal_D) * step.normal_D;
  return force + TurnedFromTo(step.normal_D, normal_D, lean);
}

Vec3 ViscousForce(double viscosity_n_s_per_m, const Vec3& velocity_mm_per_s) noexcept {
  return -viscosity_n_s_per_m / kMmPerM * velocity_mm_per_s;
}

Vec3 MagneticForce(const HapticSurface& surface, const HapticSettings& settings, const Vec3& p_D,
                   CellCache& cache) noexcept {
  if (!(settings.magnet_force_n > 0.0 && settings.magnet_range_mm > 0.0)) return Vec3::Zero();
  const double range_mm = std::min(settings.magnet_range_mm, MaxNearestMm(surface));
  const auto nearest = NearestPointOnSurface(surface, p_D, range_mm, cache);
  if (!nearest) return Vec3::Zero();
  const Vec3 way_mm = *nearest - p_D;
  const double share = way_mm.norm() / range_mm;
  if (!(share > 0.0)) return Vec3::Zero();
  // The force is 4 share (1 - share) along the unit way.
  return way_mm * (settings.magnet_force_n * 4.0 * (1.0 - share) / range_mm);
}

}  // namespace palpate
