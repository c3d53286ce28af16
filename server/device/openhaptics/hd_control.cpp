#include "server/device/openhaptics/hd_control.h"

#include <cmath>
#include <cstdio>
#include <thread>
#include <utility>

#include "common/error/error.h"
#include "server/device/openhaptics/hd_errors.h"

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
constexpr std::size_t kMostEvents = 64;

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

HdControl::HdControl(const std::string& library_path, std::string device_name, double max_force_n)
    : library_(library_path),
      hd_(library_.functions()),
      servo_(hd_),
      device_name_(std::move(device_name)),
      max_force_n_(max_force_n) {}

void HdControl::Run() {
  do {
    const std::optional<Session> session = SetUp();
    if (session) Stream(*session);
  } while (!Wait(milliseconds(kRetryMs)));
  const std::lock_guard lock(mutex_);
  done_ = true;
  wake_.notify_all();
}

std::optional<HdControl::Session> HdControl::SetUp() {
  NewestError();  // takes errors of earlier calls
  const hd::Handle handle = hd_.init_device(device_name_.empty() ? nullptr : device_name_.c_str());
  const hd::ErrorInfo error = NewestError();
  const bool has_handle = handle != hd::kInvalidHandle && handle <= hd::kGreatestHandle;
  if (error.code != 0 || !has_handle) {
    if (has_handle) hd_.disable_device(handle);
    Fail("cannot set up the device: " +
         (error.code != 0 ? hd::Describe(error) : "the HD library gave no device and no reason"));
    return std::nullopt;
  }
  SetConnection(DeviceConnection::kConnecting);
  Session session = Identify(handle);
  if (StartFrames(session)) return session;
  TearDown(session);
  return std::nullopt;
}

HdControl::Session HdControl::Identify(hd::Handle handle) {
  Session session;
  session.connection.handle = handle;
  const double stated_n = GetDouble(hd::kNominalMaxForce, max_force_n_);
  session.connection.max_force_n =
      stated_n > 0.0 ? std::fmin(stated_n, max_force_n_) : max_force_n_;
  int styles = 0;
  hd_.get_integerv(hd::kCalibrationStyle, &styles);
  session.connection.calibration_style = NewestError().code == 0 ? OneStyle(styles) : 0;
  char firmware[32];
  std::snprintf(firmware, sizeof firmware, "%g", GetDouble(hd::kDeviceFirmwareVersion, 0.0));
  session.identity = GetText(hd::kDeviceModelType) + ", serial number " +
                     GetText(hd::kDeviceSerialNumber) + ", firmware " + firmware;
  return session;
}

bool HdControl::StartFrames(Session& session) {
  hd_.set_scheduler_rate(kFramesHz);
  if (const hd::ErrorInfo error = NewestError(); error.code != 0) {
    AddEvent(Level::kInfo, "the HD library keeps to its own rate: " + hd::Describe(error));
  }
  servo_.Begin(session.connection);
  session.callback = hd_.schedule_asynchronous(&HdServo::Frame, &servo_, hd::kMaxSchedulerPriority);
  hd::ErrorInfo error = NewestError();
  if (error.code == 0) {
    hd_.start_scheduler();
    error = NewestError();
  }
  if (error.code == 0) return true;
  Fail("the HD library does not start its loop: " + hd::Describe(error));
  return false;
}

void HdControl::Stream(const Session& session) {
  bool is_streaming = false;
  int silent_polls = 0;
  while (!Wait(kPoll)) {
    TakeServoErrors();
    if (!is_streaming && servo_.has_reading()) {
      is_streaming = true;
      BeStreaming(session);
    }
    if (IsLost(silent_polls)) break;
  }
  TearDown(session);
}

bool HdControl::IsLost(int& silent_polls) {
  if (servo_.lost()) {
    Fail("the device is lost: " + last_error_);
    return true;
  }
  const double longest_ms = servo_.has_reading() ? HdServo::kSilentMs : kFirstReadingMs;
  silent_polls = servo_.silent_ms() > longest_ms ? silent_polls + 1 : 0;
  if (silent_polls < kSilentPolls) return false;
  Fail("the HD library's loop stands still; restart the vendor's driver if it stays so");
  return true;
}

