#include "server/device/omni/omni_arm.h"

#include <algorithm>
#include <cmath>

#include "common/error/error.h"

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

namespace {

// One second. Counts farther apart belong to another count or are damaged.
constexpr std::uint32_t kLongestGap = 1000;

}  // namespace

DeviceDescription OmniArmSpec(bool has_motors) {
  DeviceDescription spec;
  spec.workspace_min_mm = Vec3(-80.0, -60.0, -35.0);
  spec.workspace_max_mm = Vec3(80.0, 60.0, 35.0);
  if (has_motors) {
    spec.max_force_n = 3.3;
    spec.continuous_force_n = 0.88;
    // CHAI3D regards 0.4 to 0.7 as safe.
    spec.max_stiffness_n_per_mm = 0.5;
  }
  spec.position_resolution_mm = 0.055;
  spec.button_count = 2;
  spec.senses_orientation = true;
  return spec;
}

OmniArm::OmniArm(const std::optional<Gains>& motor_counts_per_n_mm)
    : motor_counts_per_n_mm_(motor_counts_per_n_mm) {
  for (const double counts : motor_counts_per_n_mm.value_or(Gains{})) {
    if (std::abs(counts) <= kOmniMaxMotorGain) continue;
    throw Error(
        ErrorKind::kInvalidArgument,
        "`motor_counts_per_n_mm` must be from -10 to 10: more saturates the motors at once");
  }
}

void OmniArm::Forget() noexcept {
  joints_ = {};
  zero_ = {};
  calibrated_ = false;
  rest_readings_ = 0;
  calibration_wanted_ = false;
  counter_.reset();
}

bool OmniArm::Continues(const OmniState& reading) const noexcept {
  return !counter_ || reading.counter - *counter_ <= kLongestGap;
}

std::optional<std::uint32_t> OmniArm::Take(const OmniState& reading, DeviceState& state) noexcept {
  if (reading.counter == counter_) return std::nullopt;
  // Wraps together with the counter.
  const std::uint32_t gap = counter_ ? reading.counter - *counter_ : 1;
  counter_ = reading.counter;
  Calibrate(reading);
  std::array<std::int16_t, 3> counts{};
  for (std::size_t n = 0; n < 3; ++n) {
    // Also right if the encoder wraps: no joint turns by half of the encoder's range.
    counts[n] = static_cast<std::int16_t>(reading.encoders[n] - zero_[n]);
  }
  joints_ = OmniJointsFromCounts(counts);
  joints_.shoulder_rad += kOmniDock.shoulder_rad;
  joints_.elbow_rad += kOmniDock.elbow_rad;
  state = {.p_MHip_mm = OmniPosition(joints_),
           .R_MS = OmniOrientation(joints_, reading.gimbal_rad),
           .buttons = (reading.buttons[0] ? 1u : 0u) | (reading.buttons[1] ? 2u : 0u),
           .docked = reading.docked,
           .calibrated = calibrated_};
  return gap <= kLongestGap ? gap - 1 : 0;
}

// One frame is not enough, because frames have no checksum and the stylus may still be sliding in.
void OmniArm::Calibrate(const OmniState& reading) noexcept {
  if (calibration_wanted_.exchange(false)) calibrated_ = false;
  if (!reading.docked || reading.encoders != docked_at_) rest_readings_ = 0;
  docked_at_ = reading.encoders;
  if (!reading.docked) return;
  rest_readings_ = std::min(rest_readings_ + 1, kOmniRestReadings);
  if (rest_readings_ < kOmniRestReadings) return;
  zero_ = reading.encoders;
  calibrated_ = true;
}

// If a count exceeds the motors' range, all three are scaled down, so that the force keeps its
// direction.
OmniForce OmniArm::ForceOf(const Vec3& force_M_n, bool forces_on) const noexcept {
  if (!forces_on || !calibrated_ || !motor_counts_per_n_mm_) return {};
  const auto& gains = *motor_counts_per_n_mm_;
  Vec3 counts =
      OmniTorques_n_mm(joints_, force_M_n).cwiseProduct(Vec3(gains[0], gains[1], gains[2]));
  if (!counts.allFinite()) return {};
  const double largest = counts.cwiseAbs().maxCoeff();
  if (largest > kOmniMotorRange) counts *= kOmniMotorRange / largest;
  const auto whole = [](double count) { return static_cast<int>(std::lround(count)); };
  return {.motors = {whole(counts[0]), whole(counts[1]), whole(counts[2])}, .force_enabled = true};
}

}  // namespace palpate
