#include "server/lab/triangle_distance.h"

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

}  // namespace palpate::lab
