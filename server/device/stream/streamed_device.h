// A HapticDevice on a bus whose I/O thread is ours, such as USB. It looks for the device, sets it
// up, exchanges the newest values between bus and servo, and lets go of the device in order.
//
//            found            set up                 unplugged, silent, broken
//   absent --------> connecting --------> streaming --------------------------> absent
//     ^                  | refuses            |
//     +------------------+                    | Stop: zero force, motors off, release
//                                             v
//                                            end
//
// DeviceSeat says what Read returns, and what happens if the servo is silent. A device that is
// silent for DeviceSeat::kSilentMs counts as lost. The I/O thread looks for a device every
// DeviceLink::kRetry, or every kUnsuitableRetry if the device it found cannot be used.
//
// Threads: as HapticDevice. Only the I/O thread uses the bus.
// Real-time: Read and Write are wait-free. The I/O thread asks for SCHED_FIFO, one priority below
// the servo.
#pragma once

#include <atomic>
#include <chrono>
#include <cstdint>
#include <memory>
#include <string>

#include "server/device/haptic_device.h"
#include "server/device/stream/bus_error.h"

namespace palpate {

struct StreamReceived {
  bool has_reading = false;    // at least one whole, valid frame; the newest one is in the state
  std::uint32_t readings = 0;  // whole, valid frames
  std::uint32_t lost_readings = 0;  // from gaps in their numbers
  std::uint32_t corrupt_frames = 0;
  std::int64_t time_ns = 0;  // when the newest reading came, by MonotonicNowNs
  bool restarted = false;    // the device may have begun anew: no old force may come back at once
  std::string warning{};     // a line for the log; "": none
};

// An opened device. The destructor closes it.
//
// Threads: the I/O thread. Errors: BusError.
class StreamSession {
 public:
  virtual ~StreamSession() = default;

  // Brings the device to the state in which it streams. Waits for answers, for seconds at most;
  // gives up soon after `stop` becomes true.
  virtual void SetUp(const std::atomic<bool>& stop) = 0;
  virtual std::string place() const = 0;     // for people, such as "USB port 1-2"
  virtual std::string identity() const = 0;  // after SetUp; the same
  // What may help to understand a device that nobody has seen, one line for the log; "": nothing.
  virtual std::string evidence() const { return ""; }
  // Handles what is due, for at most this long. Sets `state` if there is a reading. Throws what
  // ended the stream.
  virtual StreamReceived Wait(std::chrono::microseconds longest, DeviceState& state) = 0;
  // Sends the command. Returns false if the last one is still under way; the caller then tries
  // again with a newer one.
  virtual bool TrySend(const DeviceCommand& command) = 0;
  // The number of transfers that failed and were tried again.
  virtual std::uint64_t transfer_errors() const = 0;
  // Switches the motors off and stops the device; waits for a bounded time. Tried even if the
  // device seems to be gone: motors that keep their last force are worse than a failed transfer.
  // Returns true if a zero force or the stop has reached the device, or if the device ends its
  // force by itself.
  virtual bool LetGo() noexcept = 0;
};

// A kind of device on a bus.
class StreamBus {
 public:
  virtual ~StreamBus() = default;

  virtual const DeviceDescription& spec() const = 0;
  // Finds the device and opens it; gives up soon after `stop` becomes true. Throws BusError.
  virtual std::unique_ptr<StreamSession> Open(const std::atomic<bool>& stop) = 0;
  // True: the device answers each force with one reading. False: the device streams by itself, and
  // a force is also sent if no reading came for a period.
  virtual bool is_request_response() const { return false; }
  // What a person must do before the first calibrated reading, one line. Any thread.
  virtual std::string calibration_hint() const = 0;
  // As HapticDevice::Calibrate. Any thread.
  virtual void RequestCalibration();
  // As HapticDevice::StopMoving.
  virtual void StopMoving() noexcept {}
  // As HapticDevice::moves_by_itself.
  virtual bool moves_by_itself() const noexcept { return false; }
};

class StreamedDevice final : public HapticDevice {
 public:
  static constexpr std::chrono::milliseconds kUnsuitableRetry{5000};
  // The longest that Stop waits. A vendor's library that hangs is left alone.
  static constexpr std::chrono::milliseconds kLongestStop{3000};

  // thread_name, realtime_priority: the I/O thread's, as in DeviceLink.
  StreamedDevice(std::unique_ptr<StreamBus> bus, const std::string& thread_name,
                 int realtime_priority);
  ~StreamedDevice() override;

  const DeviceDescription& spec() const override;
  void Start() override;
  void Stop() noexcept override;
  DeviceStatus Read(DeviceState& state) noexcept override;
  void Write(const DeviceCommand& command, double dt_s) noexcept override;
  DeviceHealth health() const override;
  std::optional<DeviceEvent> NextEvent() override;
  void Calibrate() override;
  void StopMoving() noexcept override;
  bool moves_by_itself() const noexcept override;

 private:
  struct Impl;
  // Shared with the thread, which outlives this object if it hangs.
  std::shared_ptr<Impl> impl_;
};

}  // namespace palpate
