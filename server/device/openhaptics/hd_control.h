// The control thread of an OpenHapticsDevice. It sets the device up, watches its frames, and
// releases the device in this order: zero force, scheduler, callback, device.
//
// Threads: Run on the control thread, which alone calls the library's functions outside of frames.
// All other functions on any ordinary thread. Not real-time.
// Errors: Error if the library is missing.
#pragma once

#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/openhaptics/hd_library.h"
#include "server/device/openhaptics/hd_servo.h"

namespace palpate {

class HdControl {
 public:
  static constexpr int kRetryMs = 500;

  // max_force_n: the spec's limit. If the library states a lower limit, that limit applies.
  HdControl(const std::string& library_path, std::string device_name, double max_force_n);

  HdServo& servo() { return servo_; }

  // Runs until RequestStop.
  void Run();
  void RequestStop();
  // Waits for the end of Run. Returns false at the timeout.
  bool WaitUntilDone(std::chrono::milliseconds longest);

  DeviceHealth health() const;
  std::optional<DeviceEvent> NextEvent();
  void AddEvent(DeviceEvent::Level level, std::string text);
  void Calibrate();

 private:
  using Clock = std::chrono::steady_clock;

  struct Session {
    HdConnection connection{};
    std::optional<hd::SchedulerHandle> callback{};
    std::string identity{};
  };

  std::optional<Session> SetUp();
  Session Identify(hd::Handle handle);
  // Returns false if the library refuses. `session` is then ready for TearDown.
  bool StartFrames(Session& session);
  void Stream(const Session& session);
  void TearDown(const Session& session);
  bool IsLost(int& silent_polls);
  void BeStreaming(const Session& session);

  // Queries to the library.
  hd::ErrorInfo NewestError();
  double GetDouble(hd::Enum name, double otherwise);
  std::string GetText(hd::Enum name);

  void TakeServoErrors();
  void Fail(const std::string& problem);
  void SetConnection(DeviceConnection connection);
  // Returns true if the thread is to stop.
  bool Wait(std::chrono::milliseconds longest);

  HdLibrary library_;
  const hd::Functions& hd_;
  HdServo servo_;
  const std::string device_name_;
  const double max_force_n_;

  // Used by the control thread only.
  std::map<unsigned int, Clock::time_point> told_;  // when each error code was last reported
  std::string last_error_;
  std::uint64_t calibrations_ = 0;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable wake_;
  bool stop_ = false;
  bool done_ = false;
  DeviceConnection connection_ = DeviceConnection::kAbsent;
  hd::Enum calibration_style_ = 0;
  std::uint64_t connections_ = 0;
  std::string identity_;
  std::string problem_;
  std::deque<DeviceEvent> events_;
};

}  // namespace palpate
