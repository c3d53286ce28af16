#include "server/haptics/cone.h"

namespace palpate {
namespace {

// A direction counts as inside a half-space up to this share of its length. Otherwise rounding
// could reject the one face of the cone that holds the projection.
constexpr double kInsideTolerance = 1e-12;

bool IsInside(const Vec3& d, double length2, const Cone& cone, std::uint8_t active) {
  for (int i = 0; i < cone.count; ++i) {
    if (active >> i & 1) continue;
    const double inside = cone.normal[i].dot(d);
    if (inside >= 0.0) continue;
    const double tolerance2 = kInsideTolerance * kInsideTolerance * length2;
    if (inside * inside > tolerance2 * cone.normal[i].squaredNorm()) return false;
  }
  return true;
}

}  // namespace

// The projection is the longest of the projections on the cone's faces (the inside, planes, edges,
// apex) that lie in the cone. Each of them is orthogonal to its difference from w, so the longest
// is the closest.
ConeProjection ProjectOnCone(const Vec3& w, const Cone& cone) noexcept {
  std::uint8_t violated = 0;
  for (int i = 0; i < cone.count; ++i) {
    if (cone.normal[i].dot(w) < 0.0) violated |= static_cast<std::uint8_t>(1u << i);
  }
  if (violated == 0) return {w, 0};
  ConeProjection best;
  double best_length2 = 0.0;
  const auto consider = [&](const Vec3& d, unsigned active) {
    const double length2 = d.squaredNorm();
    const auto mask = static_cast<std::uint8_t>(active);
    if (length2 > best_length2 && IsInside(d, length2, cone, mask)) {
      best = {d, mask}, best_length2 = length2;
    }
  };
  for (int i = 0; i < cone.count; ++i) {
    if (!(violated >> i & 1)) continue;
    const Vec3& normal = cone.normal[i];
    consider(w - (normal.dot(w) / normal.squaredNorm()) * normal, 1u << i);
  }
  for (int i = 0; i < cone.count; ++i) {
    for (int j = i + 1; j < cone.count; ++j) {
      const Vec3 edge = cone.normal[i].cross(cone.normal[j]);
      const double length2 = edge.squaredNorm();
      if (length2 > 0.0) consider(edge * (edge.dot(w) / length2), 1u << i | 1u << j);
    }
  }
  return best;
}

}  // namespace palpate
