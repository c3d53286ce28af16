#include "server/lab/triangle_grid.h"

#include <algorithm>
#include <cmath>

namespace palpate::lab {
namespace {

double SquaredDistanceToSegment(const Vec3& p, const Vec3& a, const Vec3& b) {
  const Vec3 along = b - a;
  const double length = along.squaredNorm();
  const double share = length > 0.0 ? std::clamp((p - a).dot(along) / length, 0.0, 1.0) : 0.0;
  return (p - a - share * along).squaredNorm();
}

// Returns false for a sliver whose volume is no more than rounding. Its faces are then as near as
// its inside.
bool IsInside(const Vec3& p, const std::array<Vec3, 4>& corner) {
  constexpr double kRounding = 1e-14;
  for (int n = 0; n < 4; ++n) {
    const Vec3& a = corner[(n + 1) % 4];
    const Vec3 b = corner[(n + 2) % 4] - a, c = corner[(n + 3) % 4] - a, d = corner[n] - a;
    const Vec3 normal = b.cross(c);
    const double volume = d.dot(normal);
    if (!(std::abs(volume) > kRounding * b.norm() * c.norm() * d.norm())) return false;
    // From the nearest corner: where the face is thin, its normal is inexact.
    const Vec3 q = p - a;
    const Vec3 way = std::min({q, Vec3(q - b), Vec3(q - c)}, [](const Vec3& l, const Vec3& r) {
      return l.squaredNorm() < r.squaredNorm();
    });
    if (!(way.dot(normal) * volume > 0.0)) return false;
  }
  return true;
}

}  // namespace

double SquaredDistanceToTriangle(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  // The foot on a sliver is inexact, but then an edge of the sliver is just as near.
  double nearest = std::min({SquaredDistanceToSegment(p, a, b), SquaredDistanceToSegment(p, b, c),
                             SquaredDistanceToSegment(p, c, a)});
  const Vec3 u = b - a, v = c - a, w = p - a;
  const double uu = u.dot(u), uv = u.dot(v), vv = v.dot(v), uw = u.dot(w), vw = v.dot(w);
  const double determinant = uu * vv - uv * uv;
  if (!(determinant > 0.0)) return nearest;
  const double s = (vv * uw - uv * vw) / determinant, t = (uu * vw - uv * uw) / determinant;
  if (s >= 0.0 && t >= 0.0 && s + t <= 1.0) {
    nearest = std::min(nearest, (w - s * u - t * v).squaredNorm());
  }
  return nearest;
}

double SquaredDistanceToTetrahedron(const Vec3& p, const std::array<Vec3, 4>& corner) {
  if (IsInside(p, corner)) return 0.0;
  double nearest = SquaredDistanceToTriangle(p, corner[0], corner[1], corner[2]);
  for (int n = 0; n < 3; ++n) {
    nearest =
        std::min(nearest, SquaredDistanceToTriangle(p, corner[n], corner[(n + 1) % 3], corner[3]));
  }
  return nearest;
}

namespace {

constexpr double kEdgeVoxels = 2.0;
constexpr double kMostBoxes = 1 << 24;
// A point next to the side of a box may be listed in the next one.
constexpr double kRounding = 1e-9;  // relative to the edge of a box

// Calls visit(box) for all boxes from low to high.
template <class Visitor>
void VisitBoxes(const Vec3i& low, const Vec3i& high, Visitor visit) {
  for (int x = low.x(); x <= high.x(); ++x) {
    for (int y = low.y(); y <= high.y(); ++y) {
      for (int z = low.z(); z <= high.z(); ++z) visit(Vec3i(x, y, z));
    }
  }
}

// Distance to the box around a triangle. It is never larger than the distance to the triangle, and
// faster to compute.
double SquaredDistanceToBox(const Vec3& p, const Vec3& a, const Vec3& b, const Vec3& c) {
  const Vec3 below = a.cwiseMin(b).cwiseMin(c) - p, above = p - a.cwiseMax(b).cwiseMax(c);
  return below.cwiseMax(above).cwiseMax(0.0).squaredNorm();
}

}  // namespace

TriangleGrid::TriangleGrid(const SurfaceMesh& mesh, const AffineMap& X_DI)
    : triangles_(mesh.triangles), edge_mm_(kEdgeVoxels * X_DI.linear.colwise().norm().maxCoeff()) {
  vertices_mm_.reserve(mesh.vertices.size());
  for (const Vec3& vertex : mesh.vertices) vertices_mm_.push_back(X_DI.Apply(vertex));
  if (triangles_.empty()) return;
  Vec3 high_mm = low_mm_ = vertices_mm_[0];
  for (const Vec3& vertex : vertices_mm_) {
    low_mm_ = low_mm_.cwiseMin(vertex);
    high_mm = high_mm.cwiseMax(vertex);
  }
  const Vec3 extent_mm = high_mm - low_mm_;
  while (((extent_mm / edge_mm_).array() + 1.0).prod() > kMostBoxes) edge_mm_ *= 1.25;
  count_ = (extent_mm / edge_mm_).array().floor().matrix().cast<int>() + Vec3i::Ones();
  Sort();
}

Vec3i TriangleGrid::BoxAt(const Vec3& p_mm) const {
  const Vec3 box = ((p_mm - low_mm_) / edge_mm_).array().floor();
  return box.cwiseMax(Vec3::Zero()).cwiseMin((count_ - Vec3i::Ones()).cast<double>()).cast<int>();
}

std::size_t TriangleGrid::IndexOf(const Vec3i& box) const {
  return (static_cast<std::size_t>(box.x()) * static_cast<std::size_t>(count_.y()) +
          static_cast<std::size_t>(box.y())) *
             static_cast<std::size_t>(count_.z()) +
         static_cast<std::size_t>(box.z());
}

// A counting sort: first computes the ends of the lists, then fills each list from the back.
void TriangleGrid::Sort() {
  const auto visit = [this](const std::array<std::uint32_t, 3>& triangle, auto each) {
    const Vec3 &a = vertices_mm_[triangle[0]], &b = vertices_mm_[triangle[1]],
               &c = vertices_mm_[triangle[2]];
    VisitBoxes(BoxAt(a.cwiseMin(b).cwiseMin(c)), BoxAt(a.cwiseMax(b).cwiseMax(c)),
               [&](const Vec3i& box) { each(IndexOf(box)); });
  };
  first_.assign(IndexOf(count_ - Vec3i::Ones()) + 2, 0);
  for (const auto& triangle : triangles_) visit(triangle, [&](std::size_t box) { ++first_[box]; });
  for (std::size_t box = 1; box < first_.size(); ++box) first_[box] += first_[box - 1];
  listed_.resize(first_.back());
  for (std::size_t t = 0; t < triangles_.size(); ++t) {
    visit(triangles_[t],
          [&](std::size_t box) { listed_[--first_[box]] = static_cast<std::uint32_t>(t); });
  }
}

double TriangleGrid::NearestInBox(const Vec3i& box, const Vec3& p_mm,
                                  double nearest_squared) const {
  const std::size_t index = IndexOf(box);
  if (first_[index] == first_[index + 1]) return nearest_squared;
  const Vec3 middle_mm = low_mm_ + edge_mm_ * (box.cast<double>() + Vec3::Constant(0.5));
  const double half_mm = edge_mm_ * (0.5 + kRounding);
  const Vec3 beyond_mm = ((p_mm - middle_mm).array().abs() - half_mm).max(0.0);
  if (beyond_mm.squaredNorm() > nearest_squared) return nearest_squared;
  for (std::uint32_t n = first_[index]; n < first_[index + 1]; ++n) {
    const auto& triangle = triangles_[listed_[n]];
    const Vec3 &a = vertices_mm_[triangle[0]], &b = vertices_mm_[triangle[1]],
               &c = vertices_mm_[triangle[2]];
    if (SquaredDistanceToBox(p_mm, a, b, c) > (1.0 + kRounding) * nearest_squared) continue;
    nearest_squared = std::min(nearest_squared, SquaredDistanceToTriangle(p_mm, a, b, c));
  }
  return nearest_squared;
}

double TriangleGrid::NearestOnShell(const Vec3i& middle, int radius, const Vec3& p_mm,
                                    double nearest_squared) const {
  const Vec3i low = (middle.array() - radius).matrix();
  const Vec3i high = (middle.array() + radius).matrix();
  const auto look = [&](const Vec3i& box) {
    nearest_squared = NearestInBox(box, p_mm, nearest_squared);
  };
  // Visits slabs normal to x, then to y and z; each slab leaves out the boxes already visited.
  Vec3i from = low.cwiseMax(0), to = high.cwiseMin(count_ - Vec3i::Ones());
  for (int axis = 0; axis < 3; ++axis) {
    const int first = from[axis], last = to[axis];
    for (int side : {low[axis], high[axis]}) {
      if (side < 0 || side >= count_[axis] || (radius == 0 && axis > 0)) continue;
      from[axis] = to[axis] = side;
      VisitBoxes(from, to, look);
      if (radius == 0) break;
    }
    from[axis] = std::max(first, low[axis] + 1);
    to[axis] = std::min(last, high[axis] - 1);
  }
  return nearest_squared;
}

double TriangleGrid::Distance(const Vec3& p_mm, double limit_mm) const {
  if (triangles_.empty()) return limit_mm;
  const Vec3i middle = BoxAt(p_mm);
  double nearest_squared = limit_mm * limit_mm;
  // Everything beyond a shell of boxes is at least the shell's radius away. This also holds for a
  // point outside the grid: its foot on the grid is nearer to everything in the grid.
  for (int radius = 0; radius < count_.maxCoeff(); ++radius) {
    const double beyond_mm = (radius - 1) * edge_mm_;
    if (radius > 0 && beyond_mm * beyond_mm >= nearest_squared) break;
    nearest_squared = NearestOnShell(middle, radius, p_mm, nearest_squared);
  }
  return std::sqrt(nearest_squared);
}

}  // namespace palpate::lab
