// Hands that hold an emulated device of Force Dimension or Haply: where it is and what it feels, in
// frame M (mm, N; x right, y up, z towards the user), by each vendor's published axes. Apart from
// the drivers that they judge.
#pragma once

#include <Eigen/Dense>

#include "tests/support/fake_drd.h"
#include "tests/support/haply_service.h"

namespace palpate::test {

// x towards the user, y to the user's right, z up.
class ForceDimensionHand {
 public:
  explicit ForceDimensionHand(FakeDrdDevice& device) : device_(device) {}

  void Place(const Eigen::Vector3d& p_mm) {
    device_.position[0] = p_mm.z() / 1000.0;
    device_.position[1] = p_mm.x() / 1000.0;
    device_.position[2] = p_mm.y() / 1000.0;
  }
  // By an angle about an axis of the vendor's.
  void Turn(double angle_rad, const Eigen::Vector3d& axis) {
    const Eigen::Matrix3d R = Eigen::AngleAxisd(angle_rad, axis).toRotationMatrix();
    for (int n = 0; n < 9; ++n) device_.rotation.at(static_cast<std::size_t>(n)) = R(n / 3, n % 3);
  }
  void Press(unsigned int buttons) { device_.buttons = buttons; }
  Eigen::Vector3d FeltTorque_n_mm() const {
    if (device_.IsBraked(FakeDrdNowNs()) || !device_.commanded) return Eigen::Vector3d::Zero();
    return 1000.0 * Eigen::Vector3d(device_.torque[1], device_.torque[2], device_.torque[0]);
  }
  Eigen::Vector3d Felt_n() const {
    const std::int64_t now_ns = FakeDrdNowNs();
    return {device_.FeltForceN(1, now_ns), device_.FeltForceN(2, now_ns),
            device_.FeltForceN(0, now_ns)};
  }

 private:
  FakeDrdDevice& device_;
};

// x right, y away from the user, z up; the middle of the workspace is that of the vendor's samples.
class HaplyHand {
 public:
  explicit HaplyHand(HaplyService& service) : service_(service) {}

  void Place(const Eigen::Vector3d& p_mm) {
    service_.Set(
        {{"cursor_position",
          {0.019 + p_mm.x() / 1000.0, -0.153 - p_mm.z() / 1000.0, 0.151 + p_mm.y() / 1000.0}}});
  }
  void Turn(double angle_rad, const Eigen::Vector3d& axis) {
    const Eigen::Quaterniond q(Eigen::AngleAxisd(angle_rad, axis));
    service_.Set({{"orientation", {{"w", q.w()}, {"x", q.x()}, {"y", q.y()}, {"z", q.z()}}}});
  }
  void Press(unsigned int buttons) {
    service_.Set(
        {{"buttons",
          {{"a", (buttons & 1u) != 0}, {"b", (buttons & 2u) != 0}, {"c", (buttons & 4u) != 0}}}});
  }
  Eigen::Vector3d Felt_n() {
    const nlohmann::json felt = service_.Report()["felt_force"];
    return {felt[0].get<double>(), felt[2].get<double>(), -felt[1].get<double>()};
  }

 private:
  HaplyService& service_;
};

}  // namespace palpate::test
