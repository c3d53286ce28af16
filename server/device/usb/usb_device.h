// A HapticDevice on USB: an I/O thread that looks for the device, sets it up, exchanges
// newest values between its bus and the servo, and lets go of it in good order.
//
//            found            set up                 unplugged, silent, broken
//   absent --------> connecting --------> streaming --------------------------> absent
//     ^                  | refuses            |
//     +------------------+                    | Stop: zero force, motors off, release
//                                             v
//                                            end
//
// Read is kStale when the newest reading is older than kStaleAfterMs and kFault when the
// device does not stream. Once the servo has not written for kServoSilentMs, zero force
// is written in its place, and Read is kStale, until it writes zero force. A device that has been
// silent for kSilentMs is given up, and looked for again every kRetryMs; one that turned out not to
// be what is driven, every kUnsuitableRetryMs.
//
// Threads: as HapticDevice; all of libusb is on the I/O thread.
// Real-time: Read and Write are wait-free. The I/O thread asks for SCHED_FIFO, one
// below the servo.
#pragma once

#include <memory>

#include "server/device/haptic_device.h"
#include "server/device/usb/usb_protocol.h"

namespace palpate {

class UsbDevice final : public HapticDevice {
 public:
  static constexpr int kStaleAfterMs = 4;
  static constexpr int kServoSilentMs = 5;
  static constexpr int kSilentMs = 100;
  static constexpr int kRetryMs = 500;
  static constexpr int kUnsuitableRetryMs = 5000;

  // realtime_priority: of the I/O thread, 1 to 99; 0: ordinary scheduling.
  UsbDevice(std::unique_ptr<UsbProtocol> protocol, int realtime_priority);
  ~UsbDevice() override;

  const DeviceSpec& spec() const override;
  void Start() override;
  void Stop() noexcept override;
  DeviceStatus Read(DeviceState& state) noexcept override;
  void Write(const Vec3& force_D_n, double dt_s) noexcept override;
  void SetMotors(bool on) noexcept override;
  DeviceHealth health() const override;
  std::optional<DeviceEvent> NextEvent() override;
  void Calibrate() override;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace palpate
