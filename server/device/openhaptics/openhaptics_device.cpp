#include "server/device/openhaptics/openhaptics_device.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <thread>
#include <utility>

#include "common/error/error.h"

namespace palpate {
namespace {

using std::chrono::milliseconds;

constexpr unsigned long kFramesHz = 1000;  // NOLINT(google-runtime-int): as in the library
constexpr milliseconds kPoll{20};
// The time limit for a new connection's first reading.
constexpr double kFirstReadingMs = 1000.0;
// After the whole machine stood still, frames get a chance to continue before they count as silent.
constexpr int kSilentPolls = 2;
constexpr int kZeroFrames = 2;
constexpr milliseconds kZeroFramesWait{50};
constexpr std::chrono::seconds kTellAgain{10};
constexpr int kMostErrors = 1000;

using Level = DeviceEvent::Level;

hd::Enum OneStyle(int styles) {
  const auto bits = static_cast<hd::Enum>(styles);
  for (const hd::Enum style : {hd::kStyleAuto, hd::kStyleInkwell, hd::kStyleEncoderReset}) {
    if ((bits & style) != 0) return style;
  }
  return 0;
}

std::string HowToCalibrate(hd::Enum style) {
  if (style == hd::kStyleInkwell) return "not calibrated: put the stylus into the inkwell";
  if (style == hd::kStyleEncoderReset) {
    return "not calibrated: hold the arm in its reset pose and calibrate";
  }
  return "not calibrated: move the stylus about";
}

}  // namespace

HdControl::HdControl(const std::string& library_path, const std::vector<std::string>& device_names,
                     double max_force_n)
    : library_(library_path),
      hd_(library_.functions()),
      max_force_n_(max_force_n),
      loop_(hd_),
      link_("palpate-hd", 0) {
  for (const std::string& name : device_names) {
    devices_.push_back(std::make_unique<Device>(hd_, name));
  }
}

void HdControl::Start() {
  link_.Start(devices_.front()->servo.seat.log(),
              [self = shared_from_this()] { return self->Connect(); });
}

bool HdControl::Stop(milliseconds longest) noexcept {
  // At once, in case the thread waits for the library.
  for (const auto& device : devices_) device->servo.BeginToStop();
  return link_.Stop(longest);
}

milliseconds HdControl::Connect() {
  std::vector<HdServo*> frames;
  for (const auto& device : devices_) {
    SetUp(*device);
    if (device->is_set_up) frames.push_back(&device->servo);
  }
  if (!frames.empty()) {
    loop_.Set(std::move(frames));
    if (StartFrames()) Stream();
    TearDown();
  }
  return DeviceLink::kRetry;
}

void HdControl::SetUp(Device& device) {
  NewestError();  // takes errors of earlier calls
  device.is_alive = device.is_set_up = false;
  const hd::Handle handle = hd_.init_device(device.name.empty() ? nullptr : device.name.c_str());
  const hd::ErrorInfo error = NewestError();
  const bool has_handle = handle != hd::kInvalidHandle && handle <= hd::kGreatestHandle;
  if (error.code != 0 || !has_handle) {
    if (has_handle) hd_.disable_device(handle);
    return Fail(device, "cannot set up the device: " +
                            (error.code != 0 ? hd::Describe(error)
                                             : "the HD library gave no device and no reason"));
  }
  device.is_alive = device.is_set_up = true;
  device.silent_polls = 0;
  device.servo.seat.SetConnection(DeviceConnection::kConnecting);
  const HdConnection connection = Identify(handle, device.identity);
  device.calibration_style = connection.calibration_style;
  device.servo.Begin(connection);
}

HdConnection HdControl::Identify(hd::Handle handle, std::string& identity) {
  HdConnection connection{.handle = handle};
  hd_.make_current(handle);
  const double stated_n = GetDouble(hd::kNominalMaxForce, max_force_n_);
  connection.max_force_n = stated_n > 0.0 ? std::fmin(stated_n, max_force_n_) : max_force_n_;
  int styles = 0;
  hd_.get_integerv(hd::kCalibrationStyle, &styles);
  connection.calibration_style = NewestError().code == 0 ? OneStyle(styles) : 0;
  char firmware[32];
  std::snprintf(firmware, sizeof firmware, "%g", GetDouble(hd::kDeviceFirmwareVersion, 0.0));
  identity = GetText(hd::kDeviceModelType) + ", serial number " + GetText(hd::kDeviceSerialNumber) +
             ", firmware " + firmware;
  return connection;
}

bool HdControl::StartFrames() {
  hd_.set_scheduler_rate(kFramesHz);
  if (const hd::ErrorInfo error = NewestError(); error.code != 0) {
    devices_.front()->servo.seat.log().Add(
        Level::kInfo, "the HD library keeps to its own rate: " + hd::Describe(error));
  }
  callback_ = hd_.schedule_asynchronous(&HdLoop::Frame, &loop_, hd::kMaxSchedulerPriority);
  hd::ErrorInfo error = NewestError();
  if (error.code == 0) {
    hd_.start_scheduler();
    error = NewestError();
  }
  if (error.code == 0) return true;
  for (const auto& device : devices_) {
    Fail(*device, "the HD library does not start its loop: " + hd::Describe(error));
  }
  return false;
}

void HdControl::Stream() {
  pushed_at_ = Clock::now();
  while (!link_.Wait(kPoll)) {
    for (const auto& device : devices_) {
      TakeErrors(*device);
      if (device->is_alive) Watch(*device);
      if (device->is_alive && device->servo.motors_on()) pushed_at_ = Clock::now();
    }
    if (ShallSetUpAgain()) return;
  }
}

void HdControl::Watch(Device& device) {
  HdServo& servo = device.servo;
  if (servo.lost()) return Fail(device, "the device is lost: " + device.last_error);
  if (servo.has_reading() && !servo.seat.is_streaming()) {
    servo.seat.BeStreaming("", device.identity);
  }
  const double longest_ms = servo.has_reading() ? DeviceSeat::kSilentMs : kFirstReadingMs;
  device.silent_polls = servo.silent_ms() > longest_ms ? device.silent_polls + 1 : 0;
  if (device.silent_polls < kSilentPolls) return;
  Fail(device, "the HD library's loop stands still; restart the vendor's driver if it stays so");
}

bool HdControl::ShallSetUpAgain() const {
  const auto is_alive = [](const auto& device) { return device->is_alive; };
  if (std::ranges::all_of(devices_, is_alive)) return false;
  if (std::ranges::none_of(devices_, is_alive)) return true;
  return Clock::now() > pushed_at_ + kRetryBeside;
}

// Also ends a set-up that failed half-way. The library may refuse calls that have no effect; its
// errors are ignored.
void HdControl::TearDown() {
  for (const auto& device : devices_) {
    device->servo.seat.SetConnection(DeviceConnection::kConnecting);
    device->servo.BeginToStop();
  }
  const Clock::time_point until = Clock::now() + kZeroFramesWait;
  const auto is_zero = [](const auto& device) {
    return !device->is_set_up || device->servo.zero_frames() >= kZeroFrames;
  };
  while (callback_ && !std::ranges::all_of(devices_, is_zero) && Clock::now() < until) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  hd_.stop_scheduler();
  if (callback_) hd_.unschedule(*callback_);
  callback_.reset();
  for (const auto& device : devices_) {
    if (device->is_set_up) hd_.disable_device(device->servo.handle());
    device->servo.seat.SetConnection(DeviceConnection::kAbsent);
  }
  NewestError();
}

// Takes all errors from the library and returns the newest.
hd::ErrorInfo HdControl::NewestError() {
  const hd::ErrorInfo newest = hd_.get_error();
  for (int i = 0; i < kMostErrors && newest.code != 0; ++i) {
    if (hd_.get_error().code == 0) break;
  }
  return newest;
}

double HdControl::GetDouble(hd::Enum name, double otherwise) {
  double value = otherwise;
  hd_.get_doublev(name, &value);
  return NewestError().code == 0 && std::isfinite(value) ? value : otherwise;
}

std::string HdControl::GetText(hd::Enum name) {
  const char* text = hd_.get_string(name);
  return NewestError().code == 0 && text != nullptr ? text : "unknown";
}

void HdControl::TakeErrors(Device& device) {
  hd::ErrorInfo error;
  while (device.servo.TryPopError(error)) {
    device.last_error = hd::Describe(error);
    const Clock::time_point now = Clock::now();
    const auto told = device.told.find(error.code);
    if (told != device.told.end() && now - told->second < kTellAgain) continue;
    device.told[error.code] = now;
    device.servo.seat.log().Add(Level::kWarning, device.last_error);
  }
  const std::uint64_t calibrations = device.servo.calibrations();
  if (std::exchange(device.calibrations, calibrations) != calibrations) {
    device.servo.seat.log().Add(Level::kInfo, "the device was calibrated");
  }
}

void HdControl::Fail(Device& device, const std::string& problem) {
  device.is_alive = false;
  device.servo.seat.SetConnection(DeviceConnection::kAbsent);
  device.servo.seat.log().SetProblem(
      problem + (devices_.size() == 1 ? ""
                                      : "; it is set up again once the forces of the other "
                                        "devices have been off for some seconds"),
      Level::kError);
}

DeviceHealth HdControl::health(std::size_t n) const {
  return devices_[n]->servo.seat.health(HowToCalibrate(devices_[n]->calibration_style));
}

void HdControl::Calibrate(std::size_t n) {
  Device& device = *devices_[n];
  if (device.servo.seat.is_streaming() && device.calibration_style == 0) {
    throw Error(ErrorKind::kInvalidArgument, "this device needs no calibration");
  }
  device.servo.RequestCalibration();
}

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