void HdControl::BeStreaming(const Session& session) {
  AddEvent(Level::kInfo, "readings come from " + session.identity);
  const std::lock_guard lock(mutex_);
  connection_ = DeviceConnection::kStreaming;
  calibration_style_ = session.connection.calibration_style;
  identity_ = session.identity;
  problem_.clear();
  ++connections_;
}

// Also ends a set-up that failed half-way. The library may refuse calls that have no effect; its
// errors are ignored.
void HdControl::TearDown(const Session& session) {
  servo_.End();
  servo_.BeginToStop();
  const Clock::time_point until = Clock::now() + kZeroFramesWait;
  while (session.callback && servo_.zero_frames() < kZeroFrames && Clock::now() < until) {
    std::this_thread::sleep_for(milliseconds(1));
  }
  hd_.stop_scheduler();
  if (session.callback) hd_.unschedule(*session.callback);
  hd_.disable_device(session.connection.handle);
  NewestError();
  SetConnection(DeviceConnection::kAbsent);
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

void HdControl::TakeServoErrors() {
  hd::ErrorInfo error;
  while (servo_.TryPopError(error)) {
    last_error_ = hd::Describe(error);
    const Clock::time_point now = Clock::now();
    const auto told = told_.find(error.code);
    if (told != told_.end() && now - told->second < kTellAgain) continue;
    told_[error.code] = now;
    AddEvent(Level::kWarning, last_error_);
  }
  const std::uint64_t calibrations = servo_.counts().calibrations.load();
  if (calibrations != calibrations_) AddEvent(Level::kInfo, "the device was calibrated");
  calibrations_ = calibrations;
}

// A repeated problem is reported once.
void HdControl::Fail(const std::string& problem) {
  {
    const std::lock_guard lock(mutex_);
    if (problem_ == problem) return;
    problem_ = problem;
  }
  AddEvent(Level::kError, problem);
}

void HdControl::SetConnection(DeviceConnection connection) {
  const std::lock_guard lock(mutex_);
  connection_ = connection;
}

bool HdControl::Wait(milliseconds longest) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, longest, [this] { return stop_; });
}

void HdControl::RequestStop() {
  // At once, in case the control thread waits for the library.
  servo_.BeginToStop();
  const std::lock_guard lock(mutex_);
  stop_ = true;
  wake_.notify_all();
}

bool HdControl::WaitUntilDone(milliseconds longest) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, longest, [this] { return done_; });
}

DeviceHealth HdControl::health() const {
  const HdCounts& counts = servo_.counts();
  DeviceHealth health;
  health.docked = servo_.docked();
  health.readings = counts.readings;
  health.forces_written = counts.forces_written;
  health.corrupt_frames = counts.corrupt_frames;
  health.transfer_errors = counts.transfer_errors;
  health.watchdog_zeros = counts.watchdog_zeros;
  const std::lock_guard lock(mutex_);
  health.connection = connection_;
  health.identity = identity_;
  health.problem = problem_;
  health.connections = connections_;
  const bool is_streaming = connection_ == DeviceConnection::kStreaming;
  health.calibrated = is_streaming && servo_.calibrated();
  if (is_streaming && !health.calibrated) health.problem = HowToCalibrate(calibration_style_);
  return health;
}

std::optional<DeviceEvent> HdControl::NextEvent() {
  const std::lock_guard lock(mutex_);
  if (events_.empty()) return std::nullopt;
  DeviceEvent event = std::move(events_.front());
  events_.pop_front();
  return event;
}

void HdControl::AddEvent(Level level, std::string text) {
  const std::lock_guard lock(mutex_);
  if (events_.size() == kMostEvents) events_.pop_front();
  events_.push_back({.level = level, .text = std::move(text)});
}

void HdControl::Calibrate() {
  {
    const std::lock_guard lock(mutex_);
    if (connection_ == DeviceConnection::kStreaming && calibration_style_ == 0) {
      throw Error(ErrorKind::kInvalidArgument, "this device needs no calibration");
    }
  }
  servo_.RequestCalibration();
}

}  // namespace palpate
