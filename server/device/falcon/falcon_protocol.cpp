#include "server/device/falcon/falcon_protocol.h"

#include <algorithm>
#include <chrono>

#include "server/device/falcon/bring_up.h"
#include "server/device/falcon/kinematics.h"

namespace palpate {
namespace {

constexpr UsbMatch::Ids kIds{.vendor = 0x0403, .product = 0xcb48};
constexpr std::uint8_t kVendorClass = 0xff;  // class of the FTDI chip's only interface
constexpr int kTries = 10, kTriesAfterUpload = 40;
constexpr std::chrono::milliseconds kSendPatience(100);

DeviceDescription FalconSpec() {
  DeviceDescription spec;
  spec.kind = "falcon";
  spec.model = "Novint Falcon";
  // The datasheet's 4 inch cube. The corners of the cube are out of reach (kinematics.h).
  spec.workspace_min_mm = Vec3::Constant(-50.8);
  spec.workspace_max_mm = Vec3::Constant(50.8);
  // The datasheet says more than 2 lb (8.9 N), CHAI3D says 8 N. We limit it to 3.3 N, as all forces
  // here, until the force of a motor count is measured.
  spec.max_force_n = 3.3;
  // The value is not published. We use the value of the Touch, whose motors have a third of the
  // force: a cautious guess.
  spec.continuous_force_n = 0.88;
  // CHAI3D uses 3 N/mm. We use a third of it, because the Falcon is untried with this servo.
  spec.max_stiffness_n_per_mm = 1.0;
  spec.position_resolution_mm = 25.4 / 400.0;  // the datasheet's 400 per inch
  spec.button_count = 4;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

}  // namespace

FalconProtocol::FalconProtocol(const FalconOptions& options)
    : spec_(FalconSpec()),
      match_{.ids = {kIds}, .port = options.port, .data_class = kVendorClass},
      firmware_file_(options.firmware_file) {}

std::string FalconProtocol::SetUp(UsbLink& link, const std::atomic<bool>& stop) {
  finder_ = {};
  calibrated_ = false;
  p_M_mm_ = angles_rad_ = Vec3::Zero();
  SetFalconLineForFrames(link);
  if (!FalconAnswers(link, kTries, stop)) {
    if (firmware_file_.empty()) {
      throw BusError(BusFault::kUnsuitable,
                     "the Falcon does not answer: it has no firmware yet; set [device] "
                     "falcon_firmware to the file of Novint's firmware, which is part of Novint's "
                     "driver and of libnifalcon");
    }
    UploadFalconFirmware(link, ReadFalconFirmware(firmware_file_), stop);
    if (!FalconAnswers(link, kTriesAfterUpload, stop)) {
      throw BusError(BusFault::kTimeout, "the Falcon took the firmware from " + firmware_file_ +
                                             " and does not answer: is it Novint's?");
    }
  }
  return "Novint Falcon at USB port " + link.found().port;
}

StreamReceived FalconProtocol::Receive(std::span<const std::uint8_t> bytes,
                                       DeviceState& state) noexcept {
  StreamReceived received;
  const std::uint32_t corrupt_before = finder_.corrupt_frames();
  FalconFrame newest{};
  ForEachFtdiByte(bytes, [&](std::uint8_t byte) {
    if (!finder_.Push(byte)) return;
    newest = finder_.frame();
    ++received.readings;
  });
  received.corrupt_frames = finder_.corrupt_frames() - corrupt_before;
  const auto report = DecodeFalconReport(newest);
  if (!report) return received;
  received.has_reading = true;
  Understand(*report, state);
  return received;
}

void FalconProtocol::Understand(const FalconReport& report, DeviceState& state) noexcept {
  const Vec3 angles_rad = FalconAnglesFromCounts(report.encoders);
  calibrated_ = report.is_homed() && FalconPositionAt(angles_rad, p_M_mm_);
  if (calibrated_) angles_rad_ = angles_rad;
  state.p_MHip_mm = p_M_mm_;
  state.R_MS = Eigen::Quaterniond::Identity();
  state.buttons = report.buttons;
  state.docked = false;
  state.calibrated = calibrated_;
}

std::size_t FalconProtocol::Encode(const DeviceCommand& command,
                                   std::span<std::uint8_t, kMaxFrameBytes> out) noexcept {
  // The homing flag stays set: libnifalcon's programs never clear it.
  FalconCommand motors{.lights = kFalconRedLight, .homing = true};
  if (calibrated_) motors.lights = command.motors_on ? kFalconGreenLight : kFalconBlueLight;
  Mat3 jacobian;
  if (calibrated_ && command.motors_on && FalconJacobianAt(p_M_mm_, angles_rad_, jacobian)) {
    motors.motors = FalconMotorsFromTorques(jacobian.transpose() * command.wrench_M.force_n);
  }
  const FalconFrame frame = EncodeFalconCommand(motors);
  std::copy(frame.begin(), frame.end(), out.begin());
  return frame.size();
}

void FalconProtocol::TearDown(UsbLink& link) noexcept {
  try {
    link.Send(EncodeFalconCommand({.homing = true}), kSendPatience);
  } catch (const BusError&) {
    // The device is gone, and its force with it.
  }
}

const char* FalconProtocol::calibration_hint() const noexcept {
  return "the Falcon is not homed: pull its grip all the way out, then push it all the way in";
}

}  // namespace palpate
