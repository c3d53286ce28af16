#include "server/device/openhaptics/openhaptics_device.h"

#include <chrono>
#include <thread>
#include <utility>

#include "common/error/error.h"
#include "server/device/openhaptics/hd_control.h"

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
  spec.verification_level = VerificationLevel::kNone;
  return spec;
}

}  // namespace

struct OpenHapticsDevice::Control {
  HdControl hd;
  std::thread thread{};
};

OpenHapticsDevice::OpenHapticsDevice(OpenHapticsOptions options)
    : options_(std::move(options)), spec_(TouchSpec()) {}

OpenHapticsDevice::~OpenHapticsDevice() { Stop(); }

void OpenHapticsDevice::Start() {
  if (control_ != nullptr && control_->thread.joinable()) {
    throw Error(ErrorKind::kConflict, "the device is started already");
  }
  control_ = std::shared_ptr<Control>(
      new Control{.hd = HdControl(options_.library, options_.device_name, spec_.max_force_n)});
  control_->thread = std::thread([control = control_] { control->hd.Run(); });
}

void OpenHapticsDevice::Stop() noexcept {
  if (control_ == nullptr || !control_->thread.joinable()) return;
  control_->hd.RequestStop();
  if (control_->hd.WaitUntilDone(std::chrono::milliseconds(kStopMs))) {
    control_->thread.join();
    return;
  }
  control_->hd.AddEvent(DeviceEvent::Level::kError,
                        "the HD library does not release the device; the force on it is "
                        "zero. Unplug the device and plug it in again before its next use");
  control_->hd.servo().End();
  control_->thread.detach();
}

DeviceStatus OpenHapticsDevice::Read(DeviceState& state) noexcept {
  return control_ != nullptr ? control_->hd.servo().Read(state) : DeviceStatus::kFault;
}

void OpenHapticsDevice::Write(const Vec3& force_D_n, double /*dt_s*/) noexcept {
  if (control_ != nullptr) control_->hd.servo().Write(force_D_n, motors_on_);
}

DeviceHealth OpenHapticsDevice::health() const {
  return control_ != nullptr ? control_->hd.health()
                             : DeviceHealth{.connection = DeviceConnection::kAbsent};
}

std::optional<DeviceEvent> OpenHapticsDevice::NextEvent() {
  return control_ != nullptr ? control_->hd.NextEvent() : std::nullopt;
}

void OpenHapticsDevice::Calibrate() {
  if (control_ == nullptr) {
    throw Error(ErrorKind::kUnavailable, "the device is not started: start the daemon first");
  }
  control_->hd.Calibrate();
}

}  // namespace palpate
