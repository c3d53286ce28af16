#include "server/device/omni/kinematics.h"

#include <cmath>

namespace palpate {
namespace {

// Position of the crossing of the base's and the shoulder's axes, from M's origin.
constexpr double kRiseMm = 23.35;
constexpr double kBackMm = 168.35;

}  // namespace

OmniJoints OmniJointsFromCounts(const std::array<std::int16_t, 3>& counts) {
  return {.base_rad = counts[0] * kOmniRadPerCount,
          .shoulder_rad = -counts[1] * kOmniRadPerCount,
          .elbow_rad = counts[2] * kOmniRadPerCount};
}

Vec3 OmniPosition(const OmniJoints& joints) {
  const double reach_mm =
      kOmniLinkMm * (std::cos(joints.shoulder_rad) + std::sin(joints.elbow_rad));
  const double height_mm =
      kOmniLinkMm * (std::sin(joints.shoulder_rad) - std::cos(joints.elbow_rad));
  return {-std::sin(joints.base_rad) * reach_mm, height_mm + kRiseMm,
          std::cos(joints.base_rad) * reach_mm - kBackMm};
}

Eigen::Quaterniond OmniOrientation(const OmniJoints& joints,
                                   const std::array<double, 3>& gimbal_rad) {
  using Turn = Eigen::AngleAxisd;
  const Turn base(-joints.base_rad, Vec3::UnitY()), link(-joints.elbow_rad, Vec3::UnitX());
  const Turn yaw(gimbal_rad[0], Vec3::UnitY()), pitch(gimbal_rad[1], Vec3::UnitX());
  return (base * link * yaw * pitch * Turn(gimbal_rad[2], Vec3::UnitZ())).normalized();
}

Mat3 OmniJacobian(const OmniJoints& joints) {
  const double s1 = std::sin(joints.base_rad), c1 = std::cos(joints.base_rad);
  const double s2 = std::sin(joints.shoulder_rad), c2 = std::cos(joints.shoulder_rad);
  const double s3 = std::sin(joints.elbow_rad), c3 = std::cos(joints.elbow_rad);
  const double reach = c2 + s3;
  Mat3 jacobian;
  jacobian << -c1 * reach, s1 * s2, -s1 * c3,  //
      0.0, c2, s3,                             //
      -s1 * reach, -c1 * s2, c1 * c3;
  return kOmniLinkMm * jacobian;
}

Vec3 OmniTorques_n_mm(const OmniJoints& joints, const Vec3& force_M_n) {
  return OmniJacobian(joints).transpose() * force_M_n;
}

}  // namespace palpate
