#include "server/haptics/cone.h"

namespace palpate {
namespace {

// A direction counts as inside a half-space up to this share of its length. Otherwise rounding
// could reject the one face of the cone that holds the projection.
constexpr double kInsideTolerance = 1e-12;

// If the projection on a plane is inside all other half-spaces by more than this share of |w| (both
// squared), it is the cone's: all others are shorter by as much.
constexpr double kClearOfOthers2 = 1e-8;
// By how much of |w|² a projection on an edge may be longer than one on a plane: more than rounding
// and kInsideTolerance admit.
constexpr double kLengthRounding = 1e-11;

enum class Side : std::uint8_t { kOutside, kInside, kClear };

// Where `d` lies among the half-spaces other than the active ones.
Side SideOf(const Vec3& d, double length2, double w2, const Cone& cone, unsigned active) {
  Side side = Side::kClear;
  for (int i = 0; i < cone.count; ++i) {
    if (active >> i & 1) continue;
    const auto& [normal, normal2] = cone.side[i];
    const double inside = normal.dot(d);
    if (inside > 0.0 && inside * inside > kClearOfOthers2 * w2 * normal2) continue;
    side = Side::kInside;
    if (inside >= 0.0) continue;
    const double tolerance2 = kInsideTolerance * kInsideTolerance * length2;
    if (inside * inside > tolerance2 * normal2) return Side::kOutside;
  }
  return side;
}

}  // namespace

// The projection is the longest of the projections on the cone's faces (the inside, planes, edges,
// apex) that lie in the cone. Each of them is orthogonal to its difference from w, so the longest
// is the closest. None is longer than the projection on a violated plane.
ConeProjection ProjectOnCone(const Vec3& w, const Cone& cone, double longer_than2) noexcept {
  std::array<double, 4> along;
  unsigned violated = 0;
  for (int i = 0; i < cone.count; ++i) {
    along[i] = cone.side[i].normal.dot(w);
    if (along[i] < 0.0) violated |= 1u << i;
  }
  const double w2 = w.squaredNorm();
  if (violated == 0) return w2 > longer_than2 ? ConeProjection{w, 0} : ConeProjection{};
  ConeProjection best;
  double best2 = longer_than2;
  // Returns the side on which `d` lies if it is the longest so far.
  const auto consider = [&](const Vec3& d, double length2, unsigned active) {
    if (!(length2 > best2)) return Side::kOutside;
    const Side side = SideOf(d, length2, w2, cone, active);
    if (side != Side::kOutside) best = {d, static_cast<std::uint8_t>(active)}, best2 = length2;
    return side;
  };
  for (int i = 0; i < cone.count; ++i) {
    if (!(violated >> i & 1)) continue;
    const auto& [normal, normal2] = cone.side[i];
    const Vec3 d = w - (along[i] / normal2) * normal;
    const double length2 = d.squaredNorm();
    if (length2 < longer_than2 - kLengthRounding * w2) return {};
    if (consider(d, length2, 1u << i) == Side::kClear) return best;
  }
  for (int i = 0; i < cone.count; ++i) {
    for (int j = i + 1; j < cone.count; ++j) {
      const Vec3 edge = cone.side[i].normal.cross(cone.side[j].normal);
      const double edge2 = edge.squaredNorm();
      if (!(edge2 > 0.0)) continue;
      const Vec3 d = edge * (edge.dot(w) / edge2);
      consider(d, d.squaredNorm(), 1u << i | 1u << j);
    }
  }
  return best;
}

}  // namespace palpate
