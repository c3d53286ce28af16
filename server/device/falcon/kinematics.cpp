#include "server/device/falcon/kinematics.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

constexpr double kThighMm = 60.0;
constexpr double kShinMm = 102.5;
constexpr double kLinksMm = 2.0 * 11.25;  // at both ends of the shin
// The offset between base axis and hip minus the offset between grip axis and ankle: along the
// arm's plane (r - c in libnifalcon), and across it (s - f).
constexpr double kAlongMm = 40.0 - 14.43;
constexpr double kAcrossMm = -23.09 + 25.0;
// Angles of the arms' planes about the base's axis: 105°, -15° and -135°.
constexpr double kCos15 = 0.96592582628906829, kSin15 = 0.25881904510252076;
constexpr std::array<double, 3> kArmCos = {-kSin15, kCos15, -0.5 * std::numbers::sqrt2};
constexpr std::array<double, 3> kArmSin = {kCos15, -kSin15, -0.5 * std::numbers::sqrt2};
// The range of an arm's angle.
constexpr double kLowestRad = -0.5 * std::numbers::pi, kHighestRad = 2.0 / 3.0 * std::numbers::pi;

constexpr double kFarMm = 1000.0;

constexpr int kMaxSteps = 24;
constexpr double kLongestStepMm = 30.0, kSolvedMm = 1e-10, kSameAngleRad = 1e-6;

// Position of the grip's end of an arm, relative to its hip: along the arm's plane, across it, away
// from the base.
Vec3 AnkleFromHip(std::size_t arm, const Vec3& p_M_mm) {
  const double c = kArmCos[arm], s = kArmSin[arm];
  return {c * p_M_mm.x() + s * p_M_mm.y() - kAlongMm, c * p_M_mm.y() - s * p_M_mm.x() - kAcrossMm,
          p_M_mm.z() + kFalconBaseToOriginMm};
}

// Turns a direction from the arm's frame into M.
Vec3 FromArm(std::size_t arm, const Vec3& v) {
  const double c = kArmCos[arm], s = kArmSin[arm];
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y(), v.z()};
}

// The torus of an arm. `miss` is 0 on the torus. The derivatives of `miss` are by the position in M
// and by the angle.
struct Torus {
  double miss = 0.0;
  Vec3 by_position = Vec3::Zero();
  double by_angle = 0.0;
};

// Returns false at the knee, where there is no direction.
bool TorusAt(std::size_t arm, const Vec3& p_M_mm, double angle_rad, Torus& torus) {
  const double s = std::sin(angle_rad), c = std::cos(angle_rad);
  const Vec3 ankle = AnkleFromHip(arm, p_M_mm);
  const double along = ankle.x() - kThighMm * c, away = ankle.z() - kThighMm * s;
  const double distance = std::hypot(along, away), tube = distance - kLinksMm;
  if (!(distance > 1.0)) return false;
  torus.miss = tube * tube + ankle.y() * ankle.y() - kShinMm * kShinMm;
  const Vec3 gradient(2.0 * tube * along / distance, 2.0 * ankle.y(), 2.0 * tube * away / distance);
  torus.by_position = FromArm(arm, gradient);
  torus.by_angle = kThighMm * (gradient.x() * s - gradient.z() * c);
  return true;
}

// The tori of all three arms. ArmsAt returns false if they do not fix the position.
struct Arms {
  Vec3 miss = Vec3::Zero();
  Mat3 by_position = Mat3::Zero();
  Vec3 by_angle = Vec3::Zero();
};

bool ArmsAt(const Vec3& p_M_mm, const Vec3& angles_rad, Arms& arms) {
  if (!(p_M_mm.cwiseAbs().maxCoeff() < kFarMm)) return false;
  for (std::size_t n = 0; n < 3; ++n) {
    const auto row = static_cast<Eigen::Index>(n);
    Torus torus;
    if (!TorusAt(n, p_M_mm, angles_rad[row], torus)) return false;
    arms.miss[row] = torus.miss;
    arms.by_position.row(row) = torus.by_position.transpose();
    arms.by_angle[row] = torus.by_angle;
  }
  // Rows are two shins long. The limit is 10^-3 of the greatest volume that they can span.
  return std::abs(arms.by_position.determinant()) > 8e-3 * kShinMm * kShinMm * kShinMm;
}

