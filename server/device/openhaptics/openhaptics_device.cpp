#include "server/device/openhaptics/openhaptics_device.h"

#include <chrono>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

// Datasheet of the Touch (formerly Phantom Omni). The stiffness is the library's own value, as a
// public test program printed it. The origin is in the middle of the workspace, as in the library.
DeviceDescription TouchSpec() {
  DeviceDescription spec;
  spec.kind = "openhaptics";
  spec.model = "Phantom Omni / Touch by OpenHaptics";
  spec.workspace_min_mm = Vec3(-80.0, -60.0, -35.0);
  spec.workspace_max_mm = Vec3(80.0, 60.0, 35.0);
  spec.max_force_n = 3.3;
  spec.continuous_force_n = 0.88;
  spec.max_stiffness_n_per_mm = 0.5;
  spec.position_resolution_mm = 0.055;
  spec.button_count = 2;
  spec.senses_orientation = true;
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

}  // namespace

OpenHapticsDevice::OpenHapticsDevice(OpenHapticsOptions options)
    : options_(std::move(options)), spec_(TouchSpec()) {}

OpenHapticsDevice::~OpenHapticsDevice() { Stop(); }

void OpenHapticsDevice::Start() {
  if (is_started_) throw Error(ErrorKind::kConflict, "the device is started already");
  control_ = std::make_shared<HdControl>(
      options_.library, std::vector<std::string>{options_.device_name}, spec_.max_force_n);
  control_->Start();
  is_started_ = true;
}

void OpenHapticsDevice::Stop() noexcept {
  if (!std::exchange(is_started_, false)) return;
  if (control_->Stop(std::chrono::milliseconds(kStopMs))) return;
  DeviceSeat& seat = control_->device(0).seat;
  seat.log().Add(DeviceEvent::Level::kError,
                 "the HD library does not release the device; the force on it is zero. Unplug the "
                 "device and plug it in again before its next use");
  seat.SetConnection(DeviceConnection::kAbsent);
}

DeviceStatus OpenHapticsDevice::Read(DeviceState& state) noexcept {
  return control_ != nullptr ? control_->device(0).Read(state) : DeviceStatus::kFault;
}

void OpenHapticsDevice::Write(const DeviceCommand& command, double /*dt_s*/) noexcept {
  if (control_ != nullptr) control_->device(0).seat.Write(command);
}

DeviceHealth OpenHapticsDevice::health() const {
  return control_ != nullptr ? control_->health(0)
                             : DeviceHealth{.connection = DeviceConnection::kAbsent};
}

std::optional<DeviceEvent> OpenHapticsDevice::NextEvent() {
  return control_ != nullptr ? control_->device(0).seat.NextEvent() : std::nullopt;
}

void OpenHapticsDevice::Calibrate() {
  if (control_ == nullptr) {
    throw Error(ErrorKind::kUnavailable, "the device is not started: start the daemon first");
  }
  control_->Calibrate(0);
}

}  // namespace palpate
