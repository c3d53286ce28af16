#include "server/device/forcedimension/fd_library.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
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

namespace {

constexpr const char* kPole =
    "not calibrated, it does not tell its place: put the calibration pole into its pit";
constexpr const char* kStops =
    "not calibrated, it does not tell its place: move each axis to its stops by hand, or keep "
    "clear "
    "and run `palpate device calibrate forcedimension`: the arm then moves by itself";
constexpr const char* kAuto =
    "not calibrated, it does not tell its place: keep clear and run `palpate device calibrate "
    "forcedimension`: the arm then moves by itself";

constexpr std::array<FdModel, 8> kModels = {{
    {"delta.3", 150.0, 20.0, false, false, false, true, kStops},
    {"omega.3", 75.0, 12.0, false, false, false, false, kPole},
    {"omega.6", 75.0, 12.0, true, false, false, false, kPole},
    {"omega.7", 75.0, 12.0, true, false, true, false, kPole},
    {"sigma.3", 75.0, 12.0, false, false, false, true, kAuto},
    {"sigma.7", 75.0, 12.0, true, true, true, true, kAuto},
    {"lambda.3", 112.5, 12.0, false, false, false, true, kAuto},
    {"lambda.7", 112.5, 12.0, true, true, true, true, kAuto},
}};

std::string Lower(std::string text) {
  std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

}  // namespace

std::string FdModelNames() {
  std::string names;
  for (const FdModel& model : kModels) {
    names += (names.empty() ? "" : &model == &kModels.back() ? " or " : ", ");
    names += model.name;
  }
  return names;
}

const FdModel& FdModelOf(std::string_view name) {
  for (const FdModel& model : kModels) {
    if (model.name == name) return model;
  }
  throw Error(ErrorKind::kInvalidArgument,
              fmt::format("a model must be {}, not \"{}\"", FdModelNames(), name));
}

const FdModel* FdModelWith(const FdAbilities& abilities) {
  const std::string name = Lower(abilities.system_name);
  for (const FdModel& model : kModels) {
    if (name.find(model.family()) != std::string::npos && model.has_wrist == abilities.has_wrist &&
        model.has_torque == abilities.has_torque && model.has_gripper == abilities.has_gripper) {
      return &model;
    }
  }
  return nullptr;
}

DeviceDescription FdSpec(const FdModel& model) {
  DeviceDescription spec;
  spec.kind = "forcedimension";
  spec.model = fmt::format("Force Dimension {}", model.name);
  spec.workspace_min_mm = Vec3::Constant(-model.radius_mm);
  spec.workspace_max_mm = Vec3::Constant(model.radius_mm);
  // Far below what the motors can do, until somebody has seen it.
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  if (model.has_torque) {
    spec.max_torque_n_mm = 50.0;
    spec.continuous_torque_n_mm = 25.0;
  }
  // A delta.3 was passive up to this at 4 kHz (hapticore).
  spec.max_stiffness_n_per_mm = 0.8;
  spec.position_resolution_mm = 0.01;
  spec.button_count = 1;
  spec.senses_orientation = model.has_wrist;
  spec.calibration_moves_arm = model.moves_to_calibrate;
  spec.verification_level = kForceDimensionVerification;
  return spec;
}

Vec3 FdCentre(const FdModel& model, bool is_left_handed) {
  if (model.name != "sigma.7") return Vec3::Zero();
  return {-0.01, is_left_handed ? -0.02 : 0.02, 0.0};
}

Eigen::Quaterniond FdHandleToM(const Eigen::Matrix3d& handle) {
  Eigen::Matrix3d to_M;
  to_M << 0, 1, 0, 0, 0, 1, 1, 0, 0;
  return Eigen::Quaterniond(Eigen::Matrix3d(to_M * handle * to_M.transpose())).normalized();
}

}  // namespace palpate