bool AngleOf(const Vec3& ankle, double& angle_rad) {
  if (!(std::abs(ankle.y()) < kShinMm)) return false;
  const double reach = kLinksMm + std::sqrt(kShinMm * kShinMm - ankle.y() * ankle.y());
  const double distance = std::hypot(ankle.x(), ankle.z());
  const double cosine =
      (distance * distance + kThighMm * kThighMm - reach * reach) / (2.0 * kThighMm * distance);
  if (!(std::abs(cosine) <= 1.0)) return false;
  angle_rad = std::atan2(ankle.z(), ankle.x()) - std::acos(cosine);
  return angle_rad >= kLowestRad && angle_rad <= kHighestRad;
}

// Starts on the base's axis, where three thighs at their mean angle hold the grip.
Vec3 FirstGuess(const Vec3& angles_rad) {
  const double middle_rad = angles_rad.mean();
  const double along = -kAlongMm - kThighMm * std::cos(middle_rad);
  const double reach = kLinksMm + kShinMm;
  const double away =
      kThighMm * std::sin(middle_rad) + std::sqrt(std::max(0.0, reach * reach - along * along));
  return {0.0, 0.0, away - kFalconBaseToOriginMm};
}

}  // namespace

Vec3 FalconAnglesFromCounts(const std::array<std::int16_t, 3>& counts) {
  return Vec3(counts[0], counts[1], counts[2]) * kFalconRadPerCount +
         Vec3::Constant(kFalconAngleAtZeroRad);
}

std::array<std::int16_t, 3> FalconCountsFromAngles(const Vec3& angles_rad) {
  std::array<std::int16_t, 3> counts{};
  for (std::size_t n = 0; n < 3; ++n) {
    const double exact =
        (angles_rad[static_cast<Eigen::Index>(n)] - kFalconAngleAtZeroRad) / kFalconRadPerCount;
    counts[n] = static_cast<std::int16_t>(std::lround(std::clamp(exact, -32768.0, 32767.0)));
  }
  return counts;
}

bool FalconAnglesAt(const Vec3& p_M_mm, Vec3& angles_rad) {
  Vec3 found;
  for (std::size_t n = 0; n < 3; ++n) {
    if (!AngleOf(AnkleFromHip(n, p_M_mm), found[static_cast<Eigen::Index>(n)])) return false;
  }
  angles_rad = found;
  return true;
}

// Solves the three tori by Newton's method. Within the ball of 50 mm it takes 3 to 6 steps.
bool FalconPositionAt(const Vec3& angles_rad, Vec3& p_M_mm) {
  if (!(angles_rad.minCoeff() >= kLowestRad && angles_rad.maxCoeff() <= kHighestRad)) return false;
  Vec3 p = FirstGuess(angles_rad);
  double step_mm = kLongestStepMm;
  for (int n = 0; n < kMaxSteps && step_mm > kSolvedMm; ++n) {
    Arms arms;
    if (!ArmsAt(p, angles_rad, arms)) return false;
    Vec3 step = arms.by_position.inverse() * arms.miss;
    step_mm = step.norm();
    if (step_mm > kLongestStepMm) step *= kLongestStepMm / step_mm;
    p -= step;
  }
  // The tori also cross at a point towards the base. That point needs other angles.
  Vec3 back;
  if (!(step_mm <= kSolvedMm) || !FalconAnglesAt(p, back)) return false;
  if (!((back - angles_rad).cwiseAbs().maxCoeff() <= kSameAngleRad)) return false;
  p_M_mm = p;
  return true;
}

bool FalconJacobianAt(const Vec3& p_M_mm, const Vec3& angles_rad, Mat3& jacobian) {
  Arms arms;
  if (!ArmsAt(p_M_mm, angles_rad, arms)) return false;
  jacobian = -(arms.by_position.inverse() * arms.by_angle.asDiagonal());
  return true;
}

std::array<std::int16_t, 3> FalconMotorsFromTorques(const Vec3& torques_n_mm) {
  Vec3 counts = kFalconMotorCountsPerNmm * torques_n_mm;
  if (!counts.allFinite()) return {};
  const double greatest = counts.cwiseAbs().maxCoeff();
  if (greatest > kFalconMotorLimit) counts *= kFalconMotorLimit / greatest;
  std::array<std::int16_t, 3> motors{};
  for (std::size_t n = 0; n < 3; ++n) {
    motors[n] = static_cast<std::int16_t>(std::lround(counts[static_cast<Eigen::Index>(n)]));
  }
  return motors;
}

}  // namespace palpate
