#include "server/haptics/tool/rigid_tool.h"

#include <cmath>

namespace palpate {
namespace {

// tan(x / 2) / (x / 2), for a rotation by x: from its vector to Cayley's. Rounding above 2e-12 at
// kLongestTurnRad.
double TangentRatio(double x2) {
  return 1.0 +
         x2 * (1.0 / 12 + x2 * (1.0 / 120 + x2 * (17.0 / 20160 +
                                                  x2 * (31.0 / 362880 + x2 * (691.0 / 79833600)))));
}

// atan(t) / t, up to t = tan(π / 16).
double ArcTangentRatio(double t2) {
  double sum = 0.0;
  for (int n = 12; n >= 0; --n) sum = 1.0 / (2 * n + 1) - t2 * sum;
  return sum;
}

// The half of a rotation: the root of its unit quaternion, whose real part is not negative.
Eigen::Quaterniond Half(const Eigen::Quaterniond& q) {
  Eigen::Quaterniond half(1.0 + q.w(), q.x(), q.y(), q.z());
  half.normalize();
  return half;
}

}  // namespace

ToolPose Moved(const ToolPose& pose, const ToolMove& move) noexcept {
  const Vec3 cayley = 0.5 * TangentRatio(move.turn_rad.squaredNorm()) * move.turn_rad;
  const Eigen::Quaterniond turn(1.0, cayley.x(), cayley.y(), cayley.z());
  ToolPose moved{pose.p_DS_mm + move.way_mm, turn * pose.R_DS};
  moved.R_DS.normalize();
  return moved;
}

ToolMove MoveBetween(const ToolPose& from, const ToolPose& to) noexcept {
  Eigen::Quaterniond q = to.R_DS * from.R_DS.conjugate();
  if (q.w() < 0.0) q.coeffs() = -q.coeffs();
  // An eighth of the rotation has a small tangent: q's angle is half the rotation's.
  const Eigen::Quaterniond eighth = Half(Half(Half(q)));
  const Vec3 tangent = eighth.vec() / eighth.w();
  return {to.p_DS_mm - from.p_DS_mm, 16.0 * ArcTangentRatio(tangent.squaredNorm()) * tangent};
}

}  // namespace palpate
