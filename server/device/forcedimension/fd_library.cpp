#include "server/device/forcedimension/fd_library.h"

#include <fmt/format.h>

#include <utility>

#include "common/error/error.h"
#include "server/device/stream/vendor_library.h"

namespace palpate {
namespace {

constexpr const char* kAdvice =
    "install Force Dimension's SDK 3.10 or later: copy its libdrd.so.3.x.y to /usr/local/lib and "
    "run ldconfig as root, or set [device] forcedimension_library to the file";

}  // namespace

KeptSignals::KeptSignals() noexcept {
  for (std::size_t n = 0; n < kSignals.size(); ++n)
    sigaction(kSignals.at(n), nullptr, &kept_.at(n));
}

KeptSignals::~KeptSignals() {
  for (std::size_t n = 0; n < kSignals.size(); ++n)
    sigaction(kSignals.at(n), &kept_.at(n), nullptr);
}

FdLibrary::FdLibrary(const std::string& path) {
  const KeptSignals kept;
  const VendorLibrary library(path, "Force Dimension's libdrd", kAdvice);
  const auto resolve = [&](const char* name, auto& function) { library.Resolve(name, function); };
  resolve("dhdGetSDKVersion", functions_.sdk_version);
  CheckVersion(path);
  resolve("dhdGetDeviceCount", functions_.device_count);
  resolve("drdOpenID", functions_.open);
  resolve("drdClose", functions_.close);
  resolve("dhdGetSystemName", functions_.system_name);
  resolve("dhdGetSerialNumber", functions_.serial_number);
  resolve("dhdGetVersion", functions_.firmware_version);
  resolve("dhdHasWrist", functions_.has_wrist);
  resolve("dhdHasActiveWrist", functions_.has_active_wrist);
  resolve("dhdHasGripper", functions_.has_gripper);
  resolve("dhdIsLeftHanded", functions_.is_left_handed);
  resolve("dhdGetPosition", functions_.position);
  resolve("dhdGetPositionAndOrientationFrame", functions_.position_and_frame);
  resolve("dhdGetButtonMask", functions_.buttons);
  resolve("dhdSetForceAndTorqueAndGripperForce", functions_.set_force);
  resolve("dhdEnableForce", functions_.enable_force);
  resolve("dhdSetBrakes", functions_.set_brakes);
  resolve("dhdSetGravityCompensation", functions_.set_gravity_compensation);
  resolve("dhdSetMaxForce", functions_.set_max_force);
  resolve("dhdSetMaxTorque", functions_.set_max_torque);
  resolve("dhdSetMaxGripperForce", functions_.set_max_gripper_force);
  resolve("dhdEnableExpertMode", functions_.enable_expert_mode);
  resolve("dhdDisableExpertMode", functions_.disable_expert_mode);
  resolve("dhdSetWatchdog", functions_.set_watchdog);
  resolve("dhdGetWatchdog", functions_.get_watchdog);
  resolve("dhdGetStatus", functions_.status);
  resolve("dhdEmulateButton", functions_.emulate_button);
  resolve("drdIsSupported", functions_.knows_calibration);
  resolve("drdIsInitialized", functions_.is_calibrated);
  resolve("drdAutoInit", functions_.calibrate);
  resolve("drdStop", functions_.end_calibration);
  resolve("dhdErrorGetLast", functions_.last_error);
  resolve("dhdErrorGetStr", functions_.error_text);
}

void FdLibrary::CheckVersion(const std::string& path) {
  int major = 0, minor = 0, release = 0, revision = 0;
  functions_.sdk_version(&major, &minor, &release, &revision);
  version_ = fmt::format("{}.{}.{}", major, minor, release);
  if (std::pair(major, minor) >= std::pair(3, 10)) return;
  throw Error(ErrorKind::kNotFound,
              fmt::format("{} is of SDK {}, which is too old: {}", path, version_, kAdvice));
}

std::string FdLibrary::LastError() const {
  const int error = functions_.last_error();
  const char* text = functions_.error_text(error);
  return fmt::format("error {}, {}", error, text != nullptr ? text : "without a text");
}

}  // namespace palpate
