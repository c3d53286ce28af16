// A hand that holds an emulated Phantom Omni: where its arm stands for a place of the stylus, and
// what force the motors' counts are on the hand. Written from the published formulas, apart from
// the driver that it judges.
//
// Frame M: mm, x right, y up, z towards the user; N. Angles in rad.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <cmath>

#include "tests/support/omni_firewire_emulator.h"

namespace palpate::test {

class OmniStand {
 public:
  // Counts of the motors per N mm, which the driver is given.
  static constexpr std::array<double, 3> kGains = {2.0, -3.0, 4.0};
  // Where the encoders stand in the dock: they count from anywhere.
  static constexpr std::array<int, 3> kDockCounts = {120, -340, 560};
  static inline const Eigen::Vector3d kRest{0.0, -20.0, 10.0};

  static OmniHand Docked() { return {.encoders = kDockCounts, .docked = true}; }

  static OmniHand At(const Eigen::Vector3d& p_mm) {
    const double z = p_mm.z() + 168.35, reach = std::hypot(p_mm.x(), z), up = p_mm.y() - 23.35;
    const double middle = std::atan2(up, reach);
    const double half = std::acos(0.5 * std::hypot(reach, up) / kLinkMm);
    // In the dock the shoulder is at 0.23 rad and the elbow at -0.37 rad.
    const std::array<double, 3> turned = {std::atan2(-p_mm.x(), z), middle + half - 0.23,
                                          middle - half + M_PI / 2 + 0.37};
    const auto counts = [](double rad) {
      return static_cast<int>(std::lround(rad * 15000.0 / (2.0 * M_PI)));
    };
    return {.encoders = {kDockCounts[0] + counts(turned[0]), kDockCounts[1] - counts(turned[1]),
                         kDockCounts[2] + counts(turned[2])}};
  }

  // The force on a hand at this place.
  static Eigen::Vector3d ForceOf(const std::array<int, 3>& motors, const Eigen::Vector3d& p_mm) {
    const double z = p_mm.z() + 168.35, reach = std::hypot(p_mm.x(), z), up = p_mm.y() - 23.35;
    const double middle = std::atan2(up, reach);
    const double half = std::acos(0.5 * std::hypot(reach, up) / kLinkMm);
    const Eigen::Vector3d joints(std::atan2(-p_mm.x(), z), middle + half, middle - half + M_PI / 2);
    Eigen::Matrix3d jacobian;
    constexpr double kStep = 1e-6;
    for (int n = 0; n < 3; ++n) {
      Eigen::Vector3d step = Eigen::Vector3d::Zero();
      step[n] = kStep;
      jacobian.col(n) = (PlaceOf(joints + step) - PlaceOf(joints - step)) / (2.0 * kStep);
    }
    const Eigen::Vector3d torques(motors[0] / kGains[0], motors[1] / kGains[1],
                                  motors[2] / kGains[2]);
    return jacobian.transpose().inverse() * torques;
  }

 private:
  static constexpr double kLinkMm = 133.35;

  static Eigen::Vector3d PlaceOf(const Eigen::Vector3d& t) {
    const double reach = kLinkMm * (std::cos(t[1]) + std::sin(t[2]));
    return {-std::sin(t[0]) * reach, kLinkMm * (std::sin(t[1]) - std::cos(t[2])) + 23.35,
            std::cos(t[0]) * reach - 168.35};
  }
};

}  // namespace palpate::test
