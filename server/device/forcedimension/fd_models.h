// Force Dimension's models: what each can do, and where the middle of its workspace is.
//
// Frame: the library's (fd_api.h); M: mm, x right, y up, z towards the user.
// Threads: pure functions. Errors: FdModelOf throws Error (kInvalidArgument).
// Source: the figures in CHAI3D's driver. Limits of force and torque are our caution.
#pragma once

#include <Eigen/Dense>
#include <array>
#include <string>
#include <string_view>

#include "common/geometry/wrench.h"
#include "server/device/haptic_device.h"

namespace palpate {

inline constexpr VerificationLevel kForceDimensionVerification = VerificationLevel::kNone;

struct FdModel {
  std::string_view name{};  // "omega.6"
  double radius_mm = 0.0;
  double motor_force_n = 0.0;  // what the motors can do, gravity compensation included
  bool has_wrist = false;      // it measures how the handle is turned
  bool has_torque = false;     // the wrist has motors
  bool has_gripper = false;
  bool moves_to_calibrate = false;  // by itself; others are calibrated by hand
  const char* calibration_hint = "";

  std::string_view family() const { return name.substr(0, name.find('.')); }
};

const FdModel& FdModelOf(std::string_view name);
// "delta.3, omega.3 or ..."
std::string FdModelNames();

// What the library says of a device.
struct FdAbilities {
  std::string system_name{};
  bool has_wrist = false;
  bool has_torque = false;
  bool has_gripper = false;
  bool is_left_handed = false;
};
// The model with these abilities, of the family in the system's name; null: none that we know.
const FdModel* FdModelWith(const FdAbilities& abilities);

DeviceDescription FdSpec(const FdModel& model);

// The middle of the workspace, in m.
Vec3 FdCentre(const FdModel& model, bool is_left_handed);

// The library's axes in M. A rotation: nothing is mirrored.
inline Vec3 FdToM(const Vec3& v) { return {v.y(), v.z(), v.x()}; }
inline Vec3 FdFromM(const Vec3& v) { return {v.z(), v.x(), v.y()}; }
// The handle's axes to M. A handle at rest points away from the user, as a stylus of the Omni does.
Eigen::Quaterniond FdHandleToM(const Eigen::Matrix3d& handle);

}  // namespace palpate
