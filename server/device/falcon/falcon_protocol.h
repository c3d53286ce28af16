// The Novint Falcon on USB (0403:cb48).
//
// After power-on the Falcon has no firmware. We may not distribute Novint's firmware: the operator
// names a file. The encoders count from their positions at power-on. They become right when the
// grip is pulled all the way out and pushed all the way in (homing). Readings are not calibrated
// and forces are off until then, and also while the arms cannot have the angles of a reading. The
// Falcon does not dock and its grip does not turn.
//
// Lights: red until homed, then blue without forces and green with forces.
// Threads and real-time: as UsbProtocol. Ownership: borrows the link in calls only.
// Source: see frames.h, kinematics.h and below. Verification level: none; we have not seen a
// device.
#pragma once

#include <atomic>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "server/device/falcon/frames.h"
#include "server/device/usb/usb_bus.h"
#include "server/device/usb/usb_link.h"

namespace palpate {

// Brings a Falcon to the state in which it speaks frames: sets up its FTDI chip, and uploads the
// firmware, which the Falcon loses without power.
//
// Source: libnifalcon (BSD), FalconCommLibUSB.cpp and FalconFirmware.cpp. Verification level: none;
// we have not seen a device.
// Threads: the I/O thread. Not real-time: waits.
// Errors: BusError, also soon after `stop` becomes true.

// Reads the operator's file, of 1 byte to kMaxFalconFirmwareBytes.
inline constexpr std::size_t kMaxFalconFirmwareBytes = 256 * 1024;
std::vector<std::uint8_t> ReadFalconFirmware(const std::string& file);

struct FalconOptions {
  std::string port{};           // as in UsbMatch
  std::string firmware_file{};  // "": the Falcon already has its firmware
};

class FalconProtocol final : public UsbProtocol {
 public:
  explicit FalconProtocol(const FalconOptions& options);

  const DeviceDescription& spec() const override { return spec_; }
  const UsbMatch& match() const override { return match_; }
  std::string SetUp(UsbLink& link, const std::atomic<bool>& stop) override;
  StreamReceived Receive(std::span<const std::uint8_t> bytes, DeviceState& state) noexcept override;
  std::size_t Encode(const DeviceCommand& command,
                     std::span<std::uint8_t, kMaxFrameBytes> out) noexcept override;
  bool is_request_response() const override { return true; }
  void TearDown(UsbLink& link) noexcept override;
  const char* calibration_hint() const noexcept override;

 private:
  void Understand(const FalconReport& report, DeviceState& state) noexcept;

  const DeviceDescription spec_;
  const UsbMatch match_;
  const std::string firmware_file_;

  FalconFrameFinder finder_{};
  // Values of the newest reading.
  bool calibrated_ = false;
  Vec3 p_M_mm_ = Vec3::Zero();  // the last valid position
  Vec3 angles_rad_ = Vec3::Zero();
};

}  // namespace palpate
