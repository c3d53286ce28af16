// A HapticDevice on USB. Its I/O thread looks for the device, sets it up, exchanges the newest
// values between bus and servo, and releases the device in order.
//
//            found            set up                 unplugged, silent, broken
//   absent --------> connecting --------> streaming --------------------------> absent
//     ^                  | refuses            |
//     +------------------+                    | Stop: zero force, motors off, release
//                                             v
//                                            end
//
// Read returns kStale if the newest reading is older than kStaleAfterMs, and kFault if the device
// does not stream. If the servo does not write for kServoSilentMs, the I/O thread writes zero force
// and Read returns kStale. This lasts until the servo writes zero force. A device that is silent
// for kSilentMs counts as lost. The I/O thread looks for a device every kRetryMs, or every
// kUnsuitableRetryMs if the device it found cannot be used.
//
// Threads: as HapticDevice. Only the I/O thread calls libusb.
// Real-time: Read and Write are wait-free. The I/O thread asks for SCHED_FIFO, one priority below
// the servo.
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

  // realtime_priority: the I/O thread's, 1 to 99; 0: ordinary scheduling.
  UsbDevice(std::unique_ptr<UsbProtocol> protocol, int realtime_priority);
  ~UsbDevice() override;

  const DeviceDescription& spec() const override;
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
